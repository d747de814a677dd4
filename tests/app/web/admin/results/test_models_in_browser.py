"""The page of models in real Chromium: what its canvases show, by their pixels."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page, Route, expect

from app.operations.studies import manage
from app.settings import Settings
from tests.app.web.admin import small_models
from tests.app.web.admin.dashboard_client import sign_in
from tests.conftest import BROWSER_OPTIONS, browser_path

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True),  # pages look the same on the other
]

VENDOR = Path(__file__).parents[5] / "static" / "vendor"
GROUND = (241, 239, 233)  # --paper-sunken
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
SPLATS_ARE_DRAWN = """() => {
    const canvas = document.querySelector("[data-side=right] canvas");
    const { width, height } = canvas, context = canvas.getContext("webgl2"), middle = new Uint8Array(4);
    context.readPixels(width / 2, height / 2, 1, 1, context.RGBA, context.UNSIGNED_BYTE, middle);
    return middle[2] > middle[0] + 80;
}"""  # the drawing order comes from a worker
PIXELS = "(canvas) => canvas.toDataURL()"
Look = Callable[[str], NDArray[np.int16]]


@pytest.fixture(scope="module")
def packages() -> None:
    """What the 3D view is made of."""
    if not VENDOR.is_dir():
        pytest.skip("the browser packages are not installed; `make setup` does it where npm's registry is reachable")


@pytest.fixture(scope="module")
def graphics(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Browser]:
    """The same Chromium with WebGL, drawn without a graphics card."""
    request.getfixturevalue("packages")
    arguments = [*BROWSER_OPTIONS, "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    drawing = browser.browser_type.launch(executable_path=browser_path(), args=arguments)
    yield drawing
    drawing.close()


@pytest.fixture(scope="module")
def path(settings: Settings, new_study: Callable[[], dict[str, Any]], tmp_path_factory: pytest.TempPathFactory) -> str:
    study = new_study()
    folder = small_models.write_folder(tmp_path_factory.mktemp("models"))
    small_models.write_splats(small_models.write_plain(folder, "box"), "box")
    manage.attach_results(settings, [folder], study["slug"])
    return f"/admin/studies/{study['slug']}/models"


@pytest.fixture
def page(graphics: Browser, server: str, settings: Settings, path: str) -> Iterator[Page]:
    """The page of models, both shown; at the end the browser must not have complained."""
    complaints: list[str] = []
    page = graphics.new_page(base_url=server, viewport={"width": 1366, "height": 768})
    page.on("console", lambda told: "GPU stall" not in told.text and complaints.append(told.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    sign_in(page, settings)
    page.goto(path)
    for side in ("left", "right"):
        expect(page.locator(f"[data-side={side}] [data-facts]")).to_contain_text("triangles")
    yield page
    page.close()
    assert complaints == []


@pytest.fixture
def look(page: Page) -> Look:
    """What a canvas shows, RGB: a screenshot of a busy machine may be older than what was drawn last."""

    def look(side: str) -> NDArray[np.int16]:
        page.evaluate(DRAWN)
        canvas = page.locator(f"[data-side={side}] canvas")
        expect(canvas).to_be_in_viewport()
        picture = b64decode(canvas.evaluate(PIXELS).partition(",")[2])
        pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
        return np.asarray(pixels[..., ::-1], np.int16)

    return look


def drawn(pixels: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Where there is more than the ground."""
    return np.asarray(np.abs(pixels - GROUND).max(axis=2) > 8)


def colour(pixels: NDArray[np.int16]) -> NDArray[np.float64]:
    return np.asarray(np.median(pixels[drawn(pixels)], axis=0))


def test_two_conditions_are_shown_side_by_side_in_their_own_colours(look: Look) -> None:
    left, right = look("left"), look("right")
    for pixels in (left, right):
        assert 0.05 < drawn(pixels).mean() < 0.8
    assert np.abs(colour(left) - small_models.RED).max() < 6
    assert np.abs(colour(right) - small_models.GREEN).max() < 6
    assert (drawn(left) != drawn(right)).mean() > 0.05


def test_splats_are_shown_beside_meshes_and_turn_with_them(page: Page, look: Look) -> None:
    page.get_by_label("Dataset").select_option("box")
    expect(page.locator("[data-side=right] [data-facts]")).to_have_text("200 splats", timeout=30_000)
    page.wait_for_function(SPLATS_ARE_DRAWN, timeout=30_000)
    splats = look("right")
    assert np.abs(colour(splats) - small_models.BLUE).max() < 12
    assert 0.05 < drawn(splats).mean() < 0.8
    middle = np.argwhere(drawn(splats)).mean(axis=0) / splats.shape[:2]
    assert np.abs(middle - 0.5).max() < 0.05  # where the mesh is, too
    page.locator("[data-side=left] canvas").focus()
    for _ in range(3):
        page.keyboard.press("+")
    page.wait_for_timeout(300)
    assert drawn(look("right")).mean() > 1.2 * drawn(splats).mean()


def test_both_turn_together_until_they_are_let_apart(page: Page, look: Look) -> None:
    page.get_by_label("Condition on the right").select_option("id_fa")
    expect(page.locator("[data-side=right] [data-facts]")).to_contain_text("12 triangles")
    front = look("left")
    assert np.abs(front - look("right")).max() < 40  # at most an edge that falls between two pixels
    canvas = page.locator("[data-side=left] canvas")
    canvas.hover()
    page.mouse.down()
    page.mouse.move(500, 300, steps=4)
    page.mouse.up()
    turned = look("left")
    assert (drawn(turned) != drawn(front)).mean() > 0.01
    assert (drawn(turned) != drawn(look("right"))).mean() < 0.001
    page.get_by_label("turn both together").uncheck()
    page.get_by_role("button", name="From the front").click()
    page.locator("[data-side=right] canvas").focus()
    for _ in range(6):
        page.keyboard.press("ArrowRight")
    assert (drawn(look("left")) != drawn(look("right"))).mean() > 0.01


def test_keys_turn_move_and_come_nearer(page: Page, look: Look) -> None:
    page.locator("[data-side=left] canvas").focus()
    seen = [look("left")]
    for key in ("ArrowRight", "ArrowUp", "+", "Shift+ArrowLeft"):
        for _ in range(3):
            page.keyboard.press(key)
        seen.append(look("left"))
        assert (drawn(seen[-1]) != drawn(seen[-2])).mean() > 0.003, key
    page.keyboard.press("Home")
    assert (drawn(look("left")) != drawn(seen[0])).mean() < 0.001


def test_errors_are_colours_blue_inside_and_red_outside(page: Page, look: Look) -> None:
    page.get_by_label("Colours").select_option("error")
    page.get_by_label("Distance of the full colour").fill("50")
    red, blue = colour(look("left")), colour(look("right"))
    assert red[0] > red[1] + 25
    assert blue[2] > blue[0] + 25
    before = red[0] - red[1]
    page.get_by_label("Distance of the full colour").fill("20")
    assert page.locator("output").text_content() == "± 1.0 mm"
    stronger = colour(look("left"))
    assert stronger[0] - stronger[1] > before


def test_a_scene_without_truth_offers_no_errors(page: Page, look: Look) -> None:
    page.get_by_label("Dataset").select_option("box")
    expect(page.locator("#models-form [value=error]")).to_be_disabled()
    page.get_by_label("Colours").select_option("shape")
    assert np.ptp(colour(look("left"))) < 30
    page.get_by_label("Dataset").select_option("ball")
    page.get_by_label("Show").select_option("cloud")
    expect(page.locator("[data-side=left] [data-facts]")).to_contain_text("8 points")
    assert drawn(look("left")).sum() > 0


def test_a_model_that_cannot_be_loaded_is_told_in_its_place_and_asked_for_again(page: Page) -> None:
    asked: list[Route] = []
    cut_short = b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n"
    page.route("**/*.ply", lambda route: asked.append(route))
    left, right = (page.locator(f"[data-side={side}]") for side in ("left", "right"))
    numbers = count(1)
    with page.expect_request(lambda request: request.url.endswith(".ply") and next(numbers) == 2):
        page.get_by_label("Show").select_option("cloud")
    expect(right).to_have_class("is-loading")
    page.get_by_label("Condition on the right").select_option("id_fa")
    page.evaluate(DRAWN)
    assert len(asked) == 2
    asked[1].fulfill(body=cut_short)  # of the cloud that nobody wants any more
    page.evaluate(DRAWN)
    expect(right).to_have_class("is-loading")
    expect(right.locator("[data-facts]")).to_be_empty()
    asked[0].fulfill(body=cut_short)
    for side in (left, right):
        expect(side.locator("[data-facts]")).to_have_text("could not be loaded; choose it again later")
        expect(side).not_to_have_class("is-loading")
    expect(page.locator("#models-fault")).to_be_hidden()
    page.unroute("**/*.ply")
    page.get_by_label("Condition on the right").select_option("pm_fb")
    expect(right.locator("[data-facts]")).to_contain_text("4 points")
    expect(left.locator("[data-facts]")).to_contain_text("8 points")


@pytest.mark.usefixtures("packages")
def test_a_browser_without_webgl_says_so(browser: Browser, server: str, settings: Settings, path: str) -> None:
    without = browser.browser_type.launch(executable_path=browser_path(), args=[*BROWSER_OPTIONS, "--disable-3d-apis"])
    page = without.new_page(base_url=server)
    sign_in(page, settings)
    page.goto(path)
    expect(page.get_by_role("alert")).to_contain_text("This browser shows no 3D")
    expect(page.locator("canvas").first).to_be_hidden()
    page.get_by_text("All models").click()
    expect(page.get_by_role("link", name="PLY").first).to_be_visible()
    without.close()

"""From a zipped recording to an open study in real Chromium, with a worker beside the server; no terminal."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from app.main import running_server
from app.operations.jobs.beside_server import worker_beside
from app.settings import Settings
from recon.studio import SynthParameters, synthesise
from tests.app.web.admin.dashboard_client import files_of, sign_in, zipped

pytestmark = [pytest.mark.browser, pytest.mark.slow]

VENDOR = Path(__file__).parents[4] / "static" / "vendor"
JOB_TIMEOUT_MS = 240_000  # a job of seconds takes a minute beside three other test processes
EXPECTED = ("net::ERR_FAILED", "GPU stall")  # the part that the test does not let through; 3D without a graphics card


@pytest.fixture
def own(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "server")


@pytest.fixture
def own_server(own: Settings) -> Iterator[str]:
    with running_server(own) as url, worker_beside(own, 1):
        yield url


@pytest.fixture
def page(browser: Browser, own_server: str) -> Iterator[Page]:
    """A page on which nothing may fail and no policy may be violated."""
    complaints: list[str] = []
    context = browser.new_context(base_url=own_server, viewport={"width": 1366, "height": 768})
    context.set_default_timeout(JOB_TIMEOUT_MS)
    page = context.new_page()
    page.on("console", lambda told: any(text in told.text for text in EXPECTED) or complaints.append(told.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page
    context.close()
    assert complaints == []


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """The zip file of a small synthetic capture."""
    parameters = SynthParameters(scene="sphere", n_sensors=2, n_frames=1, size=(160, 120))
    capture = synthesise(tmp_path / "sphere", parameters)
    path = tmp_path / "sphere.zip"
    path.write_bytes(zipped(files_of(capture.folder)))
    return path


def test_a_recording_becomes_a_study_without_a_terminal(page: Page, own: Settings, recording: Path) -> None:
    if not VENDOR.is_dir():
        pytest.skip("the browser packages are not installed; `make setup` does it where npm's registry is reachable")
    sign_in(page, own)
    upload(page, recording)
    draw(page)
    reconstruct(page)
    render(page)
    make_study(page)


def upload(page: Page, recording: Path) -> None:
    """Send the recording over a line that fails once."""
    page.get_by_role("link", name="Files").click()
    page.get_by_label("File", exact=True).set_input_files(recording)
    expect(page.get_by_label("Name on the server")).to_have_value("sphere")
    failed: list[str] = []

    def fail_once(route: Route) -> None:
        if route.request.method == "PATCH" and not failed:
            failed.append(route.request.url)
            route.abort()
        else:
            route.continue_()

    page.route("**/admin/files/upload/*", fail_once)
    page.get_by_role("button", name="Upload").click()
    expect(page.get_by_text("2 sensors, 1 frame")).to_be_visible()
    assert len(failed) == 1
    thumbnail = page.get_by_role("img", name="S2/right, frame 0")
    thumbnail.scroll_into_view_if_needed()
    expect(thumbnail).to_have_js_property("complete", True)
    assert thumbnail.evaluate("(image) => image.naturalWidth") == 160


def draw(page: Page) -> None:
    """Draw on the sphere and around it, by pointer and by keyboard, and see the mask."""
    page.get_by_role("link", name="Draw strokes for masks").click()
    canvas = page.locator("#drawing-strokes")
    expect(canvas).to_have_attribute("aria-label", "S1/left, frame 0, to draw on")  # the script is there
    canvas.focus()
    canvas.evaluate("(canvas) => canvas.scrollIntoView({behavior: 'instant'})")
    box = canvas.bounding_box()
    assert box
    lines = ([(0.45, 0.5), (0.55, 0.5)], [(0.05, 0.05), (0.95, 0.05), (0.95, 0.95), (0.05, 0.95), (0.05, 0.05)])
    for key, line in zip("fb", lines, strict=True):
        page.keyboard.press(key)
        places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in line]
        page.mouse.move(*places[0])
        page.mouse.down()
        for place in places[1:]:
            page.mouse.move(*place, steps=3)
        page.mouse.up()
    for key in ("e", "Space", "Space", "z"):  # erase in the middle, and take it back
        page.keyboard.press(key)
    expect(page.locator("#drawn-pictures")).to_contain_text("S1/left/0 2 strokes")
    expect(page.locator("#drawn-missing")).to_contain_text("missing: S1/right, S2/left, S2/right")
    page.keyboard.press("m")
    expect(page.locator("#drawing-state")).to_contain_text("The mask is blue")
    page.get_by_label("Camera").select_option("S1/right")
    expect(page.locator("#drawing-state")).to_be_empty()
    page.get_by_role("link", name="sphere").click()


def reconstruct(page: Page) -> None:
    page.get_by_role("link", name="Reconstruct").click()
    for method in ("id", "fa", "fb"):
        page.locator(f"[type=checkbox][value={method}]").check()
    page.get_by_role("spinbutton", name="Voxel").fill("20")
    page.get_by_role("button", name="Start the job").click()
    page.get_by_role("link", name="Look at the result").click()
    expect(
        page.get_by_text("reconstruction of sphere: 1 frame by id_fa_photographs, id_fb_photographs")
    ).to_be_visible()
    expect(page.locator(".pictures img").first).to_be_visible()


def render(page: Page) -> None:
    page.get_by_role("link", name="Render films").click()
    for name, value in (("size", "160x120"), ("fps", "10"), ("seconds", "0.4")):
        page.locator(f"[name={name}]").fill(value)
    page.get_by_role("button", name="Start the job").click()
    page.get_by_role("link", name="Make a study of it").click()


def make_study(page: Page) -> None:
    """Create a study of the set that was rendered, and open it."""
    assert page.locator("[name=stimulus_set]").first.input_value() == "sphere"
    page.get_by_label("Name shown to participants").fill("Spheres")
    page.get_by_role("button", name="Create").click()
    page.get_by_role("button", name="Open to participants").click()
    expect(page.get_by_role("button", name="Pause")).to_be_visible()

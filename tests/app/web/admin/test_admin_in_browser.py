"""The experimenter's pages in real Chromium: on a telephone, for everybody, under the strict policy."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route, expect

from app.settings import Settings
from app.simulation.participants import simulate
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.database.server_tasks import begin_task, end_task
from app.web.admin.participants.invitations_page import LONGEST_LABEL
from tests.app.web.admin.dashboard_client import sign_in

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True),  # pages look the same on the other
]

TELEPHONE = {"width": 390, "height": 844}


@pytest.fixture
def page(browser: Browser, server: str, settings: Settings) -> Iterator[Page]:
    """A signed-in experimenter's telephone; at the end the browser must not have complained."""
    complaints: list[str] = []
    page = browser.new_page(base_url=server, viewport=TELEPHONE)
    page.on("console", lambda message: complaints.append(message.text))
    sign_in(page, settings)
    yield page
    page.close()
    assert complaints == []


def test_a_telephone_at_night_in_tokyo(browser: Browser, server: str, settings: Settings) -> None:
    dark: dict[str, Any] = {"color_scheme": "dark", "timezone_id": "Asia/Tokyo"}
    page = browser.new_page(base_url=server, viewport=TELEPHONE, **dark)
    sign_in(page, settings, "Yuki Example")
    audit_log = page.get_by_role("link", name="Audit log")
    expect(audit_log).to_be_hidden()
    page.get_by_role("button", name="Menu").click()
    audit_log.click()
    first = page.locator("tbody time").first
    expect(first).not_to_contain_text("UTC")
    at = datetime.fromisoformat(str(first.get_attribute("datetime")))
    expect(first).to_have_text(at.astimezone(ZoneInfo("Asia/Tokyo")).strftime("%Y-%m-%d %H:%M"))
    assert page.evaluate("getComputedStyle(document.documentElement).backgroundColor") == "rgb(22, 25, 27)"
    page.goto("/admin/users")
    page.get_by_label("Name", exact=True).fill("Yuki Example")
    page.locator("label select[name=role]").select_option("viewer")
    page.get_by_role("button", name="Make a sign-in link").click()
    expect(page.get_by_role("alert")).to_contain_text("Yuki Example is here already.")
    expect(page.get_by_label("Name", exact=True)).to_have_value("Yuki Example")
    expect(page.locator("label select[name=role]")).to_have_value("viewer")
    page.goto("/s/nobody-invited")
    assert page.evaluate("getComputedStyle(document.documentElement).backgroundColor") != "rgb(22, 25, 27)"
    page.close()


FIRST_CONTENT = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
SOON_MS, MOST_LOOKS = 1000, 5  # the best of them: other work on this machine is not the page's
POLLED_EVERY_MS = 11_000  # the results, and a little more
READ_LEFT = "(element) => element.scrollLeft"


def test_there_is_something_to_see_within_a_second(page: Page, new_study: Callable[[], dict[str, Any]]) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    for path in ("/admin", base, f"{base}/results", f"{base}/participants", f"{base}/design"):
        times: list[float] = []
        while min(times, default=SOON_MS) >= SOON_MS:
            assert len(times) < MOST_LOOKS, (path, times)
            page.goto(path)
            page.locator("h1").wait_for()
            page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length")
            times.append(float(page.evaluate(FIRST_CONTENT)))


def test_a_double_click_makes_one_token_and_shows_it(page: Page) -> None:
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url) if request.method == "POST" else None)
    page.goto("/admin/tokens")
    page.get_by_label("Name of its user or purpose").fill("double")
    page.get_by_role("button", name="Make the token").dblclick()
    page.get_by_text("shown only once").wait_for()
    assert len(sent) == 1
    row = page.get_by_role("row", name="double")
    row.locator("summary").click()  # one click alone revokes nothing
    row.get_by_role("button", name="Revoke").click()
    page.get_by_text("revoked").first.wait_for()


def test_a_refused_form_is_filled_as_it_was_sent_and_shows_its_wrong_field(
    browser: Browser, server: str, settings: Settings, new_study: Callable[[], dict[str, Any]]
) -> None:
    page = browser.new_page(base_url=server)
    sign_in(page, settings)
    path = f"/admin/studies/{new_study()['slug']}"
    page.goto(f"{path}/invitations")
    page.locator("form[novalidate], form").evaluate_all("forms => forms.forEach((form) => (form.noValidate = true))")
    page.locator("[name=places]").fill("-3")
    page.locator("[name=number]").fill("2")
    page.locator("[name=label]").first.fill('A "new" <name>')
    page.locator("[name=places] >> xpath=ancestor::form").get_by_role("button").click()
    expect(page.get_by_role("alert")).to_contain_text("The form is not as expected: Participants each is '-3'")
    expect(page.locator("[name=places][aria-invalid=true]")).to_have_value("-3")
    expect(page.locator("[name=label]").first).to_have_value('A "new" <name>')
    expect(page.locator("#typed")).to_have_count(0)
    page.goto(f"{path}/edit")
    page.locator("form").evaluate_all("forms => forms.forEach((form) => (form.noValidate = true))")
    page.locator("details").evaluate_all("parts => parts.forEach((part) => (part.open = true))")
    page.locator("[name='privacy.keep_days']").fill("1.5")
    page.get_by_role("button", name="Save", exact=True).first.click()
    expect(page.get_by_role("alert")).to_contain_text("Nothing was changed: ")
    page.get_by_role("link", name="Show it").click()
    expect(page.locator("[name='privacy.keep_days'][aria-invalid=true]")).to_be_in_viewport()
    page.close()


def test_an_upload_that_a_proxy_refuses_says_so_and_may_be_tried_again(
    browser: Browser, server: str, settings: Settings
) -> None:
    page = browser.new_page(base_url=server)
    sign_in(page, settings)
    page.goto("/admin/sets")
    page.route("**/upload", lambda route: route.fulfill(status=413, content_type="text/html", body="<h1>413</h1>"))
    page.get_by_label("Zip file").set_input_files({"name": "set.zip", "mimeType": "application/zip", "buffer": b"PK"})
    page.get_by_role("button", name="Upload").click()
    page.get_by_text("The server refused this (413").wait_for()
    assert page.get_by_role("button", name="Upload").is_enabled()
    page.close()


def test_a_figure_whose_numbers_cannot_be_had_stays_the_picture_that_it_was(
    browser: Browser, server: str, settings: Settings, taken: dict[str, Any]
) -> None:
    page = browser.new_page(base_url=server, viewport={"width": 1366, "height": 3000})
    sign_in(page, settings)
    refused: list[str] = []

    def refuse_the_first(route: Route) -> None:
        refused.append(route.request.url)
        if route.request.url == refused[0]:
            route.fulfill(status=503, content_type="application/problem+json", body=json.dumps({"title": "Away"}))
        else:
            route.continue_()

    page.route("**/figures/*.vega*", refuse_the_first)
    with page.expect_request("**/figures/*.vega*"):
        page.goto(f"/admin/studies/{taken['slug']}/results")
    page.locator("#figures ~ details > summary").first.click()
    page.locator(".plot-ground svg").first.wait_for()
    figure = page.locator(f"figure[data-vega='{refused[0].removeprefix(server)}']")
    assert figure.locator("img").is_visible()
    page.close()


def test_pages_that_follow_a_study_lead_to_the_sign_in_when_another_tab_signs_out(
    browser: Browser, server: str, settings: Settings, study: dict[str, Any]
) -> None:
    with browser.new_context(base_url=server) as context:
        overview, results, other = (context.new_page() for _ in range(3))
        results.clock.install()
        sign_in(other, settings)
        base = f"/admin/studies/{study['slug']}"
        with overview.expect_response("**/live"):
            overview.goto(base)
        results.goto(f"{base}/results")
        other.get_by_role("button", name="Sign out").click()
        other.wait_for_url("/admin/sign-in")
        results.clock.fast_forward(POLLED_EVERY_MS)
        for page in (results, overview):
            page.get_by_role("heading", name="Sign in").wait_for()


def test_newer_results_leave_their_reader_where_they_are(
    browser: Browser, server: str, token: str, settings: Settings, new_study: Callable[[], dict[str, Any]]
) -> None:
    study = new_study()
    abilities = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}
    simulate(server, study["slug"], study["invitation"], token, 3, abilities)
    page = browser.new_page(base_url=server, viewport=TELEPHONE)
    page.clock.install()
    sign_in(page, settings)
    page.goto(f"/admin/studies/{study['slug']}/results")
    results = page.locator("#results")
    expect(results.locator("> p[role=status]")).to_have_count(0)
    page.locator("details:has(#triads) > summary").click()
    code = page.get_by_text("Code that draws it").first
    code.click()
    table = page.locator("#triads_rows")
    table.evaluate("(table) => { table.scrollIntoView(); table.scrollTo(60, 0); }")
    code.evaluate("(summary) => summary.focus({ preventScroll: true })")
    read_digest, read_top = "(part) => part.dataset.digest", "(table) => table.getBoundingClientRect().top"
    before, top, left = results.evaluate(read_digest), table.evaluate(read_top), table.evaluate(READ_LEFT)
    assert left > 0
    simulate(server, study["slug"], study["invitation"], token, 1, abilities)
    while results.evaluate(read_digest) == before:
        with page.expect_response("**/results?*"):
            page.clock.fast_forward(POLLED_EVERY_MS)
        page.wait_for_load_state("networkidle")
    assert table.evaluate(READ_LEFT) == left
    assert table.evaluate(read_top) == pytest.approx(top, abs=60), "a row more stands above"
    expect(code).to_be_focused()
    assert page.locator(".plot-code").first.evaluate("(code) => code.open")
    page.close()


def test_a_film_is_played_and_paused_by_one_button_which_tells_if_it_cannot(
    browser: Browser, server: str, settings: Settings, study: dict[str, Any]
) -> None:
    page = browser.new_page(base_url=server)
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    sign_in(page, settings)
    page.goto(f"/admin/studies/{study['slug']}/stimuli")
    button = page.locator("[data-play]").first
    button.click()
    expect(button).to_have_accessible_name("Pause id_fa")
    button.click()
    expect(button).to_have_accessible_name("Play id_fa")
    page.route("**/media/**", lambda route: route.fulfill(body=b"no film", content_type="video/mp4"))
    page.reload()
    button.click()
    expect(page.get_by_role("alert")).to_have_text("This browser could not play the film.")
    page.unroute("**/media/**")
    button.click()
    expect(button).to_have_accessible_name("Pause id_fa")
    expect(page.get_by_role("alert")).to_have_count(0)
    assert faults == []
    page.close()


def test_an_invitation_is_copied_by_its_button_and_printed_with_its_code(page: Page, study: dict[str, Any]) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.goto(f"/admin/studies/{study['slug']}/invitations")
    page.get_by_label("Label for you alone").fill("x" * LONGEST_LABEL)
    page.get_by_role("button", name="Make invitations").click()
    page.get_by_text("x" * LONGEST_LABEL).wait_for()
    page.wait_for_load_state()
    assert page.evaluate("document.documentElement.scrollWidth") <= TELEPHONE["width"]
    page.get_by_role("button", name="Copy").last.click()
    expect(page.get_by_role("button", name="Copied")).to_be_visible()
    assert page.evaluate("navigator.clipboard.readText()").endswith(f"/s/{study['invitation']}")
    page.goto(f"/admin/studies/{study['slug']}/invitations/print")
    assert page.locator(".card-qr svg").first.bounding_box() is not None
    assert page.evaluate("document.documentElement.scrollWidth") <= TELEPHONE["width"]
    page.evaluate("window.print = () => { document.title = 'printed'; }")
    page.get_by_role("button", name="Print").click()
    expect(page).to_have_title("printed")


def test_what_is_shown_once_is_copied_by_its_button(page: Page) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    for path, field, make in (
        ("/admin/tokens", "Name of its user or purpose", "Make the token"),
        ("/admin/users", "Name", "Make a sign-in link"),
    ):
        page.goto(path)
        page.get_by_label(field, exact=True).last.fill(f"Of {make}")
        page.get_by_role("button", name=make).click()
        page.get_by_role("button", name="Copy", exact=True).click()
        expect(page.get_by_role("button", name="Copied")).to_be_visible()
        assert page.evaluate("navigator.clipboard.readText()") == page.locator(".made code").inner_text()


def test_a_row_keeps_the_focus_while_its_keys_move_it_and_gives_it_on_when_deleted(
    page: Page, new_study: Callable[[], dict[str, Any]]
) -> None:
    page.goto(f"/admin/studies/{new_study()['slug']}/edit#section-questions")
    names = page.locator("#setting-questions [data-row] [name='questions.name']")
    add = page.locator("#setting-questions").get_by_role("button", name="Add a row")
    for name in ("one", "two", "three"):
        add.click()
        page.keyboard.type(name)
    read = "(fields) => fields.slice(-3).map((field) => field.value)"
    row = page.locator("#setting-questions [data-row]").last
    row.get_by_role("button", name="Up").focus()
    for _ in range(2):
        page.keyboard.press("Enter")
    assert names.evaluate_all(read) == ["three", "one", "two"]
    for _ in range(2):
        page.keyboard.press("Tab")  # over Down
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.value") == "one"


def test_a_page_is_printed_whole_and_without_what_leads_elsewhere(
    page: Page, new_study: Callable[[], dict[str, Any]]
) -> None:
    page.goto(f"/admin/studies/{new_study()['slug']}/edit")
    page.emulate_media(media="print")
    expect(page.get_by_role("navigation", name="Dashboard")).to_be_hidden()
    expect(page.get_by_text("Scale of ACR")).to_be_hidden()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    expect(page.get_by_text("Scale of ACR")).to_be_visible()
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    expect(page.get_by_text("Scale of ACR")).to_be_hidden()


PLOTS_ARE_THERE = """() => [...document.querySelectorAll(".plot")].every((plot) =>
    plot.querySelector(".plot-ground svg") ?? plot.querySelector("img").naturalWidth)"""
PRINTED_SIZES = """() => [...document.querySelectorAll(".plot")].map((plot) => {
    const picture = plot.querySelector(".plot-ground :is(img, svg)"), box = picture.getBoundingClientRect();
    const own = picture.naturalWidth ?? picture.width.baseVal.value;
    return [box.width, own, box.bottom <= plot.getBoundingClientRect().bottom];
})"""


def test_results_are_printed_with_whole_figures_each_named_once(
    page: Page, server: str, token: str, new_study: Callable[[], dict[str, Any]]
) -> None:
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 3, {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0})
    page.set_viewport_size({"width": 680, "height": 990})  # of A4
    page.goto(f"/admin/studies/{study['slug']}/results")
    expect(page.locator("#triads")).to_be_attached(timeout=60_000)
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.wait_for_function(PLOTS_ARE_THERE, timeout=60_000)
    sizes = page.evaluate(PRINTED_SIZES)
    assert len(sizes) > 3
    for drawn, own, is_inside in sizes:
        assert 0 < drawn <= own + 1, "no larger than it was drawn"
        assert is_inside
    expect(page.get_by_text("Response times of each participant.").filter(visible=True)).to_have_count(1)
    expect(page.locator("#data")).to_be_hidden()


def test_a_line_that_is_begun_by_keyboard_stays_on_its_frame(page: Page, settings: Settings) -> None:
    folder = settings.intake_dir / "captures" / "two_frames"
    sensor = {"id": "S1"} | {side: {"image": side + "{frame:04d}.png", "size": [64, 48]} for side in ("left", "right")}
    folder.mkdir(parents=True)
    (folder / "capture.json").write_text(json.dumps({"name": "two", "n_frames": 2, "fps": 25, "sensors": [sensor]}))
    for picture in ("left0000", "left0001", "right0000", "right0001"):
        cv2.imwrite(str(folder / f"{picture}.png"), np.zeros((48, 64), np.uint8))
    page.goto("/admin/files/captures/two_frames/strokes")
    page.get_by_label("S1/left, frame 0, to draw on").focus()
    for key in ("Space", "ArrowRight", "PageDown"):
        page.keyboard.press(key)
    expect(page.locator("#drawn-pictures")).to_contain_text("S1/left/0 1 stroke")
    expect(page.locator("#drawn-pictures")).not_to_contain_text("S1/left/1")
    expect(page.locator("#drawing-state")).to_contain_text("Kept.")


def test_a_tasks_page_waits_for_a_server_that_starts_anew_and_then_leads_to_what_was_made(
    browser: Browser, server: str, settings: Settings
) -> None:
    page = browser.new_page(base_url=server)
    sign_in(page, settings, "Ira Example")
    database = open_database(settings.url)
    task = begin_task(database, "Ira Example", "Making a study", utc_now(), "study waits").public_id
    page.goto(f"/admin/tasks/{task}")
    page.route("**/admin/tasks/*", lambda route: route.abort())
    for _ in range(2):  # it has looked, and looks again
        page.wait_for_event("requestfailed")
    expect(page.get_by_role("heading", name="Making a study")).to_be_visible()
    end_task(database, task, "/admin/account", utc_now())
    page.unroute("**/admin/tasks/*")
    page.wait_for_url("**/admin/account")
    page.close()
    database.dispose()


def test_films_without_folders_are_named_on_a_telephone_within_its_width(page: Page) -> None:
    page.goto("/admin/studies/new")
    names = ("park_middle.mp4", "park_sharp.mp4", "street_middle.mp4", "street_sharp.mp4")
    films = [{"name": name, "mimeType": "video/mp4", "buffer": b"film"} for name in names]
    page.get_by_label("Choose a zip file or films").set_input_files(films)
    expect(page.get_by_label("Condition of street_sharp.mp4")).to_have_value("sharp")
    assert page.evaluate("document.documentElement.scrollWidth") <= TELEPHONE["width"]

"""Every page of the dashboard in real Chromium: axe finds nothing, it fits a telephone, and it is light."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pyotp
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, ViewportSize

from app.main import running_server
from app.operations.studies import manage
from app.operations.studies.create import create_study
from app.settings import Settings
from app.simulation.participants import begin, next_trial, simulate
from app.study.options.own_texts import LONGEST_NAME
from tests.app.web.admin.dashboard_client import PASSWORD, sign_in
from tests.conftest import BROWSER_TIMEOUT_MS

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.usefixtures("new_database_url"),
    pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True),  # pages look the same on the other
]

TELEPHONE: ViewportSize = {"width": 390, "height": 844}
LAPTOP: ViewportSize = {"width": 1366, "height": 768}
NARROWEST = 320  # WCAG 1.4.10: a window of 1280 pixels at a zoom of 400 %
WIDTH = "document.documentElement.scrollWidth"
OPENED = "document.querySelectorAll('details').forEach((part) => (part.open = true))"
UNCHECKED = "document.querySelectorAll('form').forEach((form) => (form.noValidate = true))"


STUDY_PAGES = (
    "",
    "/results",
    "/results/groups",
    "/objective",
    "/objective/scores",
    "/models",
    "/participants",
    "/participants/P001",
    "/participants/comments",
    "/participants/demographics",
    "/votes",
    "/design",
    "/stimuli",
    "/invitations",
    "/edit",
)
NEW_STUDY = "/studies/new?stimulus_set=tiny&preset=paper"
PAGES = (
    "",
    "/studies/new",
    "/manual/recruiting",
    NEW_STUDY,
    "/sets",
    "/sets/tiny",
    "/work",
    "/work/new/reconstruct",
    "/users",
    "/tokens",
    "/audit",
    "/settings",
    "/account",
)
LARGEST_PAGE = 500_000  # bytes of document, styles and scripts, before figures, films and models
WEIGHT = """[...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
    .filter((entry) => ["navigation", "link", "script"].includes(entry.initiatorType) && !entry.name.includes("/vega"))
    .reduce((sum, entry) => sum + entry.decodedBodySize, 0)"""


def page_at(browser: Browser, server: str) -> Page:
    page = browser.new_page(base_url=server, reduced_motion="reduce")  # colours are judged at rest
    page.set_default_timeout(BROWSER_TIMEOUT_MS)
    return page


def is_accessible(page: Page, *, narrowest: int = TELEPHONE["width"]) -> None:
    """Look at a page with everything opened: by night on a telephone, by day on a laptop."""
    page.locator("h1").wait_for()
    page.wait_for_load_state()  # words can be there before their styles
    page.set_viewport_size({**TELEPHONE, "width": narrowest})
    assert page.evaluate(WIDTH) <= narrowest, page.url
    page.evaluate(OPENED)
    for window, is_dark in ((TELEPHONE, True), (LAPTOP, False)):
        page.set_viewport_size(window)
        page.emulate_media(color_scheme="dark" if is_dark else "light")
        assert page.evaluate(WIDTH) <= window["width"], page.url
        found = Axe().run(page)
        assert found.violations_count == 0, f"{page.url}, {is_dark=}: {found.generate_report()}"


def test_every_page_fits_a_telephone_is_accessible_and_light(
    browser: Browser, server: str, token: str, settings: Settings, new_study: Callable[[], dict[str, Any]]
) -> None:
    study = new_study()
    long_word = f"/admin/studies/{manage.copy_study(settings, study['slug'], 'x' * LONGEST_NAME)['study']}"
    abilities = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}
    simulate(server, study["slug"], study["invitation"], token, 3, abilities)
    base = f"/admin/studies/{study['slug']}"
    trial = httpx.get(
        f"{server}/api/v1/studies/{study['slug']}/trials", headers={"Authorization": f"Bearer {token}"}
    ).json()[0]["trial"]
    paths = [*(f"/admin{path}" for path in PAGES), *(base + path for path in STUDY_PAGES), f"{base}/votes/{trial}"]
    paths += [f"{base}/invitations/print", *(f"{long_word}/{tab}" for tab in ("texts", "edit"))]
    narrow = [f"{base}{place}" for place in (*STUDY_PAGES, "/invitations/print")]
    complaints: list[str] = []
    page = page_at(browser, server)
    page.on("console", lambda message: complaints.append(message.text))
    sign_in(page, settings)
    for path in paths:
        page.goto(path)
        is_accessible(page, narrowest=NARROWEST if path in narrow else TELEPHONE["width"])
        assert page.evaluate(WEIGHT) < LARGEST_PAGE, path
    page.close()
    assert complaints == []


def test_pages_without_content_are_accessible_too(browser: Browser, tmp_path: Path, stimulus_set: Path) -> None:
    own = Settings(data_dir=tmp_path / "server")
    with running_server(own) as url:
        page = page_at(browser, url)
        for path in (manage.set_up_path(own), "/admin/sign-in", manage.add_experimenter(own, "Ann")["path"]):
            page.goto(str(path))
            is_accessible(page)
        sign_in(page, own)
        for path in ("", "/studies/new", "/sets", "/files", "/work", "/users", "/tokens", "/audit", "/account"):
            page.goto(f"/admin{path}")
            is_accessible(page)
        study = create_study(own, stimulus_set, "Nobody came", exposure_s=0.4)
        for path in STUDY_PAGES:
            if "P001" not in path:
                page.goto(f"/admin/studies/{study['slug']}{path}")
                is_accessible(page)
        page.close()


REFUSED: tuple[tuple[str, dict[str, str], str], ...] = (  # page, what is typed, button
    ("/studies/new?stimulus_set=tiny", {"name": ""}, "Create"),
    ("{study}/edit", {"privacy.keep_days": "1.5"}, "Save"),
    ("{study}/invitations", {"places": "-3"}, "Make invitations"),
    ("/users", {"name": "Dora Example"}, "Make a sign-in link"),
    ("/account", {"password": "short"}, "Save"),
    ("/work/new/import-films", {}, "Start the job"),
)


def test_refusals_alarms_and_what_is_shown_once_are_accessible_too(
    browser: Browser, server: str, settings: Settings, new_study: Callable[[], dict[str, Any]]
) -> None:
    study = new_study()
    page = page_at(browser, server)
    page.goto("/admin/login/spent")
    is_accessible(page)
    page.goto("/admin/sign-in")
    page.get_by_label("Name").fill("Nobody")
    page.locator("[type=password]").fill(PASSWORD)
    is_refused(page, "Sign in")
    sign_in(page, settings)
    for path in ("/admin/nothing", "/admin/studies/nothing", "/admin/work/0", "/admin/sets/nothing"):
        page.goto(path)
        is_accessible(page)
    for path, typed, button in REFUSED:
        page.goto("/admin" + path.format(study=f"/studies/{study['slug']}"))
        page.evaluate(OPENED)
        page.evaluate(UNCHECKED)
        for name, text in typed.items():
            page.locator(f"[name='{name}']:visible").first.fill(text)
        is_refused(page, button)
    page.goto("/admin/tokens")
    page.get_by_label("Name of its user or purpose").fill("axe")
    page.get_by_role("button", name="Make the token").click()
    page.get_by_text("shown only once").wait_for()
    is_accessible(page)
    with httpx.Client(base_url=server, timeout=30) as client:
        client.headers["Authorization"] = f"Bearer {begin(client, study['slug'], study['invitation'])['token']}"
        trial = next_trial(client, client.headers["Authorization"].split()[1])
        assert trial is not None
        client.put(f"/api/v1/session/trials/{trial['trial']}/trouble", json={"why": "broken"}).raise_for_status()
    page.goto(f"/admin/studies/{study['slug']}")
    page.get_by_text("could not be shown").first.wait_for()
    is_accessible(page)
    turns_second_factor_on(page)
    is_accessible(page)
    page.close()


def is_refused(page: Page, button: str) -> None:
    with page.expect_navigation():
        page.get_by_role("button", name=button, exact=True).first.click()
    page.get_by_role("alert").first.wait_for()
    is_accessible(page)


def turns_second_factor_on(page: Page) -> None:
    """Choose a password, and set up a second factor: the recovery codes are shown."""
    page.goto("/admin/account")
    page.get_by_label("New password", exact=False).first.fill(PASSWORD)
    page.get_by_label("The new password again").fill(PASSWORD)
    page.get_by_role("button", name="Save").click()
    page.get_by_role("button", name="Set up").click()
    code = page.get_by_label("Code", exact=True)
    code.wait_for()
    is_accessible(page)
    code.fill(pyotp.TOTP(str(page.locator("p > code").text_content())).now())
    page.get_by_label("Your password").first.fill(PASSWORD)
    page.get_by_role("button", name="Turn on").click()
    page.get_by_text("recovery code").first.wait_for()


def test_the_shelves_of_recordings_and_tables_are_accessible(browser: Browser, server: str, settings: Settings) -> None:
    folder, tables = settings.intake_dir / "captures" / "axe", settings.intake_dir / "votes"
    sensor = {"id": "S1"} | {side: {"image": side + "{frame:04d}.png", "size": [64, 48]} for side in ("left", "right")}
    for made in (folder, tables):
        made.mkdir(parents=True, exist_ok=True)
    (folder / "capture.json").write_text(json.dumps({"name": "axe", "n_frames": 1, "fps": 25, "sensors": [sensor]}))
    for side in ("left", "right"):
        cv2.imwrite(str(folder / f"{side}0000.png"), np.zeros((48, 64), np.uint8))
    (tables / "axe.csv").write_text("judge,scene,item_a,item_b,choice\nP1,ball,x,y,a\nP2,ball,x,y,b\n")
    (tables / "axe_wrong.csv").write_text("judge,scene,item_a,item_b,choice\nP1,ball,x,y,lft\n")
    page = page_at(browser, server)
    sign_in(page, settings)
    captures, votes = "/admin/files/captures/axe", "/admin/files/votes/axe"
    for path in (captures, f"{captures}/strokes", f"{votes}.csv", f"{votes}.csv/reading", f"{votes}_wrong.csv/reading"):
        page.goto(path)
        is_accessible(page)
    page.close()

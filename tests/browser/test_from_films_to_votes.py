"""From an empty server and a zip of films to people of a platform who were paid, and the alarm of a film that fails."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from time import monotonic

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, Route, expect

from app.main import running_server
from app.settings import Settings
from tests.app.tiny_stimuli import encode, flat
from tests.app.web.admin.dashboard_client import sign_in
from tests.browser.study_visitor import Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PLATFORM = "https://app.prolific.com"
MOST_CLICKS, MOST_PAGES = 8, 3
N_PEOPLE = 10  # the last of whom meets the broken film
ALARM_WITHIN_S = 60  # a page that asks for nothing new shows none at all


class Hand:
    """Clicks and counts, and notes on which pages of the dashboard."""

    def __init__(self, page: Page) -> None:
        self.page, self.n_clicks = page, 0
        self.headings: set[str] = set()

    def clicks(self, target: Locator) -> None:
        if "/admin" in self.page.url:
            self.headings.add(self.page.locator("h1").first.text_content() or "")
        self.n_clicks += 1
        target.click()


@pytest.fixture
def empty(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "server")


@pytest.fixture
def empty_server(empty: Settings) -> Iterator[str]:
    with running_server(empty) as url:
        yield url


def zip_of_films(folder: Path) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for condition, colour in (("sharp", "0x909090"), ("soft", "0x606060")):
            encode(folder / f"{condition}.mp4", flat(colour))
            archive.write(folder / f"{condition}.mp4", f"street/{condition}.mp4")
    return content.getvalue()


def test_a_zip_of_films_becomes_a_study_whose_people_are_paid_and_whose_broken_film_is_seen_at_once(
    browser: Browser, empty_server: str, empty: Settings, tmp_path: Path
) -> None:
    page = browser.new_page(base_url=empty_server, viewport={"width": 1366, "height": 768})
    sign_in(page, empty)
    link = makes_a_study(Hand(page), zip_of_films(tmp_path))
    query = {"PROLIFIC_PID": "person-{}", "STUDY_ID": "study", "SESSION_ID": "session"}
    for name, value in query.items():
        link = link.replace(f"{{{{%{name}%}}}}", value)
    for number in range(1, N_PEOPLE):
        with browser.new_context(viewport={"width": 960, "height": 540}) as context:
            context.set_default_timeout(60_000)
            came_back = takes_part(context, link.format(number))
        assert came_back == f"{PLATFORM}/submissions/complete?cc=PAID-1"
    with browser.new_context(viewport={"width": 960, "height": 540}) as context:
        meets_the_broken_film(context, link.format(N_PEOPLE))
        failed_s = monotonic()
        alarm = page.get_by_role("alert").filter(has_text="street")
        alarm.wait_for(timeout=1000 * ALARM_WITHIN_S)  # on the page that is open, without loading it again
        assert monotonic() - failed_s < ALARM_WITHIN_S
        assert "the film is none that the browser plays" in alarm.inner_text()
        expect(page.get_by_role("button", name="Seen: end the alarm")).to_be_visible()
    page.close()


def makes_a_study(hand: Hand, films: bytes) -> str:
    """From the empty list of studies to the open study; return the link that the platform is given."""
    page = hand.page
    hand.clicks(page.get_by_role("link", name="New study"))
    with page.expect_file_chooser() as chooser:
        hand.clicks(page.get_by_text("Choose a zip file or films"))
    chooser.value.set_files({"name": "films.zip", "mimeType": "application/zip", "buffer": films})
    expect(page.get_by_text("1 scene in 2 conditions")).to_be_visible()
    hand.clicks(page.get_by_role("radio", name="Prolific"))
    expect(page.locator("[name=platform]")).to_have_value("prolific", timeout=30_000)
    code = page.get_by_label("Code of a completed study")
    code.press_sequentially("PAID-1")
    page.get_by_label("Code when a film cannot be shown").press_sequentially("BROKEN-2")
    page.get_by_label("Name shown to participants").press_sequentially("Which is better")
    page.get_by_role("searchbox", name="Find a setting").fill("both must")
    brief = ("screening", "practice", "interview", "Both must be seen")  # by keyboard: this test's people have no time
    for name in brief:
        page.get_by_role("checkbox", name=name).press("Space")
    expect(page.locator("#plan")).to_contain_text("3 pairs and needs about")
    expect(page.locator("#plan")).to_contain_text("how people judge the quality of films")
    assert "three-dimensional" not in page.locator("#plan").inner_text()
    assert not re.search(r"`|reconstudy [a-z]", page.locator("main").inner_text())
    hand.clicks(page.get_by_role("button", name="Create"))
    page.wait_for_url("**/admin/studies/which-is-better")
    hand.clicks(page.get_by_role("button", name="Play one pair"))
    Visitor(page).is_in("voting")  # nobody is welcomed back to what was never begun
    hand.clicks(page.get_by_role("button", name="Leave the preview"))
    page.wait_for_url("**/admin/studies/which-is-better")
    hand.clicks(page.get_by_role("button", name="Open to participants"))
    link = page.locator(".note code").first.text_content() or ""
    assert hand.n_clicks <= MOST_CLICKS
    assert len(hand.headings) <= MOST_PAGES
    return link


def takes_part(context: BrowserContext, link: str) -> str:
    """Somebody who plays every film and goes back to the platform; return the address there."""
    received: list[str] = []

    def welcome(route: Route) -> None:
        received.append(route.request.url)
        route.fulfill(body="<h1>Welcome back</h1>", content_type="text/html")

    context.route(f"{PLATFORM}/**", welcome)
    page = context.new_page()
    visitor = Visitor(page)
    page.goto(link)
    reads_and_agrees(visitor)
    for _ in range(3):
        visitor.votes("1")
    visitor.sees("thanks")
    page.keyboard.press("Enter")  # the button that leads back
    page.wait_for_url(f"{PLATFORM}/**")
    return received[-1]


def reads_and_agrees(visitor: Visitor) -> None:
    page = visitor.page
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    page.mouse.wheel(0, 10_000)  # to its end
    page.get_by_label("I have read this").check()
    page.keyboard.press("Enter")
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        page.keyboard.press("Enter")
    visitor.sees("comprehension")
    page.get_by_label("I switch between").check()
    page.keyboard.press("Enter")


def meets_the_broken_film(context: BrowserContext, link: str) -> None:
    context.route("**/media/*", lambda route: route.fulfill(body=b"no film", content_type="video/mp4"))
    page = context.new_page()
    page.goto(link)
    reads_and_agrees(Visitor(page))
    Visitor(page).sees("problem")

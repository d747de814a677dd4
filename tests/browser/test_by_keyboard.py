"""A whole study by keyboard alone, and what a screen reader is told on the way, written down in whole_study.yml."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, Route, expect

from app.study.options.options import parse_options
from tests.browser.study_visitor import NewStudy, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

WRITTEN_DOWN = Path(__file__).with_name("whole_study.yml")
OPTIONS = {
    "optional_stages": ["interview"],
    "consent": "We show short films.\n\n" * 12,
    "comprehension": True,
    "questions": [{"name": "age", "kind": "number", "required": True}, {"name": "criteria", "kind": "text"}],
}
MOST_TABS = 30
CHANGES = re.compile(r'(?<=Study )\d+|(?<="Display: )[^"]+')  # the number of a test's study, the machine's load


def tabs_to(page: Page, selector: str) -> None:
    for _ in range(MOST_TABS):
        if page.evaluate("(selector) => document.activeElement.matches(selector)", selector):
            return
        page.keyboard.press("Tab")
        Visitor(page).watches(2)  # what is scrolled into view may be ticked then
    raise AssertionError(f"{selector} is not reached by Tab")


def test_a_whole_study_is_taken_by_keyboard_and_each_page_tells_a_screen_reader_what_it_shows(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options(OPTIONS))
    page.goto(study.address)
    told: list[str] = []

    def is_told(view: str) -> None:
        visitor.sees(view)
        tree = page.locator("main").aria_snapshot()
        code = page.locator("[data-fill='{resume_code}']").first.text_content() or "no code yet"
        tree = tree.replace(study.invitation, "…").replace(code, "…")
        told.append(CHANGES.sub("…", f"# {page.title()}\n{tree}\n"))

    def goes_on(view: str) -> None:
        tabs_to(page, f"[data-view={view}] .foot .button-primary, [data-view={view}] .next")
        page.keyboard.press("Enter")

    expect(page.locator("[data-check=refresh]")).not_to_have_class("is-unknown")
    is_told("welcome")
    goes_on("welcome")
    is_told("consent")
    tabs_to(page, "[name=agreed]")
    page.keyboard.press("Space")
    goes_on("consent")
    is_told("instructions-1")
    goes_on("instructions-1")
    visitor.sees("instructions-2")
    tabs_to(page, "#try")
    page.keyboard.press("Space")
    is_told("instructions-2")
    goes_on("instructions-2")
    is_told("instructions-3")
    goes_on("instructions-3")
    visitor.sees("comprehension")
    tabs_to(page, "[name=understood]")
    page.keyboard.press("ArrowDown")
    if not page.get_by_label("I switch between").is_checked():
        page.keyboard.press("ArrowDown")
    is_told("comprehension")
    goes_on("comprehension")
    for number in range(3):
        visitor.is_in("voting")
        tabs_to(page, "[name=choice]")
        page.keyboard.press("Space")
        if number == 0:
            is_told("trial")
        goes_on("trial")
    is_told("interview")
    tabs_to(page, "#question-age")
    page.keyboard.type("30")
    goes_on("interview")
    is_told("thanks")
    assert [vote["choice"] for vote in study.votes(3)] == ["a"] * 3
    assert "".join(told) == WRITTEN_DOWN.read_text(encoding="utf-8")


def test_single_keys_can_be_switched_off(new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor) -> None:
    page.goto(new_study(short_films, 0.4).address)
    for view in ("welcome", "instructions-1", "instructions-2"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.sees("instructions-3")
    page.get_by_label("Single keys").uncheck()
    page.locator("[data-view=instructions-3] [data-primary]").click()
    visitor.is_in("voting")
    page.keyboard.press("1")
    expect(page.locator("#trial input:checked")).to_have_count(0)


def test_a_slider_says_that_it_is_not_set_and_then_the_grade(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    options = parse_options({"protocol": "ACR", "scale": "slider"})
    page.goto(new_study(short_films, 0.4, options).address)
    for view in ("welcome", "instructions-1", "instructions-2"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.is_in("voting")
    slider = page.get_by_role("slider")
    expect(slider).to_have_attribute("aria-valuetext", "not set yet")
    expect(slider).to_have_accessible_description("Bad Poor Fair Good Excellent")
    page.keyboard.press("End")
    expect(slider).to_have_attribute("aria-valuetext", "100, Excellent")


def test_an_eye_test_asks_for_room_where_a_zoomed_page_has_none(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    """320 x 256 is a window of 1280 x 1024 at a zoom of 400 %."""
    options = parse_options({"optional_stages": ["screening"], "screening": {"tests": ["colour"]}})
    visitor.begin(new_study(short_films, 0.4, options))
    visitor.sees("screening")
    page.set_viewport_size({"width": 320, "height": 256})
    assert page.evaluate("document.documentElement.scrollWidth") == 320
    page.keyboard.press("Enter")
    visitor.sees("plates-intro")
    page.keyboard.press("Enter")
    visitor.sees("no-room")
    page.keyboard.press("ArrowUp")
    page.set_viewport_size({"width": 960, "height": 540})
    visitor.sees("plates")
    expect(page.get_by_text("Disc 1 of 18 at most")).to_be_visible()


def test_a_window_made_larger_while_the_picture_is_on_its_way_goes_on_with_the_eye_test(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    options = parse_options({"optional_stages": ["screening"], "screening": {"tests": ["colour"]}})
    visitor.begin(new_study(short_films, 0.4, options))
    visitor.sees("screening")
    on_their_way: list[Route] = []
    page.route("**/screening/colour/*.png", lambda route: on_their_way.append(route))
    page.set_viewport_size({"width": 320, "height": 256})
    page.keyboard.press("Enter")
    visitor.sees("plates-intro")
    with page.expect_request("**/screening/colour/*.png"):
        page.keyboard.press("Enter")
    visitor.sees("no-room")
    page.set_viewport_size({"width": 960, "height": 540})
    visitor.sees("plates")
    for picture in on_their_way:
        picture.continue_()
    expect(page.locator("#plate")).to_be_visible()

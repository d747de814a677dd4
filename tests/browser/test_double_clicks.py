"""People double-click, and press again before the page has answered: no view is skipped, nothing is sent twice."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from app.study.options.options import parse_options
from tests.browser.screening_answers import DRAWN, fits_card, pictures, shows
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

OPTIONS = {
    "optional_stages": ["screening", "practice", "interview"],
    "consent": "We compare models.",
    "comprehension": True,
}
N_TRIALS = 3
MIDDLE_ANSWER = (480, 260)  # pixels of the window
PICTURES_BETWEEN_CLICKS = 8  # 130 ms
SETTLING_MS = 400  # see static/js/settling.js
LONGER_THAN_SETTLING_MS = 600
SHOWN = """new MutationObserver(() => {
  const { showing } = document.getElementById("study").dataset;
  if (showing !== seen.at(-1)) seen.push(showing);
})"""
FOLLOW = f"window.seen = []; {SHOWN}.observe(document, {{ subtree: true, attributeFilter: ['data-showing'] }});"
HOLD = f"""const soon = window.setTimeout;
window.setTimeout = (then, ms, ...values) => {{
  const due = () => (window.isPressing ? soon(due, 20) : then(...values));
  return soon(ms === {SETTLING_MS} ? due : () => then(...values), ms);
}};"""
WAY = [
    *("welcome", "consent", "instructions-1", "instructions-2", "instructions-3", "comprehension"),
    *("screening", "card", "distance", "rings-intro", "rings", "plates-intro", "plates", "seat"),
]


@pytest.fixture(autouse=True)
def _never_late(page: Page) -> None:
    """Lets no view settle before a double click is over: on a busy machine the second press may come a second later."""
    page.add_init_script(HOLD)


@contextmanager
def pressing(page: Page) -> Iterator[None]:
    page.evaluate("window.isPressing = true")
    yield
    page.evaluate("window.isPressing = false")


def double_click(visitor: Visitor, button: Locator) -> None:
    """As slowly as people do, so that another view may have come before the second click."""
    with pressing(visitor.page):
        button.click()
        visitor.watches(PICTURES_BETWEEN_CLICKS)
        visitor.page.mouse.down()
        visitor.page.mouse.up()


def clicks_until_the_vote(visitor: Visitor) -> None:
    """Goes on pressing where an answer will stand, and once more when it stands there."""
    page = visitor.page
    with pressing(page):
        while page.locator("#trial").get_attribute("data-state") != "voting":
            page.mouse.click(*MIDDLE_ANSWER)
            visitor.watches(PICTURES_BETWEEN_CLICKS)
    answer = page.locator(".choice").nth(1).bounding_box()
    assert answer is not None
    for coordinate, start, length in zip(MIDDLE_ANSWER, ("x", "y"), ("width", "height"), strict=True):
        assert answer[start] < coordinate < answer[start] + answer[length]
    visitor.is_in("voting")


def test_a_double_click_on_every_button_goes_one_step_at_a_time(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options(OPTIONS))
    page.add_init_script(FOLLOW)
    page.goto(study.address)

    def double_clicks(view: str) -> None:
        visitor.sees(view)
        double_click(visitor, page.locator(f"[data-view={view}] .button-primary"))

    double_clicks("welcome")
    visitor.sees("consent")
    page.get_by_label("I have read this").check()
    double_clicks("consent")
    for number in (1, 2, 3):
        double_clicks(f"instructions-{number}")
    visitor.sees("comprehension")
    page.get_by_label("I switch between").check()
    double_clicks("comprehension")
    double_clicks("screening")
    for number in (1, 2):
        shows(page, f"{number} of 2")
        for key in ("Home", "PageUp", "PageUp"):
            page.get_by_label("Width of the drawn card").press(key)
        double_clicks("card")
    visitor.sees("distance")
    page.locator("#distance-cm").fill("250")
    double_clicks("distance")
    double_clicks("rings-intro")
    for _ in pictures(page, "rings", "Ring"):
        page.wait_for_function(DRAWN)
        double_click(visitor, page.locator("[data-view=rings] [data-direction='0']"))
    double_clicks("plates-intro")
    for _ in pictures(page, "plates", "Disc"):
        expect(page.locator("#plate")).to_be_visible()
        visitor.is_settled()
        double_click(visitor, page.locator("[data-view=plates] [data-direction='0']"))
    double_clicks("seat")
    double_clicks("practice")
    visitor.practises()
    double_clicks("practice-done")
    for _ in range(N_TRIALS):
        clicks_until_the_vote(visitor)
        expect(page.locator("input[name=choice]:checked")).to_have_count(0)
        double_click(visitor, page.locator(".choice").first)
        double_click(visitor, page.locator("#trial .voting .next"))
    visitor.sees("interview")
    expect(page.locator("#questionnaire input:checked")).to_have_count(0)
    double_clicks("interview")
    visitor.sees("thanks")
    seen = page.evaluate("seen")
    while "practice-again" in seen:  # a busy machine missed an exposure
        at = seen.index("practice-again")
        del seen[at : at + 2]
    assert seen == [*WAY, "practice", "trial", "practice-done", "trial", "interview", "thanks"]
    assert [len(study.read(table)) for table in ("votes", "screening")] == [N_TRIALS, 2]


def test_a_double_click_on_no_card_asks_and_the_test_can_still_be_taken(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options({"optional_stages": ["screening"]}))
    visitor.begin(study)
    visitor.sees("screening")
    page.keyboard.press("Enter")
    visitor.sees("card")
    double_click(visitor, page.locator("#no-card"))
    expect(page.locator("#without-card")).to_be_visible()
    visitor.is_settled()
    double_click(visitor, page.locator("#without-card .button-primary"))
    expect(page.locator("#without-card")).to_be_hidden()
    assert study.read("screening") == []
    fits_card(visitor)
    visitor.sees("distance")


def test_a_press_that_began_before_a_view_came_does_not_count_on_it(study: Study, page: Page, visitor: Visitor) -> None:
    page.goto(study.address)
    visitor.sees("welcome")
    page.locator("#begin").hover()
    page.keyboard.press("Enter")
    page.mouse.down()
    page.locator("[data-view=instructions-1]").wait_for()
    page.wait_for_timeout(LONGER_THAN_SETTLING_MS)
    assert page.evaluate("'settling' in document.documentElement.dataset")
    page.mouse.up()
    visitor.sees("instructions-1")

"""On a slow line people press again: a second press does nothing, and none leaves the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Page, Route, expect

from app.study.options.options import parse_options
from tests.browser.screening_answers import fits_card, types_distance
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = pytest.mark.browser

N_PICTURES = 9  # until what a press sets off is seen


@contextmanager
def held(visitor: Visitor, address: str) -> Iterator[None]:
    """Hold the requests to an address on their way; at the end of the block the only one goes on."""
    waiting: list[Route] = []
    page = visitor.page
    page.route(address, lambda route: waiting.append(route))
    with page.expect_request(address):
        yield
    visitor.watches(N_PICTURES)
    (only,) = waiting
    only.continue_()
    page.unroute(address)


def presses_twice(visitor: Visitor, address: str, press: Callable[[], None]) -> None:
    with held(visitor, address):
        press()
        visitor.watches(N_PICTURES)
        press()


def test_a_second_press_begins_no_part_of_the_way_again(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    asked: Counter[str] = Counter()
    page.on("request", lambda request: asked.update([request.url.partition("/session/")[2]]))
    options = parse_options({"optional_stages": ["practice", "interview"], "comprehension": True})
    study = new_study(short_films, 0.8, options)
    visitor.begin(study)
    visitor.sees("comprehension")
    page.get_by_label("I switch between").check()
    presses_twice(visitor, "**/comprehension", lambda: page.keyboard.press("Enter"))
    visitor.sees("practice")
    presses_twice(visitor, "**/session/practice", page.get_by_role("button", name="Practise").click)
    visitor.practises()
    presses_twice(visitor, "**/stages/practice", lambda: page.keyboard.press("Enter"))
    for number in (1, 2, 3):
        visitor.votes(str(number))
        visitor.is_in("exposure") if number < 3 else visitor.sees("interview")
    presses_twice(visitor, "**/stages/interview", page.get_by_role("button", name="Finish").click)
    visitor.sees("thanks")
    once = ("comprehension", "stages/introduction", "stages/practice", "stages/interview")
    assert [asked[one] for one in once] == [1] * len(once)
    assert asked["practice"] == 2  # the first time to fetch its films ahead
    assert asked["trials/next"] == 4  # and that none is left
    assert [vote["choice"] for vote in study.read("votes")] == ["a", "none", "b"]


def enters_screening(visitor: Visitor, new_study: NewStudy, films: Path) -> None:
    """As far as the distance."""
    options = {"optional_stages": ["screening"], "screening": {"tests": ["acuity"]}}
    visitor.begin(new_study(films, 0.4, parse_options(options)))
    visitor.sees("screening")
    visitor.page.keyboard.press("Enter")
    fits_card(visitor)


def test_a_second_enter_in_the_field_of_a_distance_stays_on_the_page(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    enters_screening(visitor, new_study, short_films)
    for view, distance_cm in (("distance", 60), ("step-back", 250)):
        with held(visitor, "**/screening/distance"):
            types_distance(visitor, view, distance_cm)
            visitor.watches(N_PICTURES)
            page.keyboard.press("Enter")
    visitor.sees("rings-intro")


def test_a_new_distance_that_was_entered_counts_though_somebody_then_says_that_they_stay(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    enters_screening(visitor, new_study, short_films)
    types_distance(visitor, "distance", 60)
    with held(visitor, "**/screening/distance"):
        types_distance(visitor, "step-back", 250)
        page.get_by_role("button", name="I cannot move back").click()
    visitor.sees("rings-intro")
    expect(page.get_by_text("about 250 cm from the display")).to_be_visible()


def test_what_was_on_its_way_when_somebody_withdrew_leads_nowhere(study: Study, page: Page, visitor: Visitor) -> None:
    page.goto(study.address)
    for view in ("welcome", "instructions-1", "instructions-2"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.sees("instructions-3")
    with held(visitor, "**/session/withdrawal"):
        with held(visitor, "**/stages/introduction"):
            page.keyboard.press("Enter")
            page.get_by_role("button", name="Withdraw").click()
            page.get_by_role("button", name="Yes, withdraw").click()
        visitor.watches(N_PICTURES)
        visitor.sees("leaving")
    visitor.sees("withdrawn")

"""A page that is reloaded at any stage leads back to it, and nothing is lost or counted twice."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.study.options.options import parse_options
from tests.browser.study_visitor import NewStudy, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

OPTIONS = {
    "optional_stages": ["screening", "practice", "interview"],
    "screening": {"tests": ["acuity"]},
    "consent": "We compare models.",
    "comprehension": True,
    "both_orders": True,
    "break_every": 1,  # only after the first of six: nobody rests shortly before the end
}
N_TRIALS = 6


def reloads(visitor: Visitor, view: str) -> None:
    """Reloads the page, which then shows this view."""
    visitor.page.reload()
    visitor.sees(view)


def leaves_in(visitor: Visitor, state: str) -> None:
    """Reloads the page in a state of a trial, and goes on."""
    visitor.waits_for(f"#trial[data-state={state}]")
    reloads(visitor, "resume")
    visitor.page.keyboard.press("Enter")


def sees_both_and_votes(visitor: Visitor) -> None:
    visitor.is_in("exposure")
    visitor.page.keyboard.press("Space")
    visitor.votes("2")


def comes_to_the_screening(visitor: Visitor) -> None:
    """From the welcome; every page is reloaded once."""
    page = visitor.page
    reloads(visitor, "welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    reloads(visitor, "welcome")  # nobody has begun yet
    page.keyboard.press("Enter")
    visitor.sees("consent")
    page.get_by_label("I have read this").check()
    page.keyboard.press("Enter")
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        reloads(visitor, f"instructions-{number}")
        page.keyboard.press("Enter")
    visitor.sees("comprehension")
    reloads(visitor, "instructions-3")
    page.keyboard.press("Enter")
    visitor.sees("comprehension")
    page.get_by_label("I switch between").check()
    page.keyboard.press("Enter")
    visitor.sees("screening")


def comes_to_the_trials(visitor: Visitor) -> None:
    """From the screening, whose test is left out."""
    page = visitor.page
    reloads(visitor, "screening")
    page.keyboard.press("Enter")
    visitor.sees("card")
    reloads(visitor, "screening")
    page.keyboard.press("Enter")
    visitor.sees("card")
    page.get_by_role("button", name="I have no card").click()
    visitor.is_settled()
    page.get_by_role("button", name="Yes, leave the test out").click()
    visitor.sees("practice")
    reloads(visitor, "practice")
    page.keyboard.press("Enter")
    visitor.waits_for("#trial[data-state=exposure]")
    reloads(visitor, "practice")
    page.keyboard.press("Enter")
    visitor.practises()
    reloads(visitor, "practice")  # its results are sent with the press that was not made
    page.keyboard.press("Enter")
    visitor.practises()
    page.keyboard.press("Enter")


def test_a_reload_at_every_stage_leads_back_to_it_and_each_pair_gets_one_vote(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.8, parse_options(OPTIONS), see_both=True)
    page.goto(study.address)
    comes_to_the_screening(visitor)
    comes_to_the_trials(visitor)
    leaves_in(visitor, "fixation")  # nothing was seen yet
    for state in ("exposure", "unseen"):
        leaves_in(visitor, state)
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    leaves_in(visitor, "voting")
    sees_both_and_votes(visitor)
    visitor.sees("break")
    reloads(visitor, "resume")
    page.keyboard.press("Enter")
    for _ in range(N_TRIALS - 1):
        sees_both_and_votes(visitor)
    visitor.sees("interview")
    page.get_by_label("How old are you?").fill("47")
    reloads(visitor, "interview")
    expect(page.get_by_label("How old are you?")).to_have_value("47")
    page.get_by_role("button", name="Finish").click()
    visitor.sees("thanks")
    reloads(visitor, "thanks")
    looks = study.read("trials")
    voids = [look["viewing"] for look in looks if look["void_reason"] == "left the page"]
    votes = Counter((look["number"], look["choice"]) for look in looks if not look["voided_at"])
    assert votes == {(number, "none"): 1 for number in range(1, N_TRIALS + 1)}
    assert len(voids) == 3
    assert all(viewing["shown_ms"] > 0 for viewing in voids)

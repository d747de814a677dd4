"""A computer that sleeps in mid-film, or is far too slow."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from app.study.options.options import StudyOptions
from app.study.trial import smoothness
from tests.browser.playback_techniques import leave_only
from tests.browser.sleeping import ASLEEP_S, descendants, sleep
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.alone]

EXPOSURE_S = 1.6
LONGEST_DWELL_MS = 1000 * EXPOSURE_S + 500  # of what ran, on a busy machine


@pytest.fixture(autouse=True)
def awake_for_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit of a real study."""
    monkeypatch.setattr(smoothness, "LONGEST_GAP_S", 1.0)


def sleep_now() -> None:
    sleep(descendants(os.getpid(), "chrom"))  # but not what drives the browser


def looks(study: Study) -> list[dict[str, Any]]:
    """Trials that were begun, in the order in which they ended."""
    begun = [trial for trial in study.read("trials") if trial["voided_at"] or trial["voted_at"]]
    return sorted(begun, key=lambda trial: str(trial["voided_at"] or trial["voted_at"]))


@pytest.mark.parametrize("technique", ["stacked", "webcodecs"])
def test_a_pair_during_which_the_computer_slept_comes_again_and_a_second_sleep_is_flagged(
    technique: str, new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    leave_only(page, technique)
    study = new_study(short_films, EXPOSURE_S)
    visitor.begin(study)
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    sleep_now()
    visitor.sees("suspended")
    expect(page.locator("[data-view=suspended]")).to_contain_text("once more at the end")
    page.keyboard.press("Enter")
    for key in ("1", "3"):
        visitor.votes(key)
    visitor.is_in("exposure")
    expect(page.locator("#trial-label")).to_have_text("Pair 1 of 3, once more")
    sleep_now()
    visitor.votes("2")
    visitor.sees("slow")  # the second look that did not run; but once
    page.keyboard.press("Enter")
    visitor.sees("thanks")
    void, *smooth, again = looks(study)
    assert (void["void_reason"], void["choice"], len(void["viewing"]["switches"])) == ("suspended", None, 1)
    assert (again["viewing"]["interruption"], again["choice"]) == ("suspended", "none")
    for look in (void, again):
        assert look["longest_gap_ms"] > 500 * ASLEEP_S  # less the frames that came in a rush afterwards
        assert look["shown_smoothly"] is False
        assert sum(look["viewing"]["dwell_ms"].values()) < LONGEST_DWELL_MS
    for look in smooth:
        assert look["shown_smoothly"] is True
        assert look["frame_share"] > 0.8
        assert look["mismatch_share"] == 0
    (observer,) = study.read("observers")
    assert observer["not_smooth"] == 1
    assert "films not shown smoothly in 1 of 3 votes" in observer["flags"]


def test_viewing_enough_cannot_be_met_asleep(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smoothness, "LONGEST_GAP_S", 60.0)  # as in the repetition, which is not void again
    study = new_study(short_films, EXPOSURE_S, StudyOptions(minimum_viewing_s=2.0, free_exposure=True))
    visitor.begin(study)
    visitor.is_in("exposure")
    sleep_now()
    page.keyboard.press("Space")
    sleep_now()
    page.keyboard.press("Enter")
    visitor.is_in("unseen")


BUSY = """() => {
    const work = () => {
        const until = performance.now() + 300;
        while (performance.now() < until);
        window.busy = requestAnimationFrame(work);
    };
    work();
}"""


def test_whose_computer_is_too_slow_is_told_once_and_flagged(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smoothness, "LONGEST_GAP_S", 60.0)
    study = new_study(short_films, EXPOSURE_S)
    visitor.begin(study)
    for key in ("1", "3"):
        visitor.is_in("exposure")
        page.evaluate(BUSY)
        page.keyboard.press("Space")
        visitor.waits_for("#trial[data-state=voting]")
        page.evaluate("cancelAnimationFrame(busy)")
        visitor.votes(key)
    visitor.sees("slow")
    expect(page.locator("[data-view=slow]")).to_contain_text("That is not your fault")
    page.keyboard.press("Enter")
    visitor.votes("2")
    visitor.sees("thanks")
    assert [vote["shown_smoothly"] for vote in study.votes(3)][:2] == [False, False]
    (observer,) = study.read("observers")
    assert observer["not_smooth"] >= 2

"""What was seen is what is recorded: left pages, other windows, other sizes, and the full screen."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Error, Page, expect

from app.study.options.options import StudyOptions
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = pytest.mark.browser

NEVER_STORE = """() => {
    IDBDatabase.prototype.transaction = () => ({ objectStore: () => ({ put() {} }) }); // it never completes
}"""
NOTED = "() => Object.entries(localStorage).some(([name, look]) => name.startsWith('look of') && look.includes('to'))"
LONGEST_WAIT_PICTURES = 300
OTHER_WINDOW = "window.dispatchEvent(new Event('blur'))"


def returns(page: Page, visitor: Visitor) -> None:
    visitor.sees("resume")
    page.keyboard.press("Enter")


def crash(page: Page) -> None:
    with page.expect_event("crash"), suppress(Error):
        page.goto("chrome://crash")
    page.close()


def voids(study: Study) -> list[dict[str, Any]]:
    return [trial for trial in study.read("trials") if trial["voided_at"]]


def test_a_pair_whose_page_was_left_comes_again_and_the_vote_says_how_often(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")  # pair 1
    page.keyboard.press("Space")
    page.reload()
    returns(page, visitor)
    visitor.is_in("voting")  # pair 2
    page.keyboard.press("1")
    page.reload()
    returns(page, visitor)
    visitor.votes("3")  # pair 3
    visitor.is_in("exposure")  # pair 1 again
    page.go_back()
    for _ in range(LONGEST_WAIT_PICTURES):
        if len(voids(study)) == 3:  # whether or not the participant ever comes back
            break
        visitor.watches(1)
    assert len(voids(study)) == 3
    page.go_forward()
    returns(page, visitor)
    visitor.votes("2")  # pair 2 again
    visitor.votes("1")  # pair 1, the third time
    visitor.sees("thanks")
    assert {trial["void_reason"] for trial in voids(study)} == {"left the page"}
    first = min(voids(study), key=lambda trial: trial["voided_at"])["viewing"]
    assert len(first["switches"]) == 1
    assert first["shown_ms"] > 0
    assert first["shown_ms"] == pytest.approx(sum(first["dwell_ms"].values()), abs=0.2)
    votes = {vote["choice"]: vote["looks_before"] for vote in study.votes(3)}
    assert votes == {"b": 0, "none": 1, "a": 2}


def test_a_look_that_ends_in_a_crash_is_recorded(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    page.wait_for_function(NOTED)
    crash(page)
    again = page.context.new_page()
    again.goto(study.address)
    Visitor(again).sees("resume")
    (void,) = voids(study)
    assert (void["void_reason"], len(void["viewing"]["switches"])) == ("left the page", 1)
    assert void["viewing"]["shown_ms"] > 0


def test_a_choice_is_sent_even_if_the_page_is_left_before_it_is_stored(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    visitor.is_in("voting")
    page.evaluate(NEVER_STORE)
    page.keyboard.press("3")
    page.keyboard.press("Enter")
    page.reload()
    visitor.sees("resume")
    assert [vote["choice"] for vote in study.votes(1)] == ["b"]
    assert voids(study) == []


def test_what_happens_to_the_window_is_recorded_and_next_asks_for_the_full_screen_again(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    page.evaluate(OTHER_WINDOW)
    page.set_viewport_size({"width": 900, "height": 540})
    visitor.is_in("voting")
    page.evaluate(
        "document.exitFullscreen().then(() => new Promise(requestAnimationFrame))"
    )  # whose event comes before
    visitor.votes("1")
    visitor.is_in("exposure")
    assert page.evaluate("document.fullscreenElement !== null")
    study.votes(1)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
    happened = viewing["happened"]
    assert [event["what"] for event in happened if event["at_ms"] > 0][:3] == ["blur", "resize", "full screen left"]
    assert happened[-1]["at_ms"] > viewing["shown_ms"] > happened[-2]["at_ms"]
    assert voids(study) == []


def test_a_study_chooses_what_voids_a_look(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 1.6, StudyOptions(void_on=("blur",)))
    visitor.begin(study)
    visitor.is_in("exposure")
    page.evaluate("document.exitFullscreen()")
    visitor.watches(2)
    page.evaluate(OTHER_WINDOW)
    visitor.sees("interrupted")
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    (void,) = voids(study)
    assert void["void_reason"] == "blur"
    assert [event["what"] for event in void["viewing"]["happened"]][-2:] == ["full screen left", "blur"]


def test_who_saw_only_one_of_a_pair_sees_it_again_before_the_vote(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.8, see_both=True)
    visitor.begin(study)
    visitor.is_in("unseen")
    expect(page.locator("#unseen")).to_contain_text("only one of the two")
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    visitor.votes("1")
    (vote,) = study.votes(1)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
    (again,) = [event["at_ms"] for event in viewing["happened"] if event["what"] == "shown again"]
    (switch,) = viewing["switches"]
    assert vote["both_seen"]
    assert 0 < again < switch["at_ms"] < viewing["shown_ms"]  # the pause between the two showings does not count
    assert viewing["shown_ms"] == pytest.approx(2 * again, rel=0.4)
    assert sum(viewing["dwell_ms"].values()) == pytest.approx(viewing["shown_ms"], abs=0.2)

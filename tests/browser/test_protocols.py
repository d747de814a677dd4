"""A participant who rates: films alone, against a reference, and one of a pair against the other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from app.study.options.options import parse_options
from tests.browser.accessibility import check_accessibility
from tests.browser.numbered_films import CONDITIONS
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = pytest.mark.browser


def votes_in_order(study: Study, n_votes: int) -> list[dict[str, Any]]:
    study.votes(n_votes)
    return [row for row in sorted(study.read("trials"), key=lambda row: row["number"]) if row["voted_at"]]


def test_films_are_rated_one_by_one_by_the_keys_that_stand_below_the_grades_and_a_press_changes_nothing(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    options = parse_options({"protocol": "ACR", "scale": 11, "comprehension": True})
    study = new_study(short_films, 1.6, options, see_both=True)
    page.goto(study.address)
    for view in ("welcome", "instructions-1", "instructions-2"):
        visitor.sees(view)
        assert "pair" not in page.locator(f"[data-view={view}]").inner_text()
        page.keyboard.press("Enter")
    visitor.sees("comprehension")
    page.get_by_label("how good it looked to me").check()
    page.keyboard.press("Enter")
    seen = []
    for key in ("x", "1"):
        visitor.is_in("exposure")
        seen.append(visitor.reads_screen()[0])
        page.keyboard.press("Space")
        page.mouse.click(300, 200)
        visitor.watches(2)
        assert visitor.reads_screen()[0] == seen[-1]
        expect(page.locator(".badge")).to_be_hidden()
        visitor.is_in("voting")
        visitor.votes(key)
    visitor.is_in("voting")
    expect(page.locator("#trial .choice kbd")).to_have_text([*"0123456789X"])
    check_accessibility(page)
    page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_have_text("Please choose a grade first.")
    page.locator("#trial label", has_text="Fair").click()
    page.get_by_role("button", name="Next").click()
    visitor.sees("thanks")
    trials = votes_in_order(study, 3)
    assert [row["rating"] for row in trials] == [10, 1, 5]
    assert [row["item_b"] for row in trials][:2] == seen
    assert {row["item_b"] for row in trials} == set(CONDITIONS)
    assert [row["viewing"]["switches"] for row in trials] == [[]] * 3


def test_a_slider_is_set_by_keys_before_the_film_goes_on_from_right_to_left_too(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options({"protocol": "ACR", "scale": "slider", "languages": ["ar"]}))
    page.goto(study.address)
    for view in ("welcome", "instructions-1", "instructions-2"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.is_in("voting")
    page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_have_text("يُرجى ضبط شريط التمرير أولًا.")
    page.keyboard.press("ArrowLeft")  # of the page
    page.keyboard.press("ArrowLeft")  # of the slider itself
    expect(page.locator("output")).to_have_text("52")
    check_accessibility(page)
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    visitor.is_in("voting")
    expect(page.locator("output")).to_have_text("–")
    visitor.votes("End")
    assert [row["rating"] for row in votes_in_order(study, 2)] == [52, 100]


def test_a_film_is_rated_against_the_reference_that_is_shown_first(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    options = parse_options({"protocol": "DCR", "reference": CONDITIONS[0]})
    study = new_study(short_films, 1.6, options, see_both=True)
    visitor.begin(study)
    visitor.is_in("exposure")
    expect(page.locator(".badge span").first).to_have_text("Reference")
    assert visitor.reads_screen()[0] == CONDITIONS[0]
    page.keyboard.press("Space")
    visitor.watches(2)
    film = visitor.reads_screen()[0]
    visitor.votes("2")
    visitor.waits_for("#trial[data-state=unseen]")  # of the second only the reference was seen
    visitor.is_settled()
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    visitor.is_in("voting")
    check_accessibility(page)
    page.locator("#trial label", has_text="Imperceptible").click()
    page.get_by_role("button", name="Next").click()
    visitor.sees("thanks")
    trials = votes_in_order(study, 2)
    assert [(row["item_a"], row["rating"]) for row in trials] == [(CONDITIONS[0], 2), (CONDITIONS[0], 5)]
    assert trials[0]["item_b"] == film


def test_b_is_compared_with_a_in_seven_grades(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options({"protocol": "CCR"}))
    visitor.begin(study)
    for key in ("1", "4"):
        visitor.votes(key)
        visitor.is_in("exposure")
    visitor.is_in("voting")
    check_accessibility(page)
    page.locator("#trial label", has_text="Slightly better").click()
    page.get_by_role("button", name="Next").click()
    visitor.sees("thanks")
    answers = [(row["rating"], row["choice"]) for row in votes_in_order(study, 3)]
    assert answers == [(-3, "a"), (0, "none"), (1, "b")]

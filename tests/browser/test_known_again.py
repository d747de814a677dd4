"""Somebody whose cookies are gone is known again, and nobody is made two people of by the obvious press."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, Route, expect

from app.operations.studies.manage import add_invitation
from app.settings import Settings
from app.study.options.options import parse_options
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def loses_the_cookies_before_the_second_vote(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.votes("1")
    study.votes(1)
    visitor.is_in("voting")
    page.context.clear_cookies()
    page.keyboard.press("3")
    page.keyboard.press("Enter")
    visitor.sees("known")


def goes_on_by_the_kept_code(page: Page, visitor: Visitor) -> None:
    visitor.sees("known")
    expect(page.get_by_label("Your code")).not_to_have_value("")
    page.keyboard.press("Enter")
    visitor.sees("resume")
    expect(page.locator("[data-view=resume]")).to_contain_text("1 of 3 pairs")


def test_who_loses_the_cookies_in_mid_session_goes_on_with_the_code_that_the_browser_kept(
    study: Study, page: Page, visitor: Visitor
) -> None:
    loses_the_cookies_before_the_second_vote(study, page, visitor)
    expect(page.get_by_text("Your answers are safe, but this browser")).to_be_visible()
    page.get_by_label("Your code").press("Enter")
    visitor.sees("resume")
    assert [vote["participant"] for vote in study.votes(2)] == ["P001", "P001"]
    assert len(study.read("participants")) == 1


def test_a_code_whose_answer_is_lost_is_sent_again_and_leads_on(study: Study, page: Page, visitor: Visitor) -> None:
    sent: list[str | None] = []

    def lose_the_first_answer(route: Route) -> None:
        sent.append(route.request.post_data)
        if len(sent) > 1:
            route.continue_()
            return
        route.fetch()
        page.context.clear_cookies()
        route.abort("connectionreset")

    loses_the_cookies_before_the_second_vote(study, page, visitor)
    page.route("**/session/resume", lose_the_first_answer)
    page.get_by_label("Your code").press("Enter")
    visitor.sees("resume")
    assert sent == [sent[0]] * 2
    assert len(study.votes(2)) == 2


def test_who_comes_back_without_cookies_is_not_begun_anew_by_the_obvious_press(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    visitor.votes("1")
    study.votes(1)
    page.context.clear_cookies()
    page.reload()
    goes_on_by_the_kept_code(page, visitor)
    assert len(study.read("participants")) == 1


def test_who_began_at_another_computer_is_not_told_of_this_one(study: Study, page: Page, visitor: Visitor) -> None:
    page.goto(study.address)
    visitor.sees("welcome")
    page.get_by_role("button", name="I have begun already").click()
    visitor.sees("known")
    expect(page.locator("#known-why")).to_contain_text("or you went on elsewhere")
    expect(page.locator("#known-why")).not_to_contain_text("in this browser before")


def test_a_wrong_code_is_refused_and_somebody_else_may_begin(study: Study, page: Page, visitor: Visitor) -> None:
    loses_the_cookies_before_the_second_vote(study, page, visitor)
    page.get_by_label("Your code").fill("aaaa-bbbb-cccc")
    page.keyboard.press("Enter")
    expect(page.get_by_text("This code does not lead anywhere.")).to_be_visible()
    page.reload()
    visitor.sees("known")
    page.get_by_role("button", name="I am somebody else").click()
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("instructions-1")
    assert len(study.read("participants")) == 2


def test_an_invitation_for_one_person_offers_the_kept_code_when_the_cookies_are_gone(
    study: Study, settings: Settings, page: Page, visitor: Visitor
) -> None:
    page.goto(study.url + add_invitation(settings, study.slug, places=1)["path"])
    visitor.reads_introduction()
    visitor.is_in("exposure")
    page.context.clear_cookies()
    page.reload()
    expect(page.get_by_label("Code to go on")).not_to_have_value("")
    page.get_by_role("button", name="Go on here").click()
    visitor.sees("resume")


def test_a_tab_that_is_left_over_says_thank_you_and_makes_no_second_person(
    study: Study, page: Page, visitor: Visitor
) -> None:
    left_over = page.context.new_page()
    left_over.goto(study.address)
    Visitor(left_over).sees("welcome")
    visitor.begin(study)
    taken_over = page.context.new_page()
    taken_over.goto(study.address)
    Visitor(taken_over).sees("elsewhere")
    taken_over.keyboard.press("Enter")
    visitor.sees("yielded")
    Visitor(taken_over).sees("resume")
    taken_over.keyboard.press("Enter")
    for _ in range(3):
        Visitor(taken_over).votes("2")
    Visitor(taken_over).sees("thanks")
    page.bring_to_front()
    page.evaluate("window.dispatchEvent(new Event('focus'))")  # headless windows have it all the time
    visitor.sees("thanks")
    left_over.locator("#begin").click()
    Visitor(left_over).sees("thanks")
    assert len(study.read("participants")) == 1


def test_impatient_clicking_anywhere_withdraws_nobody(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    """At the place of Next, at the corner that withdraws, and at both, whatever comes up."""
    options = parse_options({"optional_stages": [], "consent": "We show films."})
    study = new_study(short_films, 0.8, options)
    page.goto(study.address)
    visitor.sees("welcome")
    next_box = page.locator("#begin").bounding_box()
    assert next_box is not None
    middle = (next_box["x"] + next_box["width"] / 2, next_box["y"] + next_box["height"] / 2)
    page.get_by_role("button", name="Begin", exact=True).click()
    page.get_by_label("I have read this").check()
    for number in range(60):
        page.mouse.click(*middle)
        if number % 3 == 0:
            page.mouse.click(930, 20)
        if page.locator("#withdraw-yes").is_visible():
            visitor.is_settled()
            page.locator("#withdraw-yes").click()
            undo = page.locator("#withdrawing .undo")
            expect(undo).to_be_visible()
            visitor.is_settled()
            undo.click()
        visitor.watches(3)
    assert [row["stage"] for row in study.read("participants")] == ["trial"]


def test_next_stands_at_the_same_place_on_every_page_and_nothing_moves_when_the_display_is_measured(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    options = parse_options({"optional_stages": ["practice", "interview"], "consent": "A.", "comprehension": True})
    page.goto(new_study(short_films, 0.4, options).address)
    visitor.sees("welcome")
    first = page.locator("[data-view=welcome]").bounding_box()
    expect(page.locator("[data-check=refresh]")).not_to_have_text("")
    assert page.locator("[data-view=welcome]").bounding_box() == first
    page.evaluate("document.querySelector('#trial .quarter').textContent = 'Half is done.'")
    places = page.evaluate(PLACES)
    assert len(places) > 12
    assert len({(place["middle"], place["bottom"]) for place in places}) == 1, places


PLACES = """() => {
  const places = [];
  for (const view of document.querySelectorAll("[data-view]")) {
    for (const other of document.querySelectorAll("[data-view]")) other.hidden = other !== view;
    for (const button of view.querySelectorAll(".foot > .button")) {
      const { left, right, bottom } = button.getBoundingClientRect();
      const middle = Math.round((left + right) / 2);
      if (right > left) places.push({ view: view.dataset.view, middle, bottom: Math.round(bottom) });
    }
  }
  return places;
}"""

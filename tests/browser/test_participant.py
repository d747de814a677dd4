from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from app.operations.studies.manage import add_invitation
from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.studies.studies import set_standing, study_by_slug
from tests.browser.study_visitor import Study, Visitor

pytestmark = pytest.mark.browser


def test_a_participant_goes_from_the_invitation_to_the_thanks_and_the_votes_are_found_over_rest(
    study: Study, page: Page, visitor: Visitor
) -> None:
    page.goto(study.url)
    page.get_by_label("Invitation code").fill(f" {study.invitation} ")
    page.keyboard.press("Enter")
    visitor.sees("welcome")
    visitor.begin(study)
    assert page.evaluate("document.fullscreenElement !== null")
    shown = []

    visitor.is_in("exposure")  # by keyboard
    shown.append(_both_stimuli(visitor, lambda: page.keyboard.press("Space")))
    page.keyboard.press("ArrowLeft")
    visitor.votes("1")

    visitor.is_in("exposure")  # by mouse
    shown.append(_both_stimuli(visitor, lambda: page.mouse.click(300, 200)))
    visitor.is_in("voting")
    page.locator("label", has_text="A is better").click()
    page.locator("label", has_text="B is better").click()
    page.get_by_role("button", name="Next").click()

    visitor.is_in("exposure")
    page.reload()  # in the middle of the third
    visitor.sees("resume")
    expect(page.locator("[data-view=resume]")).to_contain_text("2 of 3 pairs")
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    shown.append(_both_stimuli(visitor, lambda: page.mouse.click(300, 200, button="right")))
    visitor.votes("2")

    visitor.sees("thanks")
    looks = sorted(study.read("trials"), key=lambda trial: (trial["number"], trial["attempt"]))
    assert [look["void_reason"] for look in looks] == [None, None, "left the page", None]
    trials = [look for look in looks if not look["voided_at"]]
    assert [trial["choice"] for trial in trials] == ["a", "b", "none"]
    assert [{"a": trial["item_a"], "b": trial["item_b"]} for trial in trials] == shown
    assert [trial["n_switches"] for trial in trials] == [2, 1, 1]
    votes = {vote["trial"]: vote["choice"] for vote in study.read("votes")}
    assert votes == {trial["trial"]: trial["choice"] for trial in trials}
    for trial in trials:
        _check_viewing(trial)

    page.reload()
    visitor.sees("thanks")


def _both_stimuli(visitor: Visitor, switch: Any) -> dict[str, str]:
    """What the screen shows under each letter."""
    shown = {visitor.badge: visitor.reads_screen()[0]}
    switch()
    shown[visitor.badge] = visitor.reads_screen()[0]
    assert set(shown) == {"a", "b"}
    return shown


def _check_viewing(trial: dict[str, Any]) -> None:
    viewing = trial["viewing"]
    assert trial[f"item_{viewing['first_shown']}"] == trial["first_shown"]
    assert 1500 < viewing["shown_ms"] < 3200  # by the film's clock; a busy machine may be late
    times = [switch["at_ms"] for switch in viewing["switches"]]
    assert times == sorted(times)
    assert all(0 <= time < viewing["shown_ms"] for time in times)
    assert all(0 <= switch["media_time_s"] < 0.8 for switch in viewing["switches"])
    letters = [viewing["first_shown"], *(switch["to"] for switch in viewing["switches"])]
    assert all(one != other for one, other in pairwise(letters))


def test_somebody_else_begins_where_one_did_not_finish_and_who_left_may_come_back(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    visitor.votes("1")
    visitor.is_in("exposure")
    page.reload()
    visitor.sees("resume")
    code = visitor.notes_resume_code()
    page.get_by_role("button", name="I am somebody else").click()
    _begins_and_votes(visitor, "3")
    page.get_by_role("button", name="Withdraw").click()
    page.get_by_role("button", name="Yes, withdraw").click()
    visitor.sees("withdrawn")
    page.get_by_role("button", name="Begin as another participant").click()
    _begins_and_votes(visitor, "2")
    page.goto(study.url)
    page.get_by_label("Code to go on").fill(code)
    page.keyboard.press("Enter")
    visitor.sees("resume")
    expect(page.locator("[data-view=resume]")).to_contain_text("1 of 3 pairs")
    votes = [(vote["participant"], vote["choice"], vote["excluded"]) for vote in study.votes(3)]
    assert votes == [("P001", "a", False), ("P002", "b", True), ("P003", "none", False)]


def _begins_and_votes(visitor: Visitor, key: str) -> None:
    visitor.reads_introduction()
    visitor.votes(key)
    visitor.is_in("voting")


def test_reloading_an_instruction_shows_the_same_instruction(study: Study, page: Page, visitor: Visitor) -> None:
    page.goto(study.address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("instructions-1")
    page.keyboard.press("Enter")
    visitor.sees("instructions-2")
    page.reload()
    visitor.sees("instructions-2")
    page.get_by_role("button", name="Back").click()
    visitor.sees("instructions-1")


def test_switching_is_tried_on_the_instructions_with_the_same_keys(study: Study, page: Page, visitor: Visitor) -> None:
    page.goto(study.address)
    for view in ("welcome", "instructions-1"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.sees("instructions-2")
    seen = [page.locator("#try").get_attribute("data-shown")]
    for switch in (
        lambda: page.keyboard.press("Space"),
        lambda: page.keyboard.press("ArrowUp"),
        page.locator("#try").click,
    ):
        switch()
        seen.append(page.locator("#try").get_attribute("data-shown"))
    assert seen == ["a", "b", "a", "b"]


def test_nothing_is_chosen_before_the_participant_chooses(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.is_in("voting")
    expect(page.locator("input[type=radio]:checked")).to_have_count(0)
    page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_have_text("Please choose one of the three first.")
    visitor.votes("3")
    visitor.is_in("voting")
    expect(page.locator("input[type=radio]:checked")).to_have_count(0)


def test_a_click_that_was_meant_to_switch_does_not_choose(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    card = page.locator("label.choice").first.bounding_box()
    assert card is not None
    clicks_when_voting_opens = """([x, y]) => new Promise((resolve) => new MutationObserver(() => {
        if (document.getElementById("trial").dataset.state !== "voting") return;
        document.elementFromPoint(x, y).click();
        resolve(document.querySelectorAll("input[type=radio]:checked").length);
    }).observe(document.getElementById("trial"), { attributes: true }))"""
    middle = [card["x"] + card["width"] / 2, card["y"] + card["height"] / 2]
    assert page.evaluate(clicks_when_voting_opens, middle) == 0


def test_an_invitation_that_is_used_up_while_a_page_is_open_is_told_at_begin(
    study: Study, settings: Settings, page: Page, visitor: Visitor
) -> None:
    path = add_invitation(settings, study.slug, places=1)["path"]
    page.goto(study.url + path)
    visitor.sees("welcome")
    taken = page.context.browser.new_context()
    taken.request.post(f"{study.url}/api/v1/studies/{study.slug}/sessions", data={"invitation": path.split("/")[-1]})
    taken.close()
    page.get_by_role("button", name="Begin").click()
    visitor.sees("problem")
    expect(page.get_by_role("heading")).to_have_text("This invitation has already been used")


def test_a_study_that_takes_nobody_in_while_a_page_is_open_is_told_at_begin(
    study: Study, settings: Settings, page: Page, visitor: Visitor
) -> None:
    page.goto(study.address)
    visitor.sees("welcome")
    database = open_database(settings.url)
    with database.writing() as connection:
        found = study_by_slug(connection, study.slug)
        assert found is not None
        set_standing(connection, found.id, "paused", utc_now())
    database.dispose()
    page.get_by_role("button", name="Begin").click()
    visitor.sees("problem")
    expect(page.get_by_role("heading")).to_have_text("This study is paused")

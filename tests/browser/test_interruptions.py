"""What interrupts a participant: looking away, a second tab, another computer, a change of mind."""

from __future__ import annotations

import pytest
from playwright.sync_api import APIResponse, Page, Route, expect

from tests.browser.playback_techniques import leave_only
from tests.browser.study_visitor import Study, Visitor

pytestmark = pytest.mark.browser

HIDE = """() => {
    Object.defineProperty(document, "visibilityState", { value: "hidden", configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
    delete document.visibilityState;
}"""

WATCH_TRIAL = """() => {
    const trial = document.getElementById("trial");
    window.states = [];
    new MutationObserver(() => states.push(trial.dataset.state)).observe(trial, { attributeFilter: ["data-state"] });
}"""


@pytest.mark.parametrize(
    ("look_away", "reason"), [("document.exitFullscreen()", "full screen"), (f"({HIDE})()", "hidden")]
)
def test_a_trial_that_is_not_watched_is_repeated_once_at_the_end(
    study: Study, page: Page, visitor: Visitor, look_away: str, reason: str
) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    page.evaluate(look_away)
    visitor.sees("interrupted")
    page.keyboard.press("Enter")
    for number in (2, 3):
        visitor.is_in("exposure")
        expect(page.locator("#trial-label")).to_have_text(f"Pair {number} of 3")
        visitor.votes("1")
    visitor.is_in("exposure")
    expect(page.locator("#trial-label")).to_have_text("Pair 1 of 3, once more")
    page.evaluate(look_away)  # the repetition goes on, and says what happened
    visitor.votes("3")
    visitor.sees("thanks")
    trials = study.read("trials")
    (void,) = [trial for trial in trials if trial["voided_at"]]
    (again,) = [trial for trial in trials if trial["attempt"] == 2]
    assert (void["void_reason"], void["choice"], len(void["viewing"]["switches"])) == (reason, None, 1)
    assert (again["item_a"], again["item_b"], again["choice"]) == (void["item_a"], void["item_b"], "b")
    assert again["viewing"]["interruption"] == reason
    assert len(study.read("votes")) == 3


def test_a_record_says_how_a_pair_was_looked_at(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    visitor.is_in("voting")
    for key in ("1", "3", "2"):
        page.keyboard.press(key)
    page.keyboard.press("Enter")
    study.votes(1)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
    assert viewing["n_changes"] == 2
    assert sum(viewing["dwell_ms"].values()) == pytest.approx(viewing["shown_ms"], abs=0.2)
    assert viewing["n_frames"] > 0
    assert viewing["display"] == {
        "window_width": 960,
        "window_height": 540,
        "device_pixel_ratio": 1,
        "full_screen": True,
    }
    for switch in viewing["switches"]:
        assert switch["frame"] == round(switch["media_time_s"] * 25)


def test_two_tabs_do_not_vote_on_the_same_trial(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    other = page.context.new_page()
    other.goto(study.address)
    second = Visitor(other)
    second.sees("elsewhere")
    other.keyboard.press("Enter")
    second.sees("resume")
    visitor.sees("yielded")
    other.keyboard.press("Enter")
    second.votes("1")
    second.is_in("exposure")
    assert [vote["choice"] for vote in study.votes(1)] == ["a"]
    other.close()
    page.get_by_role("button", name="Go on here").click()
    visitor.sees("resume")


def take_over(study: Study, page: Page, visitor: Visitor) -> None:
    """In another tab."""
    other = page.context.new_page()
    other.goto(study.address)
    Visitor(other).sees("elsewhere")
    other.keyboard.press("Enter")
    Visitor(other).sees("resume")
    visitor.sees("yielded")


@pytest.mark.parametrize(
    ("awaited", "technique"),
    [("**/stages/introduction", "stacked"), ("**/trials/next", "stacked"), ("**/media/**", "webcodecs")],
)
def test_what_arrives_when_the_page_was_left_starts_nothing(
    study: Study,
    page: Page,
    visitor: Visitor,
    awaited: str,
    technique: str,
) -> None:
    held: list[tuple[Route, APIResponse]] = []
    page.route(awaited, lambda route: held.append((route, route.fetch())))
    leave_only(page, technique)
    with page.expect_request(awaited):
        visitor.begin(study)
    take_over(study, page, visitor)
    page.evaluate(WATCH_TRIAL)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    for route, answer in held:
        with page.expect_response(route.request.url):
            route.fulfill(response=answer)
    page.evaluate("new Promise((resolve) => requestIdleCallback(resolve))")  # what the page does with them has begun
    page.evaluate("fetch('/healthz')")
    assert asked == [f"{study.url}/healthz"]
    assert page.evaluate("states") == []


def test_a_tab_never_acts_for_a_participant_who_began_in_another_tab(
    study: Study, page: Page, visitor: Visitor
) -> None:
    page.goto(study.address)
    for view in ("welcome", "instructions-1", "instructions-2"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.sees("instructions-3")
    other = page.context.request
    begun = other.post(f"{study.url}/api/v1/studies/{study.slug}/sessions", data={"invitation": study.invitation})
    page.keyboard.press("Enter")
    visitor.sees("known")
    found = other.get(f"{study.url}/api/v1/session").json()
    assert (found["session"], found["stage"]) == (begun.json()["session"], "introduction")


def test_a_code_leads_to_another_computer(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.votes("1")
    visitor.is_in("exposure")
    page.reload()
    visitor.sees("resume")
    code = visitor.notes_resume_code()
    assert page.context.browser is not None
    elsewhere = page.context.browser.new_context()
    there = elsewhere.new_page()
    there.goto(study.url)
    there.get_by_label("Code to go on").fill(f" {code[:6].upper()} {code[6:]} ")
    there.keyboard.press("Enter")
    Visitor(there).sees("resume")
    expect(there.locator("[data-view=resume]")).to_contain_text("1 of 3 pairs")
    elsewhere.clear_cookies()
    there.goto(study.url)
    there.get_by_label("Code to go on").fill(code)
    there.keyboard.press("Enter")
    expect(there.get_by_role("heading")).to_have_text("We do not know this code")
    elsewhere.close()
    page.reload()  # here the session has ended
    visitor.sees("known")
    expect(page.get_by_text("You have begun this study in this browser before.")).to_be_visible()
    page.goto(f"{study.address}?another=1")
    visitor.sees("welcome")


def test_a_participant_withdraws_and_nothing_more_is_taken(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.votes("1")
    visitor.is_in("voting")
    page.get_by_role("button", name="Withdraw").click()
    visitor.is_settled()
    page.keyboard.press("Enter")  # no, go on
    expect(page.get_by_role("dialog")).to_be_hidden()
    page.get_by_role("button", name="Withdraw").click()
    page.get_by_role("button", name="Yes, withdraw").click()
    visitor.sees("withdrawn")
    page.reload()
    visitor.sees("withdrawn")
    assert [(vote["choice"], vote["excluded"]) for vote in study.votes(1)] == [("a", True)]

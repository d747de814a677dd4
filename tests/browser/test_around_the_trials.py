"""The stages around the trials, in both languages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, expect

from app.study.options.options import parse_options
from tests.browser.accessibility import check_accessibility
from tests.browser.numbered_films import squares
from tests.browser.study_visitor import MakeFilms, NewStudy, Study, Visitor

pytestmark = pytest.mark.browser

OPTIONS = {
    "optional_stages": ["interview"],
    "consent": "We compare models.\n\nYou may stop at any time.",
    "consent_version": "2",
    "comprehension": True,
    "debriefing": "Some of the models had <b>holes</b>.\n\nThe others had none.",
}


@pytest.fixture
def full_study(new_study: NewStudy, short_films: Path) -> Study:
    return new_study(short_films, 0.4, parse_options(OPTIONS))


def test_consent_comprehension_interview_and_debriefing(full_study: Study, page: Page, visitor: Visitor) -> None:
    page.emulate_media(reduced_motion="reduce")
    page.goto(full_study.address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    check_accessibility(page)
    _announced_minutes_add_up(page, "consent")
    page.keyboard.press("Enter")  # nobody agrees by accident
    visitor.sees("consent")
    page.get_by_label("I have read this").check()
    page.keyboard.press("Enter")
    _read_instructions(visitor)
    expect(page.locator("[data-view=instructions-1]")).to_contain_text(
        "Each pair is shown for about 1 s. With your answers, all pairs together take about 1 min."
    )
    expect(page.locator(".durations")).to_have_count(1)  # they were told before one agreed
    check_accessibility(page)
    page.get_by_label("I watch A to the end").check()
    page.keyboard.press("Enter")
    _read_instructions(visitor)
    page.get_by_label("I switch between").check()
    page.keyboard.press("Enter")
    for _ in range(3):
        visitor.votes("1")
    visitor.sees("interview")
    check_accessibility(page)
    page.get_by_label("How old are you?").fill("31")
    page.keyboard.press("Enter")  # does not end the interview
    page.get_by_role("radio", name="other").check()
    page.get_by_role("radio", name="4").check()
    page.get_by_label("What made one film").fill("Sharp\nedges")
    page.get_by_role("button", name="Finish").click()
    visitor.sees("thanks")
    expect(page.locator("#debriefing > p")).to_have_text(
        ["Some of the models had <b>holes</b>.", "The others had none."]
    )
    check_accessibility(page)


def test_what_was_typed_in_the_interview_outlives_an_error_and_is_then_forgotten(
    full_study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.comes_after_the_trials(full_study)
    visitor.sees("interview")
    page.get_by_label("What made one film").fill("Чёткие\nкрая")
    page.get_by_role("radio", name="other").check()
    page.route("**/stages/interview", lambda route: route.fulfill(status=422, body="{}"))
    page.get_by_role("button", name="Finish").click()
    visitor.sees("problem")
    page.unroute_all(behavior="wait")
    page.get_by_role("button", name="Try again").click()
    visitor.sees("interview")
    expect(page.get_by_label("What made one film")).to_have_value("Чёткие\nкрая")
    expect(page.get_by_role("radio", name="other")).to_be_checked()
    page.get_by_role("button", name="Finish").click()
    visitor.sees("thanks")
    assert "Чёткие" not in page.evaluate("JSON.stringify(sessionStorage)")
    answers = {row["question"]: row["answer"] for row in full_study.read("questionnaire")}
    assert answers["criteria"].split() == ["Чёткие", "края"]


def _announced_minutes_add_up(page: Page, view: str) -> None:
    announced = page.locator(f"[data-view={view}]")
    stages = [re.findall(r"\d+", line) for line in announced.locator(".durations li").all_text_contents()]
    together = sum(int(minutes) for (minutes,) in stages)
    assert len(stages) == 3
    expect(announced).to_contain_text(f"Everything together takes about {together} min:")


def _read_instructions(visitor: Visitor) -> None:
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        visitor.page.keyboard.press("Enter")
    visitor.sees("comprehension")


def test_who_does_not_agree_leaves_without_a_trace_in_the_votes(
    full_study: Study, page: Page, visitor: Visitor
) -> None:
    page.goto(full_study.address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    page.get_by_role("button", name="I do not agree").click()
    visitor.sees("no-consent")
    assert full_study.read("participants") == []  # no place was taken
    page.get_by_role("button", name="I want to read it again").click()
    visitor.sees("welcome")


def test_who_has_withdrawn_may_still_take_the_data_along_and_have_them_deleted(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.comes_after_the_trials(study)
    page.locator("[data-view=thanks]").get_by_role("button", name="Withdraw").click()
    page.get_by_role("button", name="Yes, withdraw").click()
    visitor.sees("withdrawn")
    page.reload()
    visitor.sees("withdrawn")
    with page.expect_download() as download:
        page.get_by_role("link", name="Download my data").click()
    assert '"withdrawn"' in download.value.path().read_text(encoding="utf-8")
    check_accessibility(page)
    page.get_by_role("button", name="Also delete for good what I have given").click()
    expect(page.get_by_label("Also delete for good what I have given")).to_be_checked()
    page.get_by_role("button", name="Yes, withdraw").click()
    expect(page.get_by_text("All that you gave was deleted.")).to_be_visible()
    expect(page.get_by_role("link", name="Download my data")).to_be_hidden()
    assert study.votes(0) == []


def test_nobody_agrees_by_what_another_participant_did_in_this_browser(
    full_study: Study, page: Page, visitor: Visitor
) -> None:
    """The first reads as far as the instructions, the second goes on with a session begun elsewhere."""
    page.goto(full_study.address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    page.get_by_label("I have read this").check()
    page.keyboard.press("Enter")
    visitor.sees("instructions-1")
    page.keyboard.press("Enter")
    page.reload()
    visitor.sees("instructions-2")  # who has agreed is not asked twice
    begun = httpx.post(
        f"{full_study.url}/api/v1/studies/{full_study.slug}/sessions", json={"invitation": full_study.invitation}
    ).json()
    page.goto(full_study.url)
    page.get_by_label("Code to go on").fill(begun["resume_code"])
    page.get_by_role("button", name="Go on here").click()
    visitor.sees("consent")


def test_the_next_participant_at_a_browser_finds_every_form_empty(
    full_study: Study, page: Page, visitor: Visitor
) -> None:
    introductions: list[dict[str, Any]] = []
    page.on(
        "request",
        lambda request: (
            request.url.endswith("/stages/introduction") and introductions.append(request.post_data_json["data"])
        ),
    )
    page.goto(full_study.address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    page.get_by_label("I have read this").check()
    page.keyboard.press("Enter")
    for answer in ("I watch A to the end", "I switch between"):
        _read_instructions(visitor)
        page.get_by_label(answer).check()
        page.keyboard.press("Enter")
    for number in (1, 2, 3):
        visitor.votes("1")
        visitor.is_in("exposure") if number < 3 else visitor.sees("interview")
    page.get_by_label("How old are you?").fill("31")
    page.get_by_label("What made one film").fill("Sharp edges")
    page.get_by_role("button", name="Finish").click()
    visitor.sees("thanks")
    page.get_by_role("button", name="Begin as another participant").click()
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    fields = "input:checked:not([data-single-keys]), main :is(input[type=number], textarea)"
    filled = f"[...document.querySelectorAll('main {fields}')]"
    assert page.evaluate(f"() => {filled}.filter((field) => field.checked || field.value !== '').length") == 0
    page.get_by_label("I have read this").check()
    page.keyboard.press("Enter")
    _read_instructions(visitor)
    page.reload()  # goes on with the second, not with a third
    visitor.sees("instructions-3")
    page.keyboard.press("Enter")
    page.get_by_label("I switch between").check()
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    assert [made["wrong_answers"] for made in introductions] == [1, 0]


def test_the_page_does_not_know_the_right_answer(full_study: Study) -> None:
    answers = ("wait", "switch", "count")
    html = httpx.get(full_study.address).text
    assert {html.count(f'"{answer}"') for answer in answers} == {1}
    for script in ("participant", "session"):
        text = httpx.get(f"{full_study.url}/static/js/{script}.js").text
        assert not [answer for answer in answers if f'"{answer}"' in text]


def test_the_window_is_judged_again_when_it_changes(study: Study, page: Page) -> None:
    page.set_viewport_size({"width": 800, "height": 500})
    page.goto(study.address)
    expect(page.get_by_text("Window: too small.")).to_be_visible()
    page.set_viewport_size({"width": 1366, "height": 768})
    expect(page.get_by_text("Window: large enough")).to_be_visible()
    expect(page.get_by_text(re.compile("Display: (quick enough|too slow)"))).to_be_visible()


def test_a_reference_is_shown_by_its_key_and_by_the_right_button(
    new_study: NewStudy, films: MakeFilms, page: Page, visitor: Visitor
) -> None:
    study = new_study(films(1.0, 20, squares), 20.0, parse_options({"reference": "zebra", "free_exposure": True}))
    visitor.begin(study)
    visitor.is_in("exposure")
    seen = [(visitor.badge, visitor.reads_screen()[0])]
    for press in (
        lambda: page.keyboard.press("r"),
        lambda: page.keyboard.press("Space"),  # back
        lambda: page.keyboard.press("Space"),
        lambda: page.mouse.click(300, 200, button="right"),
        lambda: page.keyboard.press("r"),  # back
    ):
        press()
        seen.append((visitor.badge, visitor.reads_screen()[0]))
    shown = dict(seen)
    assert shown["reference"] == "zebra"
    assert {shown["a"], shown["b"]} == {"heron", "otter"}
    first, other = seen[0], seen[3]
    assert seen == [first, ("reference", "zebra"), first, other, ("reference", "zebra"), other]
    page.keyboard.press("Enter")
    visitor.votes("1")
    visitor.sees("thanks")
    (trial,) = study.read("trials")
    assert [switch["to"] for switch in trial["viewing"]["switches"]][:2] == ["reference", first[0]]
    assert trial["viewing"]["dwell_ms"]["reference"] > 0


def test_a_participant_ends_a_free_exposure_by_the_button_or_by_enter(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options({"free_exposure": True}))
    visitor.begin(study)
    for end in (
        lambda: page.get_by_role("button", name="Ready to answer").click(),
        lambda: page.locator(".end-exposure kbd").click(),
        lambda: page.keyboard.press("Enter"),
    ):
        visitor.is_in("exposure")
        visitor.watches(60)  # longer than the film
        visitor.is_in("exposure")
        check_accessibility(page)
        end()
        visitor.votes("2")
    visitor.sees("thanks")
    voted = [trial["viewing"] for trial in study.read("trials") if trial["choice"]]
    assert all(viewing["shown_ms"] > 900 and viewing["switches"] == [] for viewing in voted)


def comes_to_a_break_of_90_s(new_study: NewStudy, short_films: Path, visitor: Visitor) -> None:
    """On a clock that the test turns."""
    visitor.page.clock.install()
    options = {"both_orders": True, "identical_pairs": 1, "break_every": 1, "break_s": 90}
    visitor.begin(new_study(short_films, 0.1, parse_options(options)))
    visitor.votes("2")
    visitor.sees("break")


def test_a_break_is_grey_and_its_clock_says_when_to_go_on(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    comes_to_a_break_of_90_s(new_study, short_films, visitor)
    assert (visitor.looks()[[0, 300, -1], [0, 20, -1]] == 128).all(), "no bright page between two films"
    page.clock.fast_forward(60_000)
    view = page.locator("[data-view=break]")
    expect(view.get_by_role("timer")).to_have_text(re.compile("^1:0[0-9]$"))
    expect(view).to_contain_text("You can go on in 0:")
    expect(view).to_contain_text("min left")
    expect(page.locator("#after-break")).to_be_disabled()
    page.clock.fast_forward(30_000)
    expect(view).to_contain_text("Go on whenever you like")
    page.keyboard.press("Enter")
    visitor.is_in("voting")
    expect(page.locator("#trial .left")).to_have_text(re.compile("^about [0-9]+ min left$"))


def test_a_break_cannot_be_cut_short_by_leaving_the_page(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    comes_to_a_break_of_90_s(new_study, short_films, visitor)
    page.clock.fast_forward(60_000)
    page.reload()
    visitor.sees("resume")
    page.keyboard.press("Enter")
    visitor.sees("break")
    expect(page.locator("[data-view=break]")).to_contain_text(re.compile("You can go on in 0:[0-3]"))
    expect(page.locator("#after-break")).to_be_disabled()
    page.clock.fast_forward(30_000)
    page.reload()  # the break is over: none is offered again
    visitor.sees("resume")
    page.keyboard.press("Enter")
    visitor.is_in("voting")


def test_a_pair_that_comes_again_keeps_its_number_and_a_pair_of_the_practice_says_so(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.8, parse_options({"optional_stages": ["practice"]}))
    visitor.begin(study)
    visitor.sees("practice")
    page.keyboard.press("Enter")
    visitor.is_in("voting")
    expect(page.locator("#trial .progress")).to_contain_text("Practice: Pair 1 of 2")
    expect(page.locator("#trial .left")).to_be_hidden()
    visitor.votes("1")
    visitor.sees("practice-again")
    page.keyboard.press("Enter")
    visitor.practises()
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    page.reload()  # the look is void
    visitor.sees("resume")
    page.keyboard.press("Enter")
    for label in ("Pair 2 of 3", "Pair 3 of 3", "Pair 1 of 3, once more"):
        visitor.is_in("exposure")
        page.keyboard.press("Space")
        visitor.is_in("voting")
        expect(page.locator("#trial-label")).to_have_text(label)
        visitor.votes("2")

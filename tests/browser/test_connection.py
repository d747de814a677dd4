"""No vote is lost or doubled when the connection fails."""

from __future__ import annotations

from uuid import RFC_4122, UUID

import pytest
from playwright.sync_api import Page, Route, expect

from app.operations.studies.manage import add_invitation
from app.settings import Settings
from tests.browser.study_visitor import Study, Visitor

pytestmark = pytest.mark.browser

VOTES = "**/session/trials/*/vote"


def test_the_study_goes_on_without_a_connection_as_far_as_films_are_here(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    visitor.is_in("voting")
    page.context.set_offline(True)
    visitor.votes("1")
    visitor.is_in("exposure")
    visitor.votes("3")  # the second film was here, the third trial is not known yet
    notice = page.get_by_text("The connection is interrupted")
    expect(notice).to_be_visible()
    assert study.read("votes") == []

    page.context.set_offline(False)
    visitor.is_in("exposure")
    expect(notice).to_be_hidden()
    expect(page.locator("#trial-label")).to_have_text("Pair 3 of 3")
    assert [vote["choice"] for vote in study.votes(2)] == ["a", "b"]


def test_a_begin_whose_answer_is_lost_does_not_use_an_invitation_up(
    study: Study, settings: Settings, page: Page, visitor: Visitor
) -> None:
    address = study.url + add_invitation(settings, study.slug, places=1)["path"]
    page.route("**/sessions", _lose_the_answer)
    page.goto(address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    expect(page.get_by_text("The connection is interrupted")).to_be_visible()
    page.unroute_all(behavior="wait")
    visitor.sees("instructions-1")


def _lose_the_answer(route: Route) -> None:
    route.fetch()
    route.abort("connectionreset")


def test_a_vote_whose_acknowledgement_is_lost_is_sent_again_and_counted_once(
    study: Study, page: Page, visitor: Visitor
) -> None:
    sent: list[str | None] = []

    def lose_the_first_answer(route: Route) -> None:
        sent.append(route.request.post_data)
        if len(sent) == 1:
            route.fetch()
            route.abort("connectionreset")
        else:
            route.continue_()

    page.route(VOTES, lose_the_first_answer)
    visitor.begin(study)
    visitor.votes("3")
    visitor.is_in("exposure")
    assert len(sent) == 2
    assert sent[0] == sent[1]
    assert [vote["choice"] for vote in study.votes(1)] == ["b"]


def test_an_erasure_whose_answer_is_lost_is_told_as_done(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.votes("1")
    visitor.is_in("voting")
    page.route("**/session/erasure", _lose_the_answer)
    page.get_by_role("button", name="Withdraw").click()
    page.get_by_label("Also delete for good what I have given").check()
    page.get_by_role("button", name="Yes, withdraw").click()
    expect(page.get_by_text("The connection is interrupted")).to_be_visible()
    page.unroute_all(behavior="wait")
    visitor.sees("withdrawn")
    expect(page.get_by_text("All that you gave was deleted.")).to_be_visible()
    assert study.read("votes") == []


def test_a_vote_that_was_not_sent_before_a_reload_is_sent_after_it(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    page.route(VOTES, lambda route: route.abort("connectionreset"))
    visitor.votes("1")
    visitor.is_in("exposure")
    assert study.read("votes") == []

    page.unroute_all(behavior="wait")
    page.reload()
    visitor.sees("resume")
    expect(page.locator("[data-view=resume]")).to_contain_text("1 of 3 pairs")
    assert [vote["choice"] for vote in study.votes(1)] == ["a"]


def test_votes_that_wait_leave_in_the_order_in_which_they_were_given(study: Study, page: Page) -> None:
    page.goto(study.url)
    given, listed = page.evaluate("""async () => {
        const { newId, openShelf } = await import("/static/js/outbox.js");
        const [shelf, given] = [await openShelf(), []];
        for (let number = 0; number < 6; number++) {
            given.push(newId());
            await shelf.add({ id: given.at(-1), owner: "somebody", trial: `${number}` });
            await new Promise((resolve) => setTimeout(resolve, 2));
        }
        return [given, (await shelf.list("somebody")).map((pending) => pending.id)];
    }""")
    assert listed == given
    assert {(UUID(one).version, UUID(one).variant) for one in given} == {(7, RFC_4122)}


def test_a_vote_that_is_refused_for_good_is_dropped_and_its_trial_comes_again(
    study: Study, page: Page, visitor: Visitor
) -> None:
    told: list[str] = []
    page.on("console", lambda message: told.append(message.text))
    sent: list[str] = []

    def spoil_the_first(route: Route) -> None:
        sent.append(route.request.post_data_json["id"])
        route.continue_(post_data="{}" if sent[-1] == sent[0] else None)

    page.route(VOTES, spoil_the_first)
    visitor.begin(study)
    visitor.votes("1")
    visitor.is_in("exposure")
    expect(page.locator("#trial-label")).to_have_text("Pair 1 of 3")
    for key in ("1", "2", "3"):
        visitor.votes(key)
        visitor.is_in("exposure") if key != "3" else visitor.sees("thanks")
    assert [vote["choice"] for vote in study.votes(3)] == ["a", "none", "b"]
    assert any("never be taken" in text for text in told)


def test_a_vote_stays_with_its_participant_when_the_next_one_sits_down(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    page.route(VOTES, lambda route: route.abort("connectionreset"))
    visitor.votes("1")
    visitor.is_in("exposure")
    page.goto("about:blank")
    page.unroute_all(behavior="wait")
    page.context.clear_cookies()
    page.goto(f"{study.address}?another=1")
    visitor.reads_introduction()
    visitor.votes("3")
    visitor.is_in("exposure")
    assert [vote["choice"] for vote in study.votes(1, "P002")] == ["b"]
    assert [vote["choice"] for vote in study.votes(0, "P001")] in ([], ["a"])  # it may have left with the page


def test_a_film_that_breaks_off_is_fetched_again(study: Study, page: Page, visitor: Visitor) -> None:
    attempts: list[str] = []

    def break_off_once(route: Route) -> None:
        attempts.append(route.request.url)
        if len(attempts) == 1:
            route.abort("connectionreset")
        else:
            route.continue_()

    page.route("**/media/*", break_off_once)
    visitor.begin(study)
    visitor.votes("1")
    visitor.is_in("exposure")
    assert attempts[0] == attempts[1]
    assert len(study.votes(1)) == 1


def test_the_next_films_are_in_memory_before_their_trials_begin(study: Study, page: Page, visitor: Visitor) -> None:
    fetched: list[str] = []
    page.on("requestfinished", lambda request: "/media/" in request.url and fetched.append(request.url))
    visitor.begin(study)
    visitor.is_in("voting")
    assert len(fetched) == 3
    page.route("**/media/*", lambda route: route.abort("connectionreset"))
    for number in ("1", "2"):
        visitor.votes(number)
        visitor.is_in("exposure")
    assert len(set(fetched)) == 3


def test_a_film_that_is_missing_after_the_first_trial_is_an_alarm(study: Study, page: Page, visitor: Visitor) -> None:
    shown: list[str] = []

    def first_alone(route: Route) -> None:
        if not shown:
            shown.append(route.request.url)
        if route.request.url in shown:
            route.continue_()
        else:
            route.fulfill(
                status=404, json={"detail": "This video is missing."}, content_type="application/problem+json"
            )

    page.route("**/media/*", first_alone)
    visitor.begin(study)
    visitor.votes("1")
    visitor.sees("problem")
    (failure,) = study.read("failures")
    assert failure["why"] == "404 This video is missing."


def test_a_film_that_cannot_be_shown_is_told_calmly(study: Study, page: Page, visitor: Visitor) -> None:
    page.route("**/media/*", lambda route: route.fulfill(body=b"no film", content_type="video/mp4"))
    visitor.begin(study)
    visitor.sees("problem")
    expect(page.locator("[data-view=problem]")).to_contain_text("Your answers so far are safe")

    page.unroute_all(behavior="wait")
    page.get_by_role("button", name="Try again").click()
    visitor.sees("resume")

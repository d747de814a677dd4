"""A person of a recruiting platform, from its link and back, with the detours that people make."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Route, expect

from app.study.options.options import parse_options
from tests.browser.study_visitor import NewStudy, Visitor
from tests.recruiting_platform import HOST, OPTIONS, Platform

pytestmark = [pytest.mark.browser, pytest.mark.alone]  # a countdown ends while a busy machine looks


def receives(context: BrowserContext, platform: Platform) -> None:
    """Let the platform answer at its address."""

    def answer(route: Route) -> None:
        got = platform.receive(route.request.url)
        route.fulfill(status=got.status_code, content_type="text/html", body=got.text)

    context.route(f"{HOST}/**", answer)


def test_a_person_refuses_comes_back_agrees_in_two_tabs_and_is_paid(
    new_study: NewStudy, short_films: Path, browser: Browser, page: Page, visitor: Visitor
) -> None:
    platform = Platform()
    receives(page.context, platform)
    texts = {"en": {"study.consent": "We compare models."}, "de": {"study.consent": "Wir vergleichen Modelle."}}
    options = parse_options({"outside": OPTIONS, "languages": ["en", "de"], "texts": texts})
    study = new_study(short_films, 0.4, options)
    link = platform.link(study.address, "p-1")
    page.goto(link)
    visitor.sees("welcome")
    page.get_by_role("link", name="Deutsch").click()
    page.get_by_role("link", name="English").click()  # the link's parameters live on
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    page.get_by_role("button", name="I do not agree").click()
    page.wait_for_url(f"{HOST}/no-consent?person=p-1")  # by itself, after a second
    assert study.read("participants") == []
    page.go_back()
    page.goto(link)
    visitor.sees("welcome")
    second = page.context.new_page()
    second.goto(link)
    Visitor(second).sees("welcome")
    for tab in (page, second):
        tab.bring_to_front()
        tab.keyboard.press("Enter")
        Visitor(tab).sees("consent")
        tab.get_by_label("I have read this").check()
        tab.keyboard.press("Enter")
        Visitor(tab).sees("instructions-1" if tab is page else "elsewhere")
    assert len(study.read("participants")) == 1
    second.close()
    page.bring_to_front()
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        page.keyboard.press("Enter")
    for _ in range(3):
        visitor.votes("1")
    page.wait_for_url(f"{HOST}/complete**")
    assert platform.states == {"p-1": "complete"}
    page.goto(study.address)  # the cookie says who it is
    visitor.sees("thanks")
    expect(page.locator("[data-view=thanks] .completion code")).to_have_text(platform.codes["p-1"])
    page.get_by_role("button", name="Stay on this page").click()
    expect(page.get_by_role("link", name="Back to the platform")).to_be_visible()
    expect(page.locator("[data-view=thanks] [data-soon]")).to_have_text("")
    with browser.new_context() as elsewhere:  # another browser; the link says who it is
        receives(elsewhere, platform)
        tab = elsewhere.new_page()
        tab.goto(link)
        Visitor(tab).sees("thanks")
        expect(tab.locator("[data-view=thanks] .completion code")).to_have_text(platform.codes["p-1"])


def test_who_comes_back_in_another_browser_and_does_not_agree_is_not_told_that_nothing_was_recorded(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    options = parse_options({"outside": OPTIONS, "consent": "We compare models."})
    study = new_study(short_films, 0.4, options)
    begun = {"invitation": study.invitation, "outside": {"PERSON": "p-1"}}
    httpx.post(f"{study.url}/api/v1/studies/{study.slug}/sessions", json=begun).raise_for_status()
    page.goto(Platform().link(study.address, "p-1"))
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    page.get_by_role("button", name="I do not agree").click()
    page.get_by_role("button", name="Yes, withdraw").click()
    visitor.sees("withdrawn")
    assert [person["stage"] for person in study.read("participants")] == ["withdrawn"]


def test_whose_film_fails_again_reads_one_calm_sentence_and_goes_home(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    platform = Platform()
    receives(page.context, platform)
    options = parse_options({"outside": OPTIONS, "pause_on_failures": 1})
    study = new_study(short_films, 0.4, options)
    page.route("**/media/*", lambda route: route.fulfill(body=b"no film", content_type="video/mp4"))
    page.goto(platform.link(study.address, "p-1"))
    visitor.reads_introduction()
    visitor.sees("problem")
    page.get_by_role("button", name="Try again").click()  # once: it may have been this moment alone
    visitor.sees("resume")
    page.keyboard.press("Enter")
    visitor.sees("problem")
    expect(page.locator("[data-view=problem]")).to_contain_text("The study cannot go on from here.")
    expect(page.get_by_role("button", name="Try again")).to_be_hidden()
    page.wait_for_url(f"{HOST}/no-consent?person=p-1")  # which gives the place back
    assert [row["trial"] for row in study.read("failures")] == 2 * [study.read("trials")[0]["trial"]]
    page.goto(study.address)
    visitor.sees("problem")  # nobody is sent to the same film again

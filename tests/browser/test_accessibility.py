"""axe finds nothing serious on any page that a participant sees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from app.operations.studies.manage import add_invitation
from app.settings import Settings
from app.study.options.options import parse_options
from tests.browser.accessibility import check_accessibility
from tests.browser.screening_answers import picture_of
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = pytest.mark.browser


def test_axe_finds_nothing_serious_from_the_entrance_to_the_thanks(
    study: Study, settings: Settings, page: Page, visitor: Visitor
) -> None:
    page.emulate_media(reduced_motion="reduce")  # colours are judged at rest
    page.goto(study.url)
    check_accessibility(page)
    page.goto(f"{study.url}/s/nobody")
    check_accessibility(page)
    page.goto(study.url + add_invitation(settings, study.slug, places=1)["path"])
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.is_in("voting")
    page.keyboard.press("Enter")  # which asks for a choice
    check_accessibility(page)
    page.reload()
    visitor.sees("resume")
    check_accessibility(page)
    page.keyboard.press("Enter")
    for _ in range(3):
        visitor.votes("2")
    visitor.sees("thanks")
    check_accessibility(page)


@pytest.mark.slow
def test_axe_finds_nothing_serious_on_any_page_in_another_language_and_direction(
    new_study: NewStudy, short_films: Path, page: Page
) -> None:
    """Every view of the page is shown by hand, with the texts as they stand before a session."""
    options = {"optional_stages": ["screening", "practice", "interview"], "consent": "Text.", "comprehension": True}
    options |= {"languages": ["ar"]}
    page.emulate_media(reduced_motion="reduce")
    page.goto(new_study(short_films, 0.4, parse_options(options)).address)
    page.locator("[data-view=welcome]").wait_for()
    assert page.evaluate("document.documentElement.lang") == "ar"
    views = page.evaluate("[...document.querySelectorAll('[data-view]')].map((view) => view.dataset.view)")
    assert len(views) > 25
    page.evaluate("document.getElementById('trial-label').textContent = 'Paar 1 von 3'")  # a trial names itself
    for view in views:
        page.evaluate(SHOW, view)
        check_accessibility(page)


SHOW = """(name) => {
    for (const view of document.querySelectorAll("[data-view]")) view.hidden = view.dataset.view !== name;
    document.getElementById("study").className = name === "trial" ? "dark" : "light";
}"""


def test_forced_colours_leave_films_votes_and_tests_as_they_are(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    """High contrast takes grounds away: the badge, the card, the dot, and the grey between films."""
    page.emulate_media(forced_colors="active", reduced_motion="reduce")
    options = {"optional_stages": ["screening"], "screening": {"distance": "blind spot"}}
    page.goto(new_study(short_films, 0.8, parse_options(options)).address)
    visitor.sees("welcome")
    for view, drawn in (("card", ".bank-card"), ("blind", ".blind-dot")):
        page.evaluate(SHOW, view)
        assert np.ptp(picture_of(page.locator(drawn)), axis=2).max() > 50, f"{drawn} has no colour"
    page.evaluate(SHOW, "instructions-2")
    a, b = (picture_of(letter).mean() for letter in page.locator(".try .badge span").all())
    assert a > b + 100
    visitor.begin(new_study(short_films, 0.8, parse_options({"free_exposure": True})))
    visitor.is_in("exposure")
    letters = [picture_of(letter).mean() for letter in page.locator("#trial .badge span").all()[:2]]
    assert abs(letters[0] - letters[1]) > 100
    assert (letters[0] > letters[1]) == (visitor.badge == "a")
    page.keyboard.press("Enter")
    visitor.is_in("voting")
    assert (visitor.looks()[[0, 300, -1], [0, 20, -1]] == 128).all()


def test_nothing_moves_on_the_light_pages_when_less_motion_is_preferred(
    study: Study, page: Page, visitor: Visitor
) -> None:
    page.emulate_media(reduced_motion="reduce")
    page.goto(study.address)
    visitor.sees("welcome")
    assert page.evaluate("document.getAnimations().filter((a) => a.effect.getTiming().duration > 0).length") == 0


def test_enter_follows_a_link_and_begins_nothing(study: Study, page: Page, visitor: Visitor) -> None:
    page.goto(study.address)
    visitor.sees("welcome")
    page.get_by_role("link", name="data").focus()
    with page.expect_popup() as opened:
        page.keyboard.press("Enter")
    expect(opened.value.get_by_role("heading", level=1)).to_be_visible()
    visitor.sees("welcome")
    assert study.read("participants") == []


def test_a_page_without_scripts_says_what_it_needs(study: Study, page: Page) -> None:
    without = page.context.browser.new_context(java_script_enabled=False)  # type: ignore[union-attr]
    bare = without.new_page()
    bare.goto(study.address)
    expect(bare.get_by_text("The study needs JavaScript")).to_be_visible()
    without.close()

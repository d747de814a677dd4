"""The pages of a study on small and usual displays; each is shown by hand, as it stands before a session."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from app.study.options.options import parse_options
from tests.browser.study_visitor import NewStudy

pytestmark = pytest.mark.browser

OPTIONS = {
    "optional_stages": ["screening", "practice", "interview"],
    "consent": "You may stop at any time.\n\n" * 30,
    "consent_version": "2",
    "comprehension": True,
    "reference": "zebra",
    "questions": [
        {"name": "age", "kind": "number", "required": True},
        {"name": "criteria", "kind": "text"},
        {
            "name": "sure",
            "kind": "scale",
            "maximum": 11,
            "text": "How sure were you?",
            "labels": ["not sure at all, I guessed nearly all of the time", "completely sure of nearly every choice"],
        },
    ],
}
SHOW = """(name) => {
  for (const view of document.querySelectorAll("[data-view]")) view.hidden = view.dataset.view !== name;
  document.getElementById("plate").hidden = false;
}"""
RATED_IN_GERMAN = {"protocol": "ACR", "reference": "", "languages": ["de"], "consent": "", "questions": []}
SHOW_VOTE = """() => {
  const trial = document.getElementById("trial");
  trial.dataset.state = "voting";
  for (const part of trial.querySelectorAll("[data-label]")) part.textContent = part.dataset.label;
  const hint = trial.querySelector(".choose");
  hint.textContent = hint.dataset.choose;
  trial.querySelector("[data-fullscreen]").hidden = false;
}"""
ShowView = Callable[[str, int, int], Locator]


@pytest.fixture
def show_view(request: pytest.FixtureRequest, new_study: NewStudy, short_films: Path, page: Page) -> ShowView:
    """Shows a view of a study in a window of this size; a test may change its options."""
    address = new_study(short_films, 0.4, parse_options(OPTIONS | getattr(request, "param", {}))).address
    page.emulate_media(reduced_motion="reduce")

    def show(view: str, width: int, height: int) -> Locator:
        page.set_viewport_size({"width": width, "height": height})
        page.goto(address)
        page.locator("[data-view=welcome]").wait_for()
        page.evaluate(SHOW, view)
        return page.locator(f"[data-view={view}]")

    return show


def box_of(element: Locator) -> dict[str, Any]:
    box = element.bounding_box()
    assert box is not None
    return {"left": box["x"], "right": box["x"] + box["width"], "top": box["y"], "bottom": box["y"] + box["height"]}


@pytest.mark.parametrize("show_view", [{}, {"consent": ""}], indirect=True, ids=["consent", "no consent"])
def test_every_page_but_the_questionnaire_and_the_consent_is_seen_whole(show_view: ShowView) -> None:
    view = show_view("welcome", 1366, 768)
    names = view.page.locator("[data-view]").evaluate_all("(views) => views.map((view) => view.dataset.view)")
    heights = {}
    for name in names:
        view.page.evaluate(SHOW, name)
        heights[name] = view.page.evaluate("document.documentElement.scrollHeight")
    for long in ("interview", "consent"):
        heights.pop(long, None)
    assert {name: higher for name, higher in heights.items() if higher > 768} == {}


@pytest.mark.parametrize("show_view", [{}, RATED_IN_GERMAN], indirect=True, ids=["PC", "ACR"])
@pytest.mark.parametrize(("width", "height"), [(320, 640), (683, 384)])
def test_in_a_small_window_nothing_of_the_vote_lies_over_anything_else(
    show_view: ShowView, page: Page, width: int, height: int
) -> None:
    """683 x 384 is a laptop's window of 1366 x 768 at a zoom of 200 %."""
    trial = show_view("trial", width, height)
    page.evaluate(SHOW_VOTE)
    parts = trial.locator(".choice, .choose, .next, .progress > p, .foot-after button").locator("visible=true")
    boxes = [box_of(part) for part in parts.all()]
    for number, one in enumerate(boxes):
        assert one["left"] >= 0
        assert one["right"] <= width
        for other in boxes[:number]:
            is_beside = one["left"] >= other["right"] or one["right"] <= other["left"]
            assert is_beside or one["top"] >= other["bottom"] - 1 or one["bottom"] <= other["top"] + 1
    for word in trial.locator(".choice span").all():
        assert box_of(word)["right"] <= box_of(word.locator(".."))["right"]


def test_eleven_steps_of_a_scale_stand_in_one_row(show_view: ShowView) -> None:
    view = show_view("interview", 1366, 768)
    steps = [box_of(step) for step in view.locator(".scale-steps label").all()]
    assert len(steps) == 11
    assert {step["top"] for step in steps} == {steps[0]["top"]}


def test_required_questions_are_marked_and_no_others(show_view: ShowView) -> None:
    view = show_view("interview", 1366, 768)
    expect(view.get_by_label("How old are you? required")).to_be_visible()
    assert view.get_by_text("required", exact=True).count() == 1
    expect(view.get_by_text("Please answer the questions marked as required.")).to_be_visible()


@pytest.mark.parametrize(("width", "height"), [(1000, 550), (600, 900)])
def test_a_plate_and_its_dial_are_whole_and_apart(show_view: ShowView, width: int, height: int) -> None:
    view = show_view("plates", width, height)
    plate, dial = box_of(view.locator("#plate")), box_of(view.locator(".dial"))
    for box in (plate, dial):
        assert 0 <= box["left"] < box["right"] <= width
        assert 0 <= box["top"] < box["bottom"] <= height
    assert plate["right"] <= dial["left"] or plate["bottom"] <= dial["top"]


def test_a_large_card_and_its_buttons_fit_into_a_small_window(show_view: ShowView) -> None:
    view = show_view("card", 1024, 600)
    view.locator(".bank-card").evaluate("(card) => card.style.setProperty('--width', '420px')")
    assert box_of(view.locator("#card-fits"))["bottom"] <= 600


def test_people_are_asked_to_turn_off_night_mode_before_the_plates(show_view: ShowView) -> None:
    expect(show_view("plates-intro", 1366, 768).get_by_text("Please turn off night mode")).to_be_visible()

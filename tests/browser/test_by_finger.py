"""A telephone: everything is tapped, nothing speaks of mouse or keys, and who is not let in is told first."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from app.study.options.options import parse_options
from app.study.options.presets import read_preset
from tests.browser.study_visitor import NewStudy, Visitor
from tests.conftest import BROWSER_TIMEOUT_MS

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FINGER_PX = 44
SMALL = """() => [...document.querySelectorAll("button, .choice, a, input")].filter((one) => {
  const { width, height } = (one.closest("label") ?? one).getBoundingClientRect();
  const isInText = one.matches("a") && one.closest("p, li") !== null;
  return one.checkVisibility({ visibilityProperty: true }) && !isInText && (width < 44 || height < 44);
}).map((one) => one.outerHTML)"""


@pytest.fixture
def phone(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    context.set_default_timeout(BROWSER_TIMEOUT_MS)
    yield context.new_page()
    context.close()


def test_a_study_is_taken_by_taps_alone(new_study: NewStudy, short_films: Path, phone: Page) -> None:
    study = new_study(short_films, 1.6, parse_options({"optional_stages": [], "consent": "Films."}), see_both=True)
    visitor = Visitor(phone)
    phone.goto(study.address)
    visitor.sees("welcome")
    expect(phone.get_by_text("A computer, a tablet or a phone will do.")).to_be_visible()

    def taps(view: str) -> None:
        visitor.sees(view)
        text = phone.locator("main").inner_text()
        assert not {"mouse", "Space", "Enter", "Arrow"} & set(text.split()), text
        assert phone.evaluate(SMALL) == []
        assert phone.evaluate("document.documentElement.scrollWidth") <= 390
        phone.locator(f"[data-view={view}] .foot .button-primary").tap()

    taps("welcome")
    visitor.sees("consent")
    phone.get_by_label("I have read this").tap()
    for view in ("consent", "instructions-1", "instructions-2", "instructions-3"):
        taps(view)
    for _ in range(3):
        visitor.is_in("exposure")
        phone.touchscreen.tap(195, 400)
        visitor.is_in("voting")
        assert phone.evaluate(SMALL) == []
        phone.locator(".choice").first.tap()
        phone.locator("#trial .next").tap()
    visitor.sees("thanks")
    assert [len(trial["viewing"]["switches"]) for trial in study.read("trials")] == [1, 1, 1]


def test_no_page_of_the_eye_tests_tells_a_finger_of_keys(new_study: NewStudy, short_films: Path, phone: Page) -> None:
    screening = {"tests": ["acuity", "colour"], "distance": "blind spot"}
    study = new_study(short_films, 0.4, parse_options({"optional_stages": ["screening"], "screening": screening}))
    Visitor(phone).begin(study)
    Visitor(phone).sees("screening")
    text = phone.evaluate(
        "[...document.querySelectorAll('[data-view]')].map((one) => { one.hidden = false; return one.innerText; })"
    )
    said = " ".join(text)
    assert "Tap the arrow that points to the gap" in said
    assert "Tap anywhere on the screen" in said
    named = re.findall(r"[^.]*\b(?:keys?|keyboard|space bar|mouse)\b[^.]*", said, re.IGNORECASE)
    assert [sentence for sentence in named if "on a keyboard" not in sentence] == []


def test_the_papers_preset_tells_a_telephone_first_that_it_needs_a_computer(
    new_study: NewStudy, short_films: Path, phone: Page
) -> None:
    options = parse_options({**read_preset("paper").options, "languages": ["en"]})
    study = new_study(short_films, 0.4, options)
    phone.goto(study.address)
    Visitor(phone).sees("turned-away")
    expect(phone.get_by_text("This study needs a computer")).to_be_visible()
    assert study.read("participants") == []

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
KEYS = {  # what only a mouse or a keyboard has
    "en": r"\b(?:keys?|keyboard|space bar|mouse)\b",
    "de": r"\b(?:\w*taste|tasten|tastatur|maus)\b",
    "fr": r"\b(?:touches?|clavier|souris|espace)\b",
    "es": r"\b(?:teclas?|teclado|ratón)\b",
    "zh": "键|鼠标",
    "ar": "مفتاح|مفاتيح|الفأرة",
}
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


@pytest.mark.parametrize("language", KEYS)
def test_no_page_tells_a_finger_of_keys_in_any_language(
    new_study: NewStudy, short_films: Path, phone: Page, language: str
) -> None:
    screening = {"tests": ["acuity", "colour"], "distance": "blind spot"}
    optional = ["screening", "practice", "interview"]
    options = {"optional_stages": optional, "screening": screening, "reference": "zebra", "languages": [language]}
    study = new_study(short_films, 0.4, parse_options(options))
    phone.goto(study.address)
    Visitor(phone).sees("welcome")
    text = phone.evaluate(
        "[...document.querySelectorAll('[data-view]:not([data-view=turned-away])')]"
        ".map((one) => { one.hidden = false; return one.innerText; })"
    )
    said = " ".join(text)
    assert re.findall(rf"[^.。]*(?:{KEYS[language]})[^.。]*", said, re.IGNORECASE) == []


def test_a_telephone_that_is_let_in_is_not_told_to_make_its_window_larger(
    new_study: NewStudy, short_films: Path, phone: Page
) -> None:
    phone.goto(new_study(short_films, 0.4).address)
    Visitor(phone).sees("welcome")
    expect(phone.locator("[data-check=codec]")).to_be_visible()
    expect(phone.locator("[data-check=window]")).to_be_hidden()


def test_the_steps_of_a_long_scale_stand_within_a_telephones_page(
    new_study: NewStudy, short_films: Path, phone: Page
) -> None:
    labels = ["not sure at all, I guessed nearly all of the time", "completely sure of nearly every choice"]
    sure = {"name": "sure", "kind": "scale", "maximum": 11, "text": "How sure were you?", "labels": labels}
    study = new_study(short_films, 0.4, parse_options({"optional_stages": ["interview"], "questions": [sure]}))
    phone.goto(study.address)
    Visitor(phone).sees("welcome")
    phone.locator("[data-view=interview]").evaluate("(view) => (view.hidden = false)")
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    places = [step.bounding_box() for step in phone.locator(".scale-steps label").all()]
    assert len(places) == 11
    assert all(place and min(place["width"], place["height"]) >= FINGER_PX for place in places)


def test_the_papers_preset_tells_a_telephone_first_that_it_needs_a_computer(
    new_study: NewStudy, short_films: Path, phone: Page
) -> None:
    options = parse_options({**read_preset("paper").options, "languages": ["en"]})
    study = new_study(short_films, 0.4, options)
    phone.goto(study.address)
    Visitor(phone).sees("turned-away")
    expect(phone.get_by_text("This study needs a computer")).to_be_visible()
    assert study.read("participants") == []

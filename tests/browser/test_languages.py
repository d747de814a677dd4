"""A whole study in a right-to-left language, and a session that goes on in its own language in any browser."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.study.options.options import parse_options
from tests.browser.accessibility import check_accessibility
from tests.browser.study_visitor import NewStudy, Visitor

pytestmark = pytest.mark.browser

ARABIC = {
    "languages": ["ar"],
    "optional_stages": ["practice", "interview"],
    "comprehension": True,
    "consent": "نقارن بين نماذج.\n\n- يمكنك التوقف **في أي وقت**.",
    "debriefing": "صُنعت النماذج [بطرق مختلفة](https://example.org).",
    "texts": {"ar": {"study.name": "دراسة النماذج", "trial.question": "أيّهما أقرب إلى الطبيعة؟"}},
}
LATIN_WORDS = {"A", "B", "R", "Esc", "Enter"}  # names of films and keys
SHOWN = """() => {
    const words = [];
    const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walk.nextNode()) {
        const { parentElement: place, textContent } = walk.currentNode;
        if (place.checkVisibility({ visibilityProperty: true })) words.push(textContent);
    }
    return words.join(" ");
}"""


RESUME_CODE = r"\b[a-z0-9]{8,}\b"


def is_arabic(page: Page) -> None:
    """Check that no Latin letters are shown but names and keys, and that the page runs from right to left."""
    words = re.sub(RESUME_CODE, "", str(page.evaluate(SHOWN)))
    assert set(re.findall(r"[A-Za-z]+", words)) <= LATIN_WORDS
    assert page.evaluate("getComputedStyle(document.body).direction") == "rtl"
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_a_study_in_arabic_is_arabic_from_the_welcome_to_the_debriefing(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.8, parse_options(ARABIC))  # time to switch during the practice
    page.emulate_media(reduced_motion="reduce")
    page.goto(study.address)
    expect(page).to_have_title(re.compile("دراسة النماذج$"))
    for view in ("welcome", "consent"):
        visitor.sees(view)
        is_arabic(page)
        check_accessibility(page)
        if view == "consent":
            page.get_by_role("checkbox").check()
        page.keyboard.press("Enter")
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        is_arabic(page)
        page.keyboard.press("Enter")
    visitor.sees("comprehension")
    is_arabic(page)
    page.get_by_role("radio").nth(1).check()
    page.keyboard.press("Enter")
    visitor.sees("practice")
    is_arabic(page)
    page.keyboard.press("Enter")
    for _ in range(2):
        visitor.is_in("exposure")
        page.keyboard.press(" ")
        visitor.votes("2")
    visitor.sees("practice-done")
    is_arabic(page)
    page.keyboard.press("Enter")
    for _ in range(3):
        visitor.is_in("voting")
        expect(page.get_by_text("أيّهما أقرب إلى الطبيعة؟")).to_be_visible()
        is_arabic(page)
        visitor.votes("1")
    visitor.sees("interview")
    is_arabic(page)
    check_accessibility(page)
    page.get_by_role("button", name="إنهاء").click()
    visitor.sees("thanks")
    is_arabic(page)
    link = page.locator("#debriefing a")
    expect(link).to_have_attribute("target", "_blank")
    expect(link).to_have_attribute("rel", "noopener noreferrer")
    assert {vote["choice"] for vote in study.votes(3)} == {"a"}
    (participant,) = study.read("participants")
    assert participant["language"] == "ar"


def test_the_first_answer_stands_first_in_reading_direction_and_the_film_is_not_turned(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    lefts, films = [], []
    for language in ("en", "ar"):
        page.context.clear_cookies()
        visitor.begin(new_study(short_films, 0.4, parse_options({"languages": [language]})))
        visitor.is_in("voting")
        lefts.append([box["x"] for radio in page.locator(".choice").all() if (box := radio.bounding_box())])
        films.append(page.locator(".film video, .film canvas").first.bounding_box())
    assert lefts[0] == sorted(lefts[0])
    assert lefts[1] == sorted(lefts[1], reverse=True)
    assert films[0] == films[1]


def test_a_session_goes_on_in_its_language_in_a_browser_of_another(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options({"languages": ["en", "fr"]}))
    page.goto(f"{study.address}?language=fr")
    visitor.reads_introduction()
    visitor.is_in("voting")
    page.goto(f"{study.address}?language=en")
    visitor.sees("resume")
    expect(page.get_by_role("heading", name="Heureux de vous revoir")).to_be_visible()
    expect(page.locator("[data-view=resume] .lead")).to_contain_text("0 paire sur 3")

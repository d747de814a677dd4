"""What a study asks of a display, a window and a look before a film is shown or a vote is taken."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from statistics import median

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page, Route, expect

from app.study.options.options import StudyOptions
from tests.browser.numbered_films import HEIGHT, WIDTH
from tests.browser.study_visitor import MakeFilms, NewStudy, Study, Visitor
from tests.conftest import BROWSER_TIMEOUT_MS

pytestmark = pytest.mark.browser

REFUSE_FULL_SCREEN = "() => { document.documentElement.requestFullscreen = () => Promise.reject(); }"
ALLOW_FULL_SCREEN = "() => { delete document.documentElement.requestFullscreen; }"
OTHER_WINDOW = "window.dispatchEvent(new Event('blur'))"
DISPLAY = {"width": 1920, "height": 1080}
PATCH = 4  # pixels of a pattern's squares
DARK, LIGHT = 64, 192


def test_the_vote_waits_until_each_of_both_was_seen_for_as_long_as_the_study_says(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 1.6, StudyOptions(minimum_viewing_s=0.3))
    visitor.begin(study)
    visitor.is_in("unseen")
    expect(page.locator("#unseen")).to_contain_text("at least 0.3 s.")
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    page.keyboard.press("Space")
    visitor.votes("1")
    study.votes(1)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
    assert min(viewing["dwell_ms"].values()) >= 300


def test_no_film_is_shown_without_a_full_screen_that_is_required(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.8, StudyOptions(full_screen="required", void_on=()))
    visitor.begin(study)
    visitor.is_in("exposure")
    page.evaluate("document.exitFullscreen()")
    visitor.sees("interrupted")
    page.keyboard.press("Enter")
    visitor.is_in("voting")
    page.evaluate("document.exitFullscreen()")
    page.evaluate(REFUSE_FULL_SCREEN)
    visitor.votes("1")
    visitor.is_in("unready")
    expect(page.locator("#unready")).to_contain_text("The films are shown in the full screen")
    page.evaluate(ALLOW_FULL_SCREEN)
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    assert page.evaluate("document.fullscreenElement !== null")


def visit(browser: Browser, study: Study, *, screen: dict[str, int], window: dict[str, int], ratio: float = 1) -> Page:
    """Opens a study in a window on a display."""
    context = browser.new_context(screen=screen, viewport=window, device_scale_factor=ratio)  # type: ignore[arg-type]
    context.set_default_timeout(BROWSER_TIMEOUT_MS)
    page = context.new_page()
    page.goto(study.address)
    return page


def test_films_wait_for_a_window_of_the_minimum_size(new_study: NewStudy, short_films: Path, browser: Browser) -> None:
    study = new_study(short_films, 0.8, StudyOptions(minimum_window=(1000, 600)))
    page = visit(browser, study, screen=DISPLAY, window={"width": 960, "height": 700})
    visitor = Visitor(page)
    visitor.reads_introduction()
    visitor.is_in("unready")
    expect(page.locator("#unready")).to_contain_text("too small")
    page.set_viewport_size({"width": 1000, "height": 600})
    visitor.is_in("exposure")
    page.context.close()


def test_a_display_below_the_minimum_is_told_before_the_study_begins(
    new_study: NewStudy, short_films: Path, browser: Browser
) -> None:
    study = new_study(short_films, 0.8, StudyOptions(minimum_window=(1280, 720)))
    page = visit(browser, study, screen={"width": 1024, "height": 768}, window={"width": 1024, "height": 600})
    Visitor(page).sees("turned-away")
    expect(page.get_by_text("The films need a larger display")).to_be_visible()
    assert study.read("participants") == []
    page.context.close()


def checks(condition: int, _frame: int) -> NDArray[np.uint8]:
    """A board of small squares: a picture that is scaled does not look like it."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] // PATCH
    return np.where((rows + columns + condition) % 2, LIGHT, DARK).astype(np.uint8)


@pytest.mark.parametrize("ratio", [1, 1.25])
def test_one_to_one_shows_every_pixel_of_a_film_as_one_of_the_display(
    new_study: NewStudy, films: MakeFilms, browser: Browser, ratio: float
) -> None:
    study = new_study(films(25.0, 20, checks), 1.6, StudyOptions(pixels="1:1"))
    page = visit(browser, study, screen=DISPLAY, window={"width": 960, "height": 540}, ratio=ratio)
    visitor = Visitor(page)
    visitor.reads_introduction()
    visitor.is_in("exposure")
    screen = visitor.looks()
    board = checks(0, 0)
    top, left = ((length - film) // 2 for length, film in zip(screen.shape, board.shape, strict=True))
    places = product((top, top + 1), (left, left + 1))  # the middle may lie between two pixels
    shown = [screen[row : row + HEIGHT, column : column + WIDTH] for row, column in places]
    likeness = [
        abs(np.corrcoef(picture.ravel(), board.ravel())[0, 1]) for picture in shown
    ]  # B is the board's negative
    assert max(likeness) > 0.95
    page.context.close()


def test_a_window_without_room_for_a_film_one_to_one_says_so(
    new_study: NewStudy, short_films: Path, browser: Browser
) -> None:
    study = new_study(short_films, 0.8, StudyOptions(pixels="1:1"))
    page = visit(browser, study, screen=DISPLAY, window={"width": 300, "height": 540})
    visitor = Visitor(page)
    visitor.reads_introduction()
    visitor.is_in("unready")
    page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    visitor.is_in("exposure")
    page.context.close()


def test_what_happens_between_two_trials_is_in_the_record_of_the_next(
    study: Study, page: Page, visitor: Visitor
) -> None:
    waiting: list[Route] = []
    visitor.begin(study)
    visitor.is_in("voting")
    page.route("**/trials/next", lambda route: waiting.append(route))
    with page.expect_request("**/trials/next"):
        visitor.votes("1")
    page.evaluate(OTHER_WINDOW)
    waiting[0].continue_()
    page.unroute_all(behavior="wait")
    visitor.is_in("exposure")
    visitor.votes("2")
    study.votes(2)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"] == "none")
    assert "blur" in [event["what"] for event in viewing["happened"] if event["at_ms"] < 0]


def test_each_press_says_when_its_picture_was_presented(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    for _ in range(3):
        page.keyboard.press("Space")
        visitor.watches(5)
    visitor.votes("1")
    (vote,) = study.votes(1)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
    times = [(switch["at_ms"], switch["frame_ms"], switch["presented_ms"]) for switch in viewing["switches"]]
    assert len(times) == 3
    assert all(at < presented and drawn < presented for at, drawn, presented in times)
    assert vote["press_to_picture_ms"] == pytest.approx(median(presented - at for at, _, presented in times), abs=0.1)

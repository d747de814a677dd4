"""A and B show the same frame at every moment, read from the pixels on the screen."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from app.study.options.options import parse_options
from tests.browser.numbered_films import DARK, HEIGHT, LIGHT, WIDTH, decode_squares, squares
from tests.browser.playback_techniques import leave_only
from tests.browser.study_visitor import MakeFilms, NewStudy, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FPS = 1.0  # a frame stays long enough for three pictures of the screen, also on a busy machine
N_FRAMES = 10
FEWEST_MOMENTS = 4
LATE = {"stacked": 1, "webcodecs": 0}  # frames: browsers tell of a video's when it is on screen, a busy machine late
NO_SHIFT = 4  # grey levels: what compression leaves between the halves; a shift by half a pixel gives 25 and more
BADGE = np.s_[:90, :160]  # it tells A from B and so differs


@pytest.mark.alone
@pytest.mark.parametrize("technique", ["stacked", "webcodecs"])
def test_a_and_b_are_the_same_frame_whenever_the_participant_switches(
    technique: str, new_study: NewStudy, films: MakeFilms, page: Page, visitor: Visitor
) -> None:
    leave_only(page, technique)
    study = new_study(films(FPS, N_FRAMES, squares), N_FRAMES / FPS)
    visitor.begin(study)
    visitor.is_in("exposure")
    moments = []
    while True:
        one = visitor.looks()
        page.keyboard.press("Space")
        other = visitor.looks()
        page.keyboard.press("Space")
        again = visitor.looks()
        if page.locator("#trial").get_attribute("data-state") != "exposure":
            break
        if decode_squares(one) == decode_squares(again):  # else the film went on in between, which says nothing
            moments.append((decode_squares(one), decode_squares(other)))
    assert len({frame for (_, frame), _ in moments}) >= FEWEST_MOMENTS
    for (one_condition, one_frame), (other_condition, other_frame) in moments:
        assert one_frame == other_frame
        assert one_condition != other_condition
    viewing = visitor.finishes_first_trial(study)
    assert viewing["technique"] == technique
    assert viewing.get("n_mismatches", 0) == 0
    recorded = {switch["frame"] for switch in viewing["switches"]}
    for (_, frame), _ in moments:
        assert recorded & {frame, frame - LATE[technique]}


@pytest.mark.alone
@pytest.mark.parametrize("technique", ["stacked", "webcodecs"])
def test_a_stimulus_is_on_the_screen_as_soon_as_it_is_switched_to(
    technique: str, new_study: NewStudy, films: MakeFilms, page: Page, visitor: Visitor
) -> None:
    leave_only(page, technique)
    study = new_study(films(5.0, 60, squares), 12.0)
    visitor.begin(study)
    visitor.is_in("exposure")
    visitor.watches(30)  # long enough for a browser to rest from painting what is not shown
    visitor.looks()
    (one, _), (other, _) = visitor.reads_both()
    assert one != other


def test_without_films_of_pairs_single_films_are_decoded_together_and_no_address_shows_one_as_both(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(short_films, 0.4, parse_options({"pair_films": "decoded"}))
    visitor.begin(study)
    assert visitor.finishes_first_trial(study)["technique"] == "webcodecs"
    (trial,) = (trial["trial"] for trial in study.read("trials") if trial["choice"])
    answers = [page.request.get(f"{study.url}/media/{trial}{kind}").status for kind in ("", ".top", ".bottom")]
    assert answers == [404, 200, 200]


def test_a_browser_that_could_play_two_videos_only_is_turned_away(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    """Nothing keeps two players at the same frame; a study that once allowed them means the other fallback now."""
    study = new_study(short_films, 1.6, parse_options({"fallback": "two videos"}))
    leave_only(page, "two videos")
    page.goto(study.address)
    visitor.sees("welcome")
    expect(page.get_by_text("cannot play the study")).to_be_visible()
    expect(page.locator("#begin")).to_be_hidden()


@pytest.mark.alone
def test_films_that_begin_again_stay_in_step_when_decoded(
    new_study: NewStudy, films: MakeFilms, page: Page, visitor: Visitor
) -> None:
    leave_only(page, "webcodecs")
    study = new_study(films(5.0, 10, squares), 6.0)
    visitor.begin(study)
    visitor.is_in("exposure")
    frames = []
    while True:
        screen = visitor.looks()
        page.keyboard.press("Space")
        if page.locator("#trial").get_attribute("data-state") != "exposure":
            break
        frames.append(decode_squares(screen)[1])
    viewing = visitor.finishes_first_trial(study)
    assert viewing["n_mismatches"] == 0
    assert viewing["n_frames"] == 30
    assert any(after < before for before, after in pairwise(frames))


@pytest.mark.parametrize("size", [(1366, 768), (1201, 800), (700, 900)])
def test_nothing_moves_on_the_screen_when_both_stimuli_are_alike(
    size: tuple[int, int], new_study: NewStudy, films: MakeFilms, page: Page, visitor: Visitor
) -> None:
    """Both halves are scaled alike at any size of the window, and neither shows a row of the other."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    visitor.begin(new_study(films(5.0, 60, _stripes), 12.0))
    visitor.is_in("exposure")
    height = page.locator(".film").evaluate("(film) => film.getBoundingClientRect().height")
    assert height == int(height)  # Firefox would let the ground through a part of the last row, below one stimulus only
    one = visitor.looks()
    page.keyboard.press("Space")
    other = visitor.looks()
    for screen in (one, other):
        screen[BADGE] = 0
    assert one.std() > 50  # the stripes are there
    assert np.abs(one.astype(int) - other).max() <= NO_SHIFT


def _stripes(_condition: int, _frame: int) -> NDArray[np.uint8]:
    """Narrow stripes, dark at the one edge and light at the other: any shift or foreign row would be seen."""
    rows = np.where(np.arange(HEIGHT) // 6 % 2, LIGHT, DARK).astype(np.uint8)
    rows[-6:] = LIGHT
    return np.repeat(rows[:, None], WIDTH, axis=1)

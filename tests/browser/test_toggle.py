"""A and B show the same frame at every moment, read from the pixels on the screen."""

from __future__ import annotations

import numpy as np
import pytest
from films import DARK, HEIGHT, LIGHT, WIDTH, decode_squares, squares
from numpy.typing import NDArray
from playwright.sync_api import Page
from visitor import MakeFilms, NewStudy, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FPS = 1.0  # a frame stays long enough for three pictures of the screen, also on a busy machine
N_FRAMES = 14
FEWEST_MOMENTS = 4
NO_SHIFT = 4  # grey levels: what compression leaves between the halves; a shift by half a pixel gives 25 and more
BADGE = np.s_[:90, :160]  # it tells A from B and so differs


def test_a_and_b_are_the_same_frame_whenever_the_participant_switches(
    new_study: NewStudy, films: MakeFilms, page: Page, visitor: Visitor
) -> None:
    visitor.begin(new_study(films(FPS, N_FRAMES, squares), N_FRAMES / FPS))
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


@pytest.mark.parametrize("size", [(1366, 768), (1201, 800), (700, 900)])
def test_nothing_moves_on_the_screen_when_both_stimuli_are_alike(
    size: tuple[int, int], new_study: NewStudy, films: MakeFilms, page: Page, visitor: Visitor
) -> None:
    """Both halves are scaled alike at any size of the window, and neither shows a row of the other."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    visitor.begin(new_study(films(5.0, 20, _stripes), 4.0))
    visitor.is_in("exposure")
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

"""Where finer levels search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.depth.matching.hierarchy import MARGIN, REACH, TILE, halved, halved_mask, search_windows


@pytest.mark.slow
@settings(deadline=None)  # the first call compiles
@given(seed=st.integers(0, 50), height=st.integers(1, 40), width=st.integers(1, 40), n_disparities=st.integers(17, 90))
def test_everything_found_nearby_is_searched_if_two_windows_can_hold_it(
    seed: int, height: int, width: int, n_disparities: int
) -> None:
    rng = np.random.default_rng(seed)
    found = rng.integers(0, n_disparities // 2, (height, width)).astype(np.int32)
    valid = rng.random((height, width)) < 0.3
    far, near = search_windows(found, valid, (2 * height, 2 * width), n_disparities, shift=0)
    for y, x in rng.integers((0, 0), (2 * height, 2 * width), (20, 2)):
        row, column = y // 2 // TILE * TILE, x // 2 // TILE * TILE
        around = (
            slice(max(row - REACH, 0), row + TILE + REACH),
            slice(max(column - REACH, 0), column + TILE + REACH),
        )
        counted = found[around][valid[around]] if valid[around].any() else found[around]
        starts = far[y // (2 * TILE), x // (2 * TILE)], near[y // (2 * TILE), x // (2 * TILE)]
        assert 0 <= starts[0] <= starts[1] <= n_disparities - 16
        if 2 * (counted.max() - counted.min() + 1) + 2 * MARGIN <= 32:
            for wanted in range(2 * counted.min() - MARGIN, 2 * counted.max() + 2 + MARGIN):
                assert any(start <= min(max(wanted, 0), n_disparities - 1) < start + 16 for start in starts)


def test_of_three_surfaces_the_two_that_most_pixels_saw_are_searched() -> None:
    found = np.full((12, 12), 30, np.int32)  # coarse; the middle tile is its rows and columns 4 to 7
    found[:, 7:] = 60
    found[4, 5] = 3  # a stray match far behind both
    far, near = search_windows(found, found > 0, (24, 24), 128, shift=0)
    assert far[1, 1] <= 60 - MARGIN < 61 + MARGIN < far[1, 1] + 16
    assert near[1, 1] <= 120 - MARGIN < 121 + MARGIN < near[1, 1] + 16


def test_the_level_below_may_start_at_an_odd_disparity() -> None:
    found = np.full((4, 4), 10, np.int32)
    even, _ = search_windows(found, found > 0, (8, 8), 60, shift=0)
    odd, _ = search_windows(found, found > 0, (8, 8), 60, shift=-1)
    assert odd[0, 0] == even[0, 0] - 1


def test_half_an_image_is_the_mean_of_four_pixels() -> None:
    image = np.array([[0, 4, 8], [4, 8, 8], [20, 20, 100]], np.uint8)
    np.testing.assert_array_equal(halved(image), [[4, 8], [20, 100]])


@pytest.mark.parametrize(("pixels", "kept"), [(0, False), (1, False), (2, True), (4, True)])
def test_half_a_mask_is_foreground_where_two_of_four_pixels_are(pixels: int, kept: bool) -> None:
    mask = np.zeros(4, np.bool_)
    mask[:pixels] = True
    assert halved_mask(mask.reshape(2, 2)).item() is kept

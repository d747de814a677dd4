"""The left/right check against a plain reference."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.depth.consistency import consistent, lands_inside


@settings(deadline=None)  # the first call compiles
@given(seed=st.integers(0, 200), min_disparity=st.integers(-3, 3), threshold=st.integers(0, 2))
def test_a_match_counts_where_the_other_view_points_back(seed: int, min_disparity: int, threshold: int) -> None:
    rng = np.random.default_rng(seed)
    left, right = rng.integers(0, 5, (2, 6, 11)).astype(np.int32)
    confirmed = consistent(left, right[:, ::-1], min_disparity=min_disparity, threshold=threshold)
    for y in range(6):
        for x in range(11):
            matched = x - (left[y, x] + min_disparity)
            agrees = 0 <= matched < 11 and abs(left[y, x] - right[y, matched]) <= threshold
            assert confirmed[y, x] == agrees


def test_fractions_are_compared_as_they_are_at_the_nearest_pixel() -> None:
    left = np.full((1, 10), 3.4, np.float32)
    mirrored = np.full((1, 10), 3.7, np.float32)
    assert consistent(left, mirrored, threshold=0.5)[0, 3:].all()
    assert not consistent(left, mirrored, threshold=0.2).any()
    assert not consistent(left, mirrored, threshold=0.5)[0, :3].any()


def test_a_match_half_a_pixel_beyond_the_border_still_lands_inside() -> None:
    disparity = np.array([[0.5, 2.0, 2.5, -0.6, -0.4]], np.float32)
    np.testing.assert_array_equal(lands_inside(disparity), [[True, False, True, True, True]])
    assert not lands_inside(np.array([[0.6, -2.0]], np.float32)).any()

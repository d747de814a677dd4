"""SGM: OpenCV's matcher behind the contract of all matchers."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.depth import DEFAULTS, StereoPair, match_sgm
from recon.depth.semi_global import LARGEST_STEP, SgmParameters
from tests.recon.depth.test_cvf import layered_pair
from tests.recon.depth.test_matchers import shifted_pair, texture


def test_inside_the_picture_it_is_opencvs_own_answer() -> None:
    pair, _ = layered_pair()
    pair = StereoPair(pair.left, pair.right, 48)
    colour = [np.repeat(image[..., None], 3, axis=2) for image in (pair.left, pair.right)]
    peer = cv2.StereoSGBM.create(0, 48, 5, 600, 2400, 1, mode=cv2.STEREO_SGBM_MODE_HH)
    expected = np.asarray(peer.compute(*colour), np.float32)[:, 48:] / 16  # it leaves the first columns out
    matched = match_sgm(pair)
    both = np.isfinite(matched[:, 48:]) & (expected >= 0)  # the first columns confirm or contradict others, too
    assert both.mean() > 0.85
    assert (matched[:, 48:] == expected)[both].mean() > 0.98
    assert np.isfinite(matched[:, 8:48]).mean() > 0.8


@settings(deadline=None, max_examples=20)
@given(st.integers(1, 40), st.integers(-30, 20))
def test_any_range_is_searched_to_its_ends_and_not_beyond(n_disparities: int, lowest: int) -> None:
    for disparity in (lowest, lowest + n_disparities - 1):
        scene = texture(height=20, width=200)
        left, right = scene[:, 60:140], scene[:, 60 + disparity : 140 + disparity]
        matched = match_sgm(StereoPair(left, right, n_disparities, lowest))
        valid = matched[np.isfinite(matched)]
        assert np.median(valid) == pytest.approx(disparity, abs=0.1)
        assert valid.min() >= lowest
        assert valid.max() <= lowest + n_disparities - 0.5


def test_the_largest_step_does_not_overflow() -> None:
    pair = shifted_pair(5)
    matched = match_sgm(pair, SgmParameters(block=11, large_step=LARGEST_STEP))
    assert np.nanmedian(np.abs(matched - 5)) < 0.1
    assert np.isfinite(matched).mean() > 0.8


def test_a_grey_picture_counts_as_three_equal_channels() -> None:
    pair = shifted_pair(5)
    left, right = pair.left[..., 0], pair.right[..., 0]
    as_colour = [np.repeat(image[..., None], 3, axis=2) for image in (left, right)]
    np.testing.assert_array_equal(match_sgm(StereoPair(left, right, 12)), match_sgm(StereoPair(*as_colour, 12)))


def test_a_match_on_the_right_background_is_dropped() -> None:
    pair = shifted_pair(4)
    left_mask, right_mask = np.ones((40, 80), np.bool_), np.ones((40, 80), np.bool_)
    right_mask[:, 36:56] = False
    matched = match_sgm(StereoPair(pair.left, pair.right, 12, left_mask=left_mask, right_mask=right_mask))
    at = np.rint(np.arange(80) - np.nan_to_num(matched)).astype(int)
    assert np.take_along_axis(right_mask, at, axis=1)[np.isfinite(matched)].all()
    assert np.isfinite(matched[:, 12:34]).mean() > 0.9


def test_wrong_parameters_are_named() -> None:
    for changes, sentence in (
        ({"block": 4}, "block is 4"),
        ({"small_step": 0}, "small_step is 0"),
        ({"large_step": 600}, "large_step 600"),
        ({"large_step": 32_768}, "up to 20000"),
        ({"consistency_threshold": 0}, "threshold is 0"),
    ):
        with pytest.raises(ValueError, match=sentence):
            SgmParameters(**changes)
    assert DEFAULTS["sgm"] == SgmParameters()

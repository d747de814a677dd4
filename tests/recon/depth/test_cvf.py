"""ID and DR: levels, threads, masks, accuracy on real pairs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth import MATCHERS, Matcher, StereoPair, match_dr, match_id
from recon.depth.cvf import DrParameters, IdParameters
from recon.depth.matching.views import Level

every_matcher = pytest.mark.parametrize("matcher", MATCHERS.values(), ids=MATCHERS.keys())


def layered_pair(height: int = 90, width: int = 140) -> tuple[StereoPair, NDArray[np.float32]]:
    """A textured square at disparity 30 before a background at 6, and the truth of the left view."""
    rng = np.random.default_rng(0)
    behind = cv2.GaussianBlur(rng.integers(0, 256, (height, width + 60)).astype(np.float32), (0, 0), 1) * 3 % 256
    square = rng.integers(0, 256, (40, 40)).astype(np.float32)
    left, right = behind[:, :width].copy(), behind[:, 6 : width + 6].copy()
    left[25:65, 70:110], right[25:65, 40:80] = square, square
    truth = np.full((height, width), 6, np.float32)
    truth[25:65, 70:110] = 30
    return StereoPair(left.astype(np.uint8), right.astype(np.uint8), 40), truth


def test_the_hierarchy_finds_what_the_full_search_finds() -> None:
    pair, truth = layered_pair()
    for levels in (0, 1, 2):
        found = match_id(pair, IdParameters(levels=levels))
        visible = np.isfinite(found)
        assert visible[:, 40:].mean() > 0.75
        assert (found[visible] == truth[visible]).mean() > 0.98


@pytest.mark.slow
def test_id_is_whole_and_dr_is_not() -> None:
    pair, truth = layered_pair()
    whole, fine = match_id(pair), match_dr(pair)
    assert (whole[np.isfinite(whole)] % 1 == 0).all()
    assert (fine[np.isfinite(fine)] % 1 != 0).any()
    assert np.nanmedian(np.abs(fine - truth)) < 0.1


def test_what_only_the_left_view_sees_stays_unmatched() -> None:
    pair, _ = layered_pair()
    for found in (match_id(pair), match_dr(pair)):
        hidden = found[30:60, 48:68]  # the background that the square covers in the right view
        assert np.isnan(hidden).mean() > 0.8


@pytest.mark.slow
@every_matcher
@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
def test_one_thread_and_two_give_the_same_bits(matcher: Matcher) -> None:
    pair, _ = layered_pair()
    found = []
    try:
        for n_threads in (1, 2):
            numba.set_num_threads(n_threads)
            cv2.setNumThreads(n_threads)
            found.append(matcher(pair))
    finally:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
        cv2.setNumThreads(-1)
    np.testing.assert_array_equal(found[0], found[1])


@pytest.mark.slow
@every_matcher
def test_a_mask_costs_no_more_than_its_box(matcher: Matcher) -> None:
    pair, _ = layered_pair()
    mask = np.zeros((90, 140), np.bool_)
    mask[25:65, 70:110] = True
    right_mask = np.roll(mask, -30, axis=1)
    masked = StereoPair(pair.left, pair.right, 40, left_mask=mask, right_mask=right_mask)
    rows, columns = masked.foreground()
    assert (rows, columns) == (slice(21, 69), slice(27, 114))
    found = matcher(masked)
    assert np.isnan(found[~mask]).all()
    assert np.mean(np.abs(found[mask] - 30) <= 0.5) > 0.95


def test_a_level_has_twice_the_pixel_of_the_one_below() -> None:
    for lowest in range(-9, 9):
        for count in range(1, 20):
            coarse = Level(count, lowest).halved()
            for disparity in (lowest, lowest + count - 1):
                assert coarse.min_disparity <= disparity / 2 <= coarse.min_disparity + coarse.n_disparities - 1


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"sigma": 0.0}, "sigma is 0"),
        ({"levels": -1}, "levels is -1"),
        ({"levels": 9}, "levels is 9"),
        ({"consistency_threshold": -1}, "threshold is -1"),
        ({"fill_threshold": -0.5}, "fill threshold is -0.5"),
        ({"window": 7}, "window is 7; expected 3 or 5 pixels"),
    ],
)
def test_impossible_parameters_are_refused(changes: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        DrParameters(**changes)  # type: ignore[arg-type]  # wrong values, on purpose


def teddy(folder: Path) -> tuple[StereoPair, NDArray[np.float64], NDArray[np.bool_]]:
    """The pair, its truth, and where both views see the scene."""
    folder = folder / "stereo_pairs" / "teddy"
    left, right = (np.asarray(cv2.imread(str(folder / f"im{view}.png"))) for view in (2, 6))
    truth, other = (np.asarray(cv2.imread(str(folder / f"disp{name}"), 0)) / 4 for name in ("2.png", "6.pgm"))
    rows, columns = np.arange(375)[:, None], np.arange(450)[None]
    there = np.rint(columns - truth).astype(int)
    visible = (truth > 0) & (there >= 0) & (np.abs(other[rows, np.clip(there, 0, 449)] - truth) <= 1)
    pair = StereoPair(left[:, :, ::-1].astype(np.uint8), right[:, :, ::-1].astype(np.uint8), 60)
    return pair, truth, visible


@pytest.mark.slow
@pytest.mark.parametrize(("method", "bad_1", "bad_half"), [("id", 4.2, 9.6), ("dr", 4.3, 8.3), ("pm", 3.3, 6.3)])
def test_the_bars_are_met_on_a_real_pair(real_data: Path, method: str, bad_1: float, bad_half: float) -> None:
    pair, truth, visible = teddy(real_data)
    found = MATCHERS[method](pair)
    known = np.where(np.isfinite(found), found, np.inf)
    columns = np.arange(450)
    from_left = np.maximum.accumulate(np.where(np.isfinite(found), columns, 0), axis=1)
    from_right = np.minimum.accumulate(np.where(np.isfinite(found), columns, 449)[:, ::-1], axis=1)[:, ::-1]
    filled = np.minimum(np.take_along_axis(known, from_left, 1), np.take_along_axis(known, from_right, 1))
    error = np.abs(filled - truth)[visible]
    assert 100 * (error > 1).mean() <= bad_1
    assert 100 * (error > 0.5).mean() <= bad_half


@pytest.mark.slow
def test_noise_harms_less_than_it_harms_the_semi_global_matcher(real_data: Path) -> None:
    pair, truth, visible = teddy(real_data)
    rng = np.random.default_rng(0)
    noisy = [
        np.clip(image + rng.normal(0, 4, image.shape), 0, 255).round().astype(np.uint8)
        for image in (pair.left, pair.right)
    ]
    hh = cv2.StereoSGBM.create(0, 64, 5, 600, 2400, 1, mode=cv2.STEREO_SGBM_MODE_HH)
    peer = np.asarray(hh.compute(*noisy), np.float32) / 16
    ours = match_id(StereoPair(noisy[0], noisy[1], 60))
    both = visible & (peer >= 0) & np.isfinite(ours)
    assert (np.abs(ours - truth)[both] > 1).mean() <= 0.75 * (np.abs(peer - truth)[both] > 1).mean()

"""What our matchers do beyond the contract of all: see tests/recon/test_contract.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth import MATCHERS, Matcher, StereoPair, match_frames
from recon.methods.approaches import DEPTH_METHODS

every_matcher = pytest.mark.parametrize("matcher", MATCHERS.values(), ids=MATCHERS.keys())
# the semi-global baseline breaks ties to the same end in both views, which then agree where nothing is known
papers_matcher = pytest.mark.parametrize("matcher", [MATCHERS[name] for name in DEPTH_METHODS], ids=DEPTH_METHODS)


def texture(height: int = 40, width: int = 80, seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


def shifted_pair(disparity: int, *, n_disparities: int = 12, min_disparity: int = 0) -> StereoPair:
    scene = texture(width=120)
    return StereoPair(
        np.ascontiguousarray(scene[:, 20:100]),
        np.ascontiguousarray(scene[:, 20 + disparity : 100 + disparity]),
        n_disparities,
        min_disparity,
    )


@pytest.mark.slow
@every_matcher
def test_no_match_points_outside_the_right_image(matcher: Matcher) -> None:
    noise = StereoPair(texture(seed=1), texture(seed=2), 12, 3)
    found = matcher(noise)
    valid = np.isfinite(found)
    matched = (np.arange(80) - found)[valid]
    assert (matched >= -0.5).all()
    assert (matched <= 79.5).all()


@every_matcher
@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_pair_without_texture_is_unmatched_everywhere_and_warned_about(matcher: Matcher, level: int) -> None:
    plain = np.full((20, 30, 3), level, np.uint8)
    with pytest.warns(UserWarning, match="no texture"):
        assert np.isnan(matcher(StereoPair(plain, plain, 8))).all()


@papers_matcher
def test_no_depth_is_invented_where_rows_are_plain(matcher: Matcher) -> None:
    stripes = np.repeat(np.random.default_rng(0).integers(0, 256, (40, 1)).astype(np.uint8), 80, axis=1)
    assert np.isnan(matcher(StereoPair(stripes, stripes, 12))).all()


@every_matcher
def test_texture_in_one_view_alone_matches_nothing(matcher: Matcher) -> None:
    plain = np.full((40, 80, 3), 100, np.uint8)
    with pytest.warns(UserWarning, match="no texture"):
        assert np.isnan(matcher(StereoPair(texture(), plain, 12))).all()


@pytest.mark.slow
@every_matcher
def test_what_lies_behind_the_mask_is_unmatched_and_changes_nothing(matcher: Matcher) -> None:
    pair = shifted_pair(4)
    masks = np.zeros((2, 40, 80), np.bool_)
    masks[0, 8:30, 20:60] = True
    masks[1, 8:30, 16:56] = True
    found = []
    for seed in (5, 6):
        behind = texture(seed=seed)
        left = np.where(masks[0][..., None], pair.left, behind)
        right = np.where(masks[1][..., None], pair.right, 255 - behind)
        found.append(matcher(StereoPair(left, right, 12, left_mask=masks[0], right_mask=masks[1])))
    np.testing.assert_array_equal(found[0], found[1])
    assert np.isnan(found[0][~masks[0]]).all()
    assert np.mean(np.abs(found[0][masks[0]] - 4) <= 0.25) > 0.95


@every_matcher
def test_a_frame_with_the_pictures_of_the_one_before_is_not_matched_again(matcher: Matcher) -> None:
    matched: list[StereoPair] = []

    def counting(pair: StereoPair) -> NDArray[np.float32]:
        matched.append(pair)
        return matcher(pair)

    first, other = shifted_pair(4), shifted_pair(6)
    again = StereoPair(first.left.copy(), first.right.copy(), first.n_disparities)
    frames = list(match_frames([first, again, other, replace(other, n_disparities=10)], counting))
    assert [pair.n_disparities for pair in matched] == [12, 12, 10]
    np.testing.assert_array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(frames[2], matcher(other))

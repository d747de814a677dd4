"""PatchMatch: its window against a plain reference, its geometry by laws."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth import StereoPair, match_frames, match_pm, patchmatch
from recon.depth.matching import plane_search
from recon.depth.matching.texture import texture_of
from recon.depth.matching.views import View, views_of
from recon.depth.patchmatch import Past, PmParameters

HEIGHT, WIDTH = 30, 44
FEW = PmParameters(sweeps=1)


def some_views() -> tuple[View, View]:
    images = np.random.default_rng(0).integers(0, 256, (2, HEIGHT, WIDTH, 3)).astype(np.uint8)
    images = np.stack([cv2.GaussianBlur(image, (0, 0), 1.5) for image in images])
    return views_of(StereoPair(images[0], images[1], 16), 12.0)


def plain_window_cost(
    views: tuple[View, View], plane: NDArray[np.float32], y: int, x: int, parameters: PmParameters
) -> float:
    """The mean cost of every other pixel of a window, Bleyer et al. 2011, equations 3 to 5."""
    view = views[0]
    rows, weights, costs = np.arange(-16, 17, 2), [], []
    greys = [each.mirrored(each.grey).astype(float) / 256 for each in views]
    signs = [-1.0 if each.is_right else 1.0 for each in views]
    slopes = [
        sign * np.gradient(np.pad(grey, ((0, 0), (1, 1)), mode="edge"), axis=1)[:, 1:-1]
        for sign, grey in zip(signs, greys, strict=True)
    ]
    colours = view.mirrored(view.image).astype(float)
    for number, v in enumerate(rows):
        for u in range(-16 + number % 2, 16, 2):
            if not (0 <= y + v < HEIGHT and 0 <= x + u < WIDTH):
                continue
            place = WIDTH - 1 - (x + u) + plane[0] + plane[1] * u + plane[2] * v
            place = np.clip(np.rint(4 * place) / 4, 0, WIDTH - 1)
            seen = [np.interp(place, np.arange(WIDTH), values[1][y + v]) for values in (greys, slopes)]
            differences = [
                abs(values[0][y + v, x + u] - there) for values, there in zip((greys, slopes), seen, strict=True)
            ]
            weights.append(np.exp(-np.abs(colours[y + v, x + u] - colours[y, x]).sum() / parameters.gamma))
            share = parameters.gradient_share
            costs.append(
                (1 - share) * min(differences[0], parameters.grey_limit)
                + share * min(differences[1], parameters.gradient_limit)
            )
    return float(np.average(costs, weights=weights))


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(("y", "x"), [(15, 22), (0, 3), (29, 40), (14, 43)])
def test_a_windows_cost_is_that_of_the_plain_reference(side: int, y: int, x: int) -> None:
    views, parameters = some_views(), PmParameters()
    own, facing = views[side], views[1 - side]
    texture, target = texture_of(own), texture_of(facing).fine
    taps, plane = np.empty(3 * plane_search.TAPS, np.float32), np.array([6.3, 0.11, -0.07], np.float32)
    settings = patchmatch._settings(own.level, parameters)
    weight = plane_search._take_window((texture.colours, texture.words, target), settings, y, x, taps)
    place = (y, x, HEIGHT, WIDTH, weight)
    cost = plane_search._window_cost(taps, target, tuple(plane), place, settings, np.float32(np.inf))
    assert cost / 256 == pytest.approx(plain_window_cost((own, facing), plane, y, x, parameters), rel=0.01)


def test_a_plane_seen_from_the_other_view_and_back_is_the_same_plane() -> None:
    plane = (np.float32(9), np.float32(0.2), np.float32(-0.1))
    forth = plane_search._seen_from_other(plane, -9)
    assert forth[0] == pytest.approx(9, abs=1e-5)  # the pixels match, so both views give them one disparity
    np.testing.assert_allclose(plane_search._seen_from_other(forth, -9), plane, atol=1e-5)


def slanted_pair() -> tuple[StereoPair, NDArray[np.float32]]:
    """A floor whose disparity grows by 0.15 a row and 0.1 a column, and its truth."""
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (60, 140)).astype(np.float32), (0, 0), 1.2)
    y, x = (grid.astype(np.float32) for grid in np.indices((60, 100)))
    truth = 4 + 0.15 * y + 0.1 * x
    in_left = (x + 4 + 0.15 * y) / 0.9  # the left column that a right column sees
    views = [cv2.remap(texture, columns, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT) for columns in (x, in_left)]
    stretched = [np.clip((view - 127) * 3 + 127, 0, 255).round().astype(np.uint8) for view in views]
    return StereoPair(stretched[0], stretched[1], 24), truth


@pytest.mark.slow
@pytest.mark.parametrize("parameters", [PmParameters(), PmParameters(is_seeded=False, sweeps=5)])
def test_a_slanted_floor_is_found_to_a_tenth_of_a_pixel(parameters: PmParameters) -> None:
    pair, truth = slanted_pair()
    found = match_pm(pair, parameters)
    error = np.abs(found - truth)[4:-4, 26:-4]
    assert np.nanmedian(error) < 0.1
    assert np.mean(error <= 0.5) > 0.9


def test_more_sweeps_come_nearer_to_the_truth() -> None:
    pair, _ = slanted_pair()
    errors = []
    for sweeps in (0, 1, 3):
        found = match_pm(pair, PmParameters(sweeps=sweeps, is_seeded=False))
        errors.append(float(np.nanmean(np.abs(found - slanted_pair()[1])[4:-4, 26:-4])))
    assert errors[2] <= errors[1] <= errors[0]


SIDE = 16  # pixels, of the square


def frames_of_a_square(columns: list[int], *, noise: float = 0.0) -> list[StereoPair]:
    """A bright square of 7 pixels of disparity before a wall of 2, its left edge at a column in each frame."""
    rng = np.random.default_rng(5)
    wall, square = (cv2.GaussianBlur(rng.uniform(*range_, (44, 120)), (0, 0), 1) for range_ in ((0, 120), (130, 250)))
    pairs = []
    for column in columns:
        left, right = wall[:, 10:106].copy(), wall[:, 12:108].copy()
        left[12:28, column : column + SIDE] = right[12:28, column - 7 : column - 7 + SIDE] = square[:SIDE, :SIDE]
        views = [view + rng.normal(0, noise, view.shape) if noise else view for view in (left, right)]
        views = [np.clip(view, 0, 255).round().astype(np.uint8) for view in views]
        pairs.append(StereoPair(views[0], views[1], 12))
    return pairs


@pytest.mark.slow
def test_a_still_noisy_sequence_keeps_its_planes_and_is_no_worse() -> None:
    pairs, truth = frames_of_a_square([50] * 4, noise=2), 2.0
    frames = list(match_frames(pairs, match_pm))
    assert np.mean(np.isclose(frames[1], frames[3], atol=0.05, equal_nan=True)) > 0.9
    alone = match_pm(pairs[3])
    wrong = [np.nanmean(np.abs(found[:, 14:46] - truth) > 0.5) for found in (frames[3], alone)]
    assert wrong[0] <= wrong[1] + 0.02


@pytest.mark.slow
def test_where_a_sequence_moves_its_planes_are_looked_for_again() -> None:
    pairs = frames_of_a_square([40, 40, 62])
    last = list(match_frames(pairs, match_pm))[-1]
    inside, left_behind = last[15:25, 65:75], last[15:25, 42:52]
    assert np.nanmean(np.abs(inside - 7) <= 0.5) > 0.9
    assert np.nanmean(np.abs(left_behind - 2) <= 0.5) > 0.9
    untouched = (slice(34, 44), slice(14, 96))
    np.testing.assert_array_equal(last[untouched], list(match_frames(pairs[:2], match_pm))[-1][untouched])


@pytest.mark.slow
def test_a_masked_person_who_walks_is_matched_as_if_alone() -> None:
    pairs = frames_of_a_square([40, 44, 48])
    masked = []
    for pair, column in zip(pairs, (40, 44, 48), strict=True):
        masks = np.zeros((2, 44, 96), np.bool_)
        masks[0, 12:28, column : column + SIDE] = masks[1, 12:28, column - 7 : column - 7 + SIDE] = True
        masked.append(replace(pair, left_mask=masks[0], right_mask=masks[1]))
    for pair, found in zip(masked, match_frames(masked, match_pm), strict=True):
        np.testing.assert_array_equal(np.isfinite(found), np.isfinite(match_pm(pair)))
        assert np.nanmean(np.abs(found[pair.left_mask] - 7) <= 0.5) > 0.9


def test_a_past_of_a_frame_without_texture_is_forgotten() -> None:
    past, plain = Past(), np.full((44, 96), 90, np.uint8)
    pair = frames_of_a_square([40])[0]
    match_pm(pair, FEW, past=past)
    assert past.traces is not None
    with pytest.warns(UserWarning, match="no texture"):
        match_pm(StereoPair(plain, plain, 12), FEW, past=past)
    assert past.traces is None
    np.testing.assert_array_equal(match_pm(pair, FEW, past=past), match_pm(pair, FEW))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"sweeps": -1}, "sweeps is -1"),
        ({"sweeps_again": -2}, "sweeps_again is -2"),
        ({"gamma": 0.0}, "gamma is 0"),
        ({"gradient_share": 1.5}, "share is 1.5"),
        ({"smoothness": -1.0}, "smoothness is -1"),
        ({"distance_limit": 0.0}, "distance_limit is 0"),
    ],
)
def test_impossible_parameters_are_refused(changes: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        PmParameters(**changes)  # type: ignore[arg-type]  # wrong values, on purpose

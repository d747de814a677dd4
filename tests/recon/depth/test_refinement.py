"""Filling and local planes against plain references."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recon.depth import refinement
from recon.depth.refinement import MIN_SUPPORT, PLANE_OFFSETS, SAME_SURFACE, filled, local_planes, without_specks


def plain_fill(row: NDArray[np.float32], valid: NDArray[np.bool_]) -> list[float]:
    places = np.flatnonzero(valid)
    beside = [(places[places <= x][-1:], places[places >= x][:1]) for x in range(len(row))]
    return [min(row[place] for side in sides for place in side) for sides in beside]


@settings(deadline=None)  # the first call compiles
@given(seed=st.integers(0, 200), share=st.floats(0.1, 0.9))
def test_a_hole_takes_the_farther_of_its_neighbours_in_the_row(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    disparity = rng.uniform(0, 60, (4, 12)).astype(np.float32)
    valid = rng.random((4, 12)) < share
    valid[:, 5] = True
    expected = [plain_fill(row, known) for row, known in zip(disparity, valid, strict=True)]
    np.testing.assert_array_equal(filled(disparity, valid), np.array(expected, np.float32))


def test_an_empty_row_takes_the_row_above_and_the_first_rows_the_first_that_has_one() -> None:
    disparity = np.arange(12, dtype=np.float32).reshape(4, 3)
    valid = np.array([[False] * 3, [True] * 3, [False] * 3, [True] * 3])
    np.testing.assert_array_equal(filled(disparity, valid), disparity[[1, 1, 1, 3]])


def plain_plane(disparity: NDArray[np.float32], valid: NDArray[np.bool_], y: int, x: int) -> float:
    around = [(v, u) for v in PLANE_OFFSETS for u in PLANE_OFFSETS]
    inside = [(v, u) for v, u in around if 0 <= y + v < disparity.shape[0] and 0 <= x + u < disparity.shape[1]]
    rises = {(v, u): float(disparity[y + v, x + u] - disparity[y, x]) for v, u in inside if valid[y + v, x + u]}
    used = {place: rise for place, rise in rises.items() if abs(rise) <= SAME_SURFACE}
    if len(used) < MIN_SUPPORT:
        return float(disparity[y, x])
    design = [(1, u, v) for v, u in used]
    return float(disparity[y, x] + np.linalg.lstsq(np.array(design), list(used.values()), rcond=None)[0][0])


@pytest.mark.parametrize("share", [1.0, 0.8])
def test_local_planes_are_those_of_least_squares(share: float) -> None:
    rng = np.random.default_rng(0)
    height, width = 16, 18
    surface = np.add.outer(0.1 * np.arange(height), -0.1 * np.arange(width)) + rng.normal(0, 0.1, (height, width)) + 9
    surface[:, 10:] += 20
    disparity, valid = surface.astype(np.float32), rng.random((height, width)) < share
    expected = [[plain_plane(disparity, valid, y, x) for x in range(width)] for y in range(height)]
    np.testing.assert_allclose(local_planes(disparity, valid, 64), expected, atol=0.02)


def test_a_plane_is_its_own_local_plane() -> None:
    plane = np.add.outer(0.15 * np.arange(20), 0.1 * np.arange(25)).astype(np.float32)
    smoothed = local_planes(plane, np.ones(plane.shape, np.bool_), 64)
    np.testing.assert_allclose(smoothed[4:-4, 4:-4], plane[4:-4, 4:-4], atol=1e-4)


def test_planes_stay_among_the_disparities_searched() -> None:
    plane = np.add.outer(np.zeros(12), 0.3 * np.arange(20)).astype(np.float32)
    bent = local_planes(np.clip(plane, 0.5, 3.2), np.ones(plane.shape, np.bool_), 4)
    assert bent.min() >= 0
    assert bent.max() <= 3


def in_parts(length: int, work: Callable[[int, int], None]) -> None:
    for edge in range(0, length, 5):
        work(edge, min(edge + 5, length))


def test_a_speck_goes_and_an_edge_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refinement, "in_bands", in_parts)
    disparity = np.repeat(np.repeat([[3.0, 9.0]], 8, axis=1), 12, axis=0).astype(np.float32)
    specked = disparity.copy()
    specked[5, 4] = 50  # on the first row of a part
    np.testing.assert_array_equal(without_specks(specked), disparity)

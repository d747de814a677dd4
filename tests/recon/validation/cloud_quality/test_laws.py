"""Laws of the measures between clouds, and independent slow computations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.validation.cloud_quality.compared import SYMMETRIC, TO_DISTORTED, TO_REFERENCE, Pair, Prepared, Value
from recon.validation.cloud_quality.geometry import chamfer, d1, f_score
from recon.validation.cloud_quality.measures import MEASURES, Scale
from recon.validation.cloud_quality.neighbours import JOINED_WITHIN, lowest_first, nearest_groups
from recon.validation.cloud_quality.points import PointSet, merged
from recon.validation.cloud_quality.pointssim import pointssim
from recon.validation.sampling import search_tree
from tests.recon.validation.cloud_quality.clouds import ball

SCALE = Scale("mm", 1000.0, 4.0)
TURNED_AXES = ("pointssim_curvature",)  # its formula depends on the signs of axes that a rotation changes
SEEDS = st.integers(0, 2**32 - 1)


def compared(reference: PointSet, distorted: PointSet) -> dict[tuple[str, str], Value]:
    pair = Pair(Prepared(reference), Prepared(distorted))
    values = [value for measure in MEASURES.values() for value in measure(pair, SCALE)]
    return {(value.measure, value.direction): value for value in values}


def numbers(values: dict[tuple[str, str], Value]) -> dict[tuple[str, str], float]:
    return {place: value.value for place, value in values.items()}


def moved(cloud: PointSet, rotation: Rotation, shift: NDArray[np.float64]) -> PointSet:
    assert cloud.normals is not None
    return PointSet(cloud.name, rotation.apply(cloud.points) + shift, rotation.apply(cloud.normals), cloud.colours)


def shuffled(cloud: PointSet, rng: np.random.Generator) -> PointSet:
    assert cloud.normals is not None
    assert cloud.colours is not None
    order = rng.permutation(len(cloud))
    return PointSet(cloud.name, cloud.points[order], cloud.normals[order], cloud.colours[order])


@given(SEEDS)
@settings(max_examples=5)
def test_two_equal_clouds_have_the_best_value_of_every_measure(seed: int) -> None:
    cloud = ball(seed=seed % 1000)
    for value in compared(cloud, cloud).values():
        if value.better == "lower":
            assert value.value == 0
        else:
            assert value.value == (np.inf if value.unit == "dB" else pytest.approx(1, abs=1e-12))


@pytest.mark.slow
def test_every_measure_gets_worse_as_noise_grows() -> None:
    reference = ball(1500)
    series = [compared(reference, ball(1500, noise=noise, colour_noise=20 * noise)) for noise in (0.0, 0.3, 1.0, 3.0)]
    assert len(series[0]) > 60
    for place, perfect in series[0].items():
        if perfect.direction == SYMMETRIC and perfect.measure not in TURNED_AXES:
            sign = 1 if perfect.better == "higher" else -1
            course = [sign * values[place].value for values in series]
            assert course == sorted(course, reverse=True), place
            assert course[0] > course[-1], place


@given(SEEDS)
@settings(max_examples=5)
def test_directions_change_places_with_the_clouds_and_the_symmetric_value_stays(seed: int) -> None:
    one_way, other_way = (ball(seed=seed % 1000), ball(250, noise=1, seed=seed % 1000 + 1))
    forward, backward = compared(one_way, other_way), compared(other_way, one_way)
    opposite = {TO_DISTORTED: TO_REFERENCE, TO_REFERENCE: TO_DISTORTED, SYMMETRIC: SYMMETRIC}
    for (measure, direction), value in forward.items():
        if not measure.startswith("d2"):  # D2 takes the normals of its reference alone
            assert backward[measure, opposite[direction]].value == pytest.approx(value.value, rel=1e-12)


@given(SEEDS)
@settings(max_examples=5)
def test_order_of_points_does_not_matter(seed: int) -> None:
    reference, distorted = ball(), ball(noise=1, colour_noise=5, seed=2)
    rng = np.random.default_rng(seed)
    before = numbers(compared(reference, distorted))
    assert numbers(compared(shuffled(reference, rng), shuffled(distorted, rng))) == pytest.approx(before, rel=1e-9)


@given(SEEDS)
@settings(max_examples=5)
def test_a_rigid_motion_of_both_clouds_does_not_matter(seed: int) -> None:
    reference, distorted = ball(), ball(noise=1, colour_noise=5, seed=2)
    rng = np.random.default_rng(seed)
    rotation, shift = Rotation.random(random_state=seed), rng.uniform(-50, 50, 3)
    before = numbers(compared(reference, distorted))
    after = numbers(compared(moved(reference, rotation, shift), moved(distorted, rotation, shift)))
    free = {place for place in before if place[0] not in TURNED_AXES}
    assert {place: after[place] for place in free} == pytest.approx({p: before[p] for p in free}, rel=1e-3, abs=1e-6)


def test_a_shift_of_both_clouds_leaves_the_curvature() -> None:
    reference, distorted = ball(), ball(noise=1, seed=2)
    shift = np.array([30.0, -20, 10])
    still = Rotation.identity()
    before = compared(reference, distorted)
    after = compared(moved(reference, still, shift), moved(distorted, still, shift))
    place = ("pointssim_curvature", SYMMETRIC)
    assert after[place].value == pytest.approx(before[place].value, rel=1e-3)


def test_chamfer_and_f_score_follow_their_definitions_with_every_point_counted() -> None:
    reference = PointSet("r", np.array([[0, 0, 0], [10, 0, 0], [10, 0, 0]]))
    distorted = PointSet("d", np.array([[0, 1, 0], [10, 5, 0], [10, 5, 0], [10, 5, 0]]))
    pair = Pair(Prepared(reference), Prepared(distorted))
    assert {v.direction: v.value for v in chamfer(pair, "mm")} == pytest.approx(
        {TO_DISTORTED: 11 / 3, TO_REFERENCE: 4.0, SYMMETRIC: (11 / 3 + 4) / 2}
    )
    precision, recall = 1 / 4, 1 / 3
    assert {v.direction: v.value for v in f_score(pair, 5.0)} == pytest.approx(
        {TO_DISTORTED: recall, TO_REFERENCE: precision, SYMMETRIC: 2 * precision * recall / (precision + recall)}
    )


def test_points_on_a_line_have_no_curvature_to_compare() -> None:
    line = PointSet("line", np.arange(40)[:, None] * np.array([1.0, 2, 3]))
    pair = Pair(Prepared(line), Prepared(line))
    assert [value.value for value in pointssim("pointssim_geometry", pair)] == [1, 1, 1]
    with pytest.raises(ValueError, match="are all points on a line"):
        pointssim("pointssim_curvature", pair)


def test_points_at_one_place_count_once_in_d1() -> None:
    reference = PointSet("r", np.array([[0, 0, 0], [10, 0, 0], [10, 0, 0]]))
    distorted = PointSet("d", np.array([[0, 1, 0], [10, 3, 0]]))
    mse = next(v for v in d1(Pair(Prepared(reference), Prepared(distorted)), None, "mm") if v.measure == "d1_mse")
    assert mse.value == (1 + 9) / 2


def test_places_are_in_order_and_keep_the_first_normal_and_the_mean_colour_of_their_points() -> None:
    places = merged(np.array([[2, 0, 0], [1, 0, 0], [2, 0, 0], [-0.0, 0, 0], [0, 0, 0]], np.float32))
    assert places.points[:, 0].tolist() == [0, 1, 2]
    assert places.counts.tolist() == [2, 1, 2]
    values = np.array([[1], [2], [4], [5], [9]])
    assert places.first(values.astype(np.float32))[:, 0].tolist() == [5, 2, 1]
    assert places.mean(values.astype(np.uint8))[:, 0].tolist() == [7, 2, 2.5]


GRIDS: dict[str, Callable[[np.random.Generator], NDArray[np.float32]]] = {
    "grid": lambda rng: np.unique(rng.integers(0, 7, (150, 3)), axis=0).astype(np.float32),
    "close": lambda rng: rng.uniform(0, 3e-4, (40, 3)).astype(np.float32),
}


@pytest.mark.parametrize("kind", GRIDS)
@given(SEEDS)
@settings(max_examples=10)
def test_groups_of_nearest_points_are_those_of_the_full_search(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, others = GRIDS[kind](rng), GRIDS[kind](rng)
    groups = nearest_groups(points, others, search_tree(others))
    for row, point in enumerate(points):
        squared = np.square((point - others).astype(np.float64)).sum(axis=1)
        order = np.argsort(squared, kind="stable")
        k = next((k for k in range(10, 31, 5) if squared[order[0]] < squared[order[k - 1]]), 30)
        near = squared[order[:k]]
        n = 1 + next((i for i, step in enumerate(np.diff(near)) if not step < JOINED_WITHIN), k - 1)
        members = groups.members[groups.rows == row]
        assert groups.counts[row] == len(members) == n
        assert np.sort(squared[members]).tolist() == pytest.approx(near[:n].tolist())


@given(SEEDS, st.integers(1, 12))
@settings(max_examples=10)
def test_of_points_equally_near_the_first_are_taken(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    points, others = GRIDS["grid"](rng), GRIDS["grid"](rng)
    rows, distances = lowest_first(points, others, search_tree(others), k)
    squared = np.square(points[:, None].astype(np.float64) - others).sum(axis=2)
    expected = np.argsort(squared, axis=1, kind="stable")[:, :k]
    assert np.array_equal(rows, expected)
    assert np.array_equal(distances, np.sqrt(np.take_along_axis(squared, expected, 1)))

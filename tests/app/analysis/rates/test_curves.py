"""Methods, fronts and curves: which condition belongs where, and how far two curves are apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.analysis.rates.curves import (
    best_at_their_size,
    curve_of,
    difference_weights,
    level_of,
    method_of,
    numeric_factor,
)

FACTORS = {
    "method": {"a1": "splats", "a2": "splats", "b1": "mesh", "b2": "mesh"},
    "share": {"a1": "0.25", "a2": "1", "b1": "0.5", "b2": "1,0"},
}
sizes_and_scores = st.lists(st.tuples(st.integers(1, 6), st.integers(-3, 3)), min_size=1, max_size=8)


def test_a_factor_of_numbers_says_where_on_its_methods_curve_a_condition_stands() -> None:
    assert numeric_factor(FACTORS) == "share"
    assert [method_of(item, FACTORS, "share") for item in ("a1", "b2", "other")] == ["splats", "mesh", "other"]
    assert [level_of(item, FACTORS, "share") for item in ("a1", "b2", "other")] == [0.25, 1.0, None]
    assert method_of("a1", {"share": FACTORS["share"]}, "share") == "all"


@pytest.mark.parametrize("levels", [{"a": "x", "b": "1"}, {"a": "1", "b": "1"}])
def test_a_factor_that_is_not_all_of_different_numbers_makes_no_curve(levels: dict[str, str]) -> None:
    assert numeric_factor({"f": levels}) is None
    assert numeric_factor({"f": {"a": "1", "b": "2"}, "g": {"a": "3", "b": "4"}}) is None


@given(sizes_and_scores)
def test_what_is_not_on_the_front_is_beaten_by_something_on_it(points: list[tuple[int, int]]) -> None:
    sizes, scores = zip(*points, strict=True)
    front = best_at_their_size(sizes, scores)
    assert any(front)
    for (size, score), is_best in zip(points, front, strict=True):
        better = [p for p, on in zip(points, front, strict=True) if on and p != (size, score)]
        assert is_best != any(s <= size and q >= score for s, q in better)


@given(st.floats(-5, 5), st.floats(-2, 2))
def test_curves_of_one_shape_are_as_far_apart_as_they_were_moved(distance: float, slope: float) -> None:
    sizes = [1e5, 1e6, 1e7, 3e5, 2e6, 4e7]
    scores = slope * np.log(sizes) + np.array([distance] * 3 + [0.0] * 3)
    first, second = curve_of([2, 0, 1], sizes), curve_of([3, 4, 5], sizes)
    assert first is not None
    assert second is not None
    found = difference_weights(first, second, 6)
    assert found is not None
    weights, low, high = found
    assert weights @ scores == pytest.approx(distance, abs=1e-9)
    assert weights.sum() == pytest.approx(0, abs=1e-12)
    assert (low, high) == (pytest.approx(3e5), pytest.approx(1e7))
    turned = difference_weights(second, first, 6)
    assert turned is not None
    assert np.allclose(turned[0], -weights)


def test_the_difference_is_the_integral_between_the_curves() -> None:
    sizes, scores = [1.0, 10.0, 100.0, 2.0, 50.0], np.array([0.0, 3.0, 3.5, 1.0, 2.0])
    first, second = curve_of([0, 1, 2], sizes), curve_of([3, 4], sizes)
    assert first is not None
    assert second is not None
    found = difference_weights(first, second, 5)
    assert found is not None
    at = np.linspace(np.log(2), np.log(50), 200_001)
    lines = [np.interp(at, curve.logs, scores[curve.items]) for curve in (first, second)]
    assert found[0] @ scores == pytest.approx(float((lines[0] - lines[1]).mean()), abs=1e-4)


def test_curves_without_a_size_in_common_have_no_difference() -> None:
    sizes = [1.0, 2.0, 3.0, 4.0]
    first, second = curve_of([0, 1], sizes), curve_of([2, 3], sizes)
    assert first is not None
    assert second is not None
    assert difference_weights(first, second, 4) is None
    assert curve_of([0], sizes) is None
    assert curve_of([0, 1], [5.0, 5.0]) is None

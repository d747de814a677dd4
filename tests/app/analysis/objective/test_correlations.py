"""Correlations in many orders at once are those of one order at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from app.analysis.objective.correlations import kendalls, monotones, pearsons, spearmans
from app.analysis.screening.correlation import kendall, pearson, spearman

Array = NDArray[np.float64]

points = st.lists(st.floats(-5, 5), min_size=4, max_size=12, unique=True)


def monotone(values: Array, scores: Array) -> float:
    """Return the correlation of one order by scipy's isotonic regression."""
    sign = 1.0 if spearman(values, scores) >= 0 else -1.0
    _, place, times = np.unique(sign * values, return_inverse=True, return_counts=True)
    fitted = np.asarray(isotonic_regression(np.bincount(place, scores) / times, weights=times).x)[place]
    return 0.0 if np.ptp(fitted) == 0 else sign * pearson(fitted, scores)


def own_direction(values: Array, scores: Array) -> float:
    """Return `monotones` of one order, in the direction of the rank correlation."""
    sign = 1.0 if spearman(values, scores) >= 0 else -1.0
    return float(monotones(values, scores[None], np.array([sign]))[0])


@pytest.mark.slow
@given(st.lists(st.integers(0, 4), min_size=4, max_size=9).filter(lambda v: len(set(v)) > 1), st.integers(0, 1000))
def test_every_order_has_the_correlation_of_its_own(values: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, scores = np.array(values, float), np.round(rng.normal(size=len(values)), 1)
    scores[0], scores[1] = -3.0, 3.0  # never all equal
    orders = np.stack([rng.permutation(len(x)) for _ in range(6)])
    ranks = spearmans(x, scores, orders)
    signs = np.where(ranks >= 0, 1.0, -1.0)
    batches = [
        (pearson, pearsons(x, scores[orders])),
        (spearman, ranks),
        (kendall, kendalls(x, scores, orders)),
        (monotone, monotones(x, scores[orders], signs)),
    ]
    for correlation, batch in batches:
        single = [correlation(x, scores[order]) for order in orders]
        is_told = np.abs(ranks) > 1e-9  # else rounding decides whether the monotone function rises
        assert batch[is_told] == pytest.approx(np.array(single)[is_told], abs=1e-7), correlation.__name__


@example([0.0, 1.6e-283, 1.7e-253, 7.7e-199])
@given(points)
def test_a_monotone_function_of_the_scores_has_monotone_correlation_one(values: list[float]) -> None:
    scores = np.sort(np.array(values))
    ranks = np.arange(len(scores), dtype=float)
    assert own_direction(np.exp(ranks), scores) == pytest.approx(1, abs=1e-9)
    assert own_direction(-(ranks**3), scores) == pytest.approx(-1, abs=1e-9)


@given(points, st.integers(0, 1000))
def test_the_monotone_correlation_is_no_smaller_than_the_linear_one(values: list[float], seed: int) -> None:
    scores = np.random.default_rng(seed).normal(size=len(values))
    x = np.array(values)
    if np.sign(pearson(x, scores)) == np.sign(spearman(x, scores)):
        assert abs(own_direction(x, scores)) >= abs(pearson(x, scores)) - 1e-9


def test_no_function_of_a_measure_tells_tied_values_apart() -> None:
    assert own_direction(np.array([1.0, 1, 1, 2, 2, 2]), np.arange(6.0)) == pytest.approx(np.sqrt(27 / 35))
    lone = np.array([1.0, 1, 1, 1, 1, 2]), np.array([1, 2, 3, 4, 5, 5.01])
    assert own_direction(*lone) == pytest.approx(pearson(*lone))

"""Correlations of two sets of values."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from app.analysis.correlation import kendall, monotone_pearson, pearson, spearman

points = st.lists(st.floats(-5, 5), min_size=4, max_size=12, unique=True)


@given(points, st.integers(0, 1000))
def test_correlations_equal_those_of_scipy(values: list[float], seed: int) -> None:
    scores = np.random.default_rng(seed).normal(size=len(values))
    x = np.array(values)
    assert pearson(x, scores) == pytest.approx(stats.pearsonr(x, scores).statistic, abs=1e-9)
    assert spearman(x, scores) == pytest.approx(stats.spearmanr(x, scores).statistic, abs=1e-9)
    assert kendall(x, scores) == pytest.approx(stats.kendalltau(x, scores).statistic, abs=1e-9)


@given(points)
def test_a_monotone_function_of_the_scores_has_monotone_correlation_one(values: list[float]) -> None:
    scores = np.sort(np.array(values))
    ranks = np.arange(len(scores), dtype=float)
    assert monotone_pearson(np.exp(ranks), scores) == pytest.approx(1, abs=1e-9)
    assert monotone_pearson(-(ranks**3), scores) == pytest.approx(-1, abs=1e-9)


@given(points, st.integers(0, 1000))
def test_the_monotone_correlation_is_no_smaller_than_the_linear_one(values: list[float], seed: int) -> None:
    scores = np.random.default_rng(seed).normal(size=len(values))
    x = np.array(values)
    if np.sign(pearson(x, scores)) == np.sign(spearman(x, scores)):
        assert abs(monotone_pearson(x, scores)) >= abs(pearson(x, scores)) - 1e-9


def test_no_function_of_a_measure_tells_tied_values_apart() -> None:
    assert monotone_pearson(np.array([1.0, 1, 1, 2, 2, 2]), np.arange(6.0)) == pytest.approx(np.sqrt(27 / 35))
    lone = np.array([1.0, 1, 1, 1, 1, 2]), np.array([1, 2, 3, 4, 5, 5.01])
    assert monotone_pearson(*lone) == pytest.approx(pearson(*lone))

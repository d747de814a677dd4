"""Correlations of two sets of values."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from app.analysis.screening.correlation import kendall, pearson, spearman

points = st.lists(st.floats(-5, 5), min_size=4, max_size=12, unique=True)


@given(points, st.integers(0, 1000))
def test_correlations_equal_those_of_scipy(values: list[float], seed: int) -> None:
    scores = np.random.default_rng(seed).normal(size=len(values))
    x = np.array(values)
    assert pearson(x, scores) == pytest.approx(stats.pearsonr(x, scores).statistic, abs=1e-9)
    assert spearman(x, scores) == pytest.approx(stats.spearmanr(x, scores).statistic, abs=1e-9)
    assert kendall(x, scores) == pytest.approx(stats.kendalltau(x, scores).statistic, abs=1e-9)

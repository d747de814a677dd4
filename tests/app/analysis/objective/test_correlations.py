"""Correlations in many orders at once are those of one order at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.analysis import correlation
from app.analysis.objective.correlations import kendalls, monotones, pearsons, spearmans


@pytest.mark.slow
@given(st.lists(st.integers(0, 4), min_size=4, max_size=9).filter(lambda v: len(set(v)) > 1), st.integers(0, 1000))
def test_every_order_has_the_correlation_of_its_own(values: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, scores = np.array(values, float), np.round(rng.normal(size=len(values)), 1)
    scores[0], scores[1] = -3.0, 3.0  # never all equal
    orders = np.stack([rng.permutation(len(x)) for _ in range(6)])
    ranks = spearmans(x, scores, orders)
    signs = np.where(ranks >= 0, 1.0, -1.0)
    batches = {
        "pearson": pearsons(x, scores[orders]),
        "spearman": ranks,
        "kendall": kendalls(x, scores, orders),
        "monotone_pearson": monotones(x, scores[orders], signs),
    }
    for name, batch in batches.items():
        single = [getattr(correlation, name)(x, scores[order]) for order in orders]
        is_told = np.abs(ranks) > 1e-9  # else rounding decides whether the monotone function rises
        assert batch[is_told] == pytest.approx(np.array(single)[is_told], abs=1e-7), name

"""Correlate values with scores: linear and rank correlations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kendalltau, rankdata

Array = NDArray[np.float64]

FEWEST_POINTS = 3  # two always lie on a line


def defined(correlation: Callable[[Array, Array], float], values: Array, scores: Array) -> float | None:
    """Return a correlation; None for fewer than three points, or if either side is constant.

    Parameters
    ----------
    correlation : function of values and scores
    values : float64 (n,), of the measure
    scores : float64 (n,), log-odds
    """
    if len(values) < FEWEST_POINTS or np.ptp(values) == 0 or np.ptp(scores) == 0:
        return None
    return correlation(values, scores)


def pearson(values: Array, scores: Array) -> float:
    """Return the linear correlation of float64 (n,) values; each side is scaled first, so squares of tiny differences
    do not vanish.
    """
    x, y = (part - part.mean() for part in (values, scores))
    x, y = x / np.abs(x).max(), y / np.abs(y).max()
    return float(x @ y / np.sqrt((x @ x) * (y @ y)))


def spearman(values: Array, scores: Array) -> float:
    """Return the rank correlation of float64 (n,) values."""
    return pearson(rankdata(values), rankdata(scores))


def kendall(values: Array, scores: Array) -> float:
    """Return Kendall's tau-b of float64 (n,) values."""
    return float(kendalltau(values, scores).statistic)

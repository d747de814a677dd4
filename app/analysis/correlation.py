"""Correlate values with scores: linear, monotone and rank correlations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression
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


def monotone_pearson(values: Array, scores: Array) -> float:
    """Return the correlation of the scores with their best monotone function of the measure, both float64 (n,).

    It has the sign of the function's direction and is never smaller in size than the linear correlation. With few
    points it flatters the measure, so the report also gives the others.
    """
    sign = 1.0 if spearman(values, scores) >= 0 else -1.0
    _, place, times = np.unique(sign * values, return_inverse=True, return_counts=True)
    means = np.bincount(place, scores) / times  # items of equal measure get one value
    fitted = np.asarray(isotonic_regression(means, weights=times).x)[place]
    return 0.0 if np.ptp(fitted) == 0 else sign * pearson(fitted, scores)

"""Correlate a measure with the scores in every order of the conditions at once.

Linear and rank correlations are those of `app.analysis.screening.correlation`, which takes a single order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from app.analysis.objective.points import Indices

Array = NDArray[np.float64]

LARGEST_BLOCK = 2_000_000  # numbers held at once


def pearsons(values: Array, scores: Array) -> Array:
    """Return the linear correlations, float64 (P,), of values (N,) with every row of scores (P, N)."""
    x, y = values - values.mean(), scores - scores.mean(axis=1, keepdims=True)
    x, y = x / np.abs(x).max(), y / np.abs(y).max()
    return np.asarray(y @ x / np.sqrt((x @ x) * np.sum(y**2, axis=1)))


def spearmans(values: Array, scores: Array, orders: Indices) -> Array:
    """Return the rank correlations of values with the scores in every order.

    Parameters
    ----------
    values : float64 (N,), of the measure
    scores : float64 (N,), in their unit
    orders : intp (P, N), for each order and point the one whose score it gets

    Returns
    -------
    float64 (P,)
    """
    return pearsons(rankdata(values), rankdata(scores)[orders])


def kendalls(values: Array, scores: Array, orders: Indices) -> Array:
    """Return Kendall's tau-b of values with the scores in every order.

    Parameters
    ----------
    values, scores, orders : as in `spearmans`

    Returns
    -------
    float64 (P,)
    """
    first, second = np.triu_indices(len(values), 1)
    value_signs = np.sign(values[first] - values[second])
    score_signs = np.sign(scores[:, None] - scores)
    rows = max(1, LARGEST_BLOCK // len(first))
    sums = [
        score_signs[block[:, first], block[:, second]] @ value_signs
        for block in (orders[start : start + rows] for start in range(0, len(orders), rows))
    ]
    untied = np.count_nonzero(value_signs) * (np.count_nonzero(score_signs) / 2)
    return np.asarray(np.concatenate(sums) / np.sqrt(untied))


def monotones(values: Array, scores: Array, signs: Array) -> Array:
    """Return the correlations of scores with their best monotone function of the values.

    Parameters
    ----------
    values : float64 (N,), of the measure
    scores : float64 (P, N), in their unit
    signs : float64 (P,), 1 for a rising function, -1 for a falling one

    Returns
    -------
    float64 (P,), with the function's direction

    Source
    ------
    Least squares by the min-max formula, Robertson, Wright and Dykstra (1988), theorem 1.4.4: the function at i is the
    largest over j <= i of the smallest mean of j … k over k >= i. Items of equal value get one value of the function.
    """
    order = np.argsort(values, kind="stable")
    starts = np.flatnonzero(np.diff(values[order], prepend=-np.inf) > 0)
    sizes = np.diff(starts, append=len(values))
    centred = signs[:, None] * (scores - scores.mean(axis=1, keepdims=True))[:, order]
    centred /= np.abs(centred).max()  # else the squares of tiny scores are 0
    groups = np.add.reduceat(centred, starts, axis=1)  # (P, G), sums over items of equal value
    fitted = np.full(groups.shape, -np.inf)
    for start in range(len(starts)):
        means = np.cumsum(groups[:, start:], axis=1) / np.cumsum(sizes[start:])
        smallest = np.minimum.accumulate(means[:, ::-1], axis=1)[:, ::-1]
        np.maximum(fitted[:, start:], smallest, out=fitted[:, start:])
    explained = np.sum(sizes * fitted**2, axis=1) / np.sum(centred**2, axis=1)
    return np.asarray(signs * np.sqrt(np.minimum(explained, 1.0)))

"""Ask what a measure without information would reach: permute the conditions, and turn the permutations into a p-value
and an interval.

Conditions are the sample: somebody chose six methods out of all that could have been compared. A condition keeps its
scores on all datasets together when it changes place, because scores and measures of a condition on different datasets
are alike.
"""

from __future__ import annotations

from itertools import permutations, product
from math import factorial, prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.settings import LEVEL
from app.analysis.objective.points import Indices, Points

Array = NDArray[np.float64]

MOST_ORDERS = 1000  # all orders if there are fewer, as with six conditions; else so many drawn at random
FEWEST_CONDITIONS = 5  # with fewer, no rank correlation is rare enough for an interval to mean anything
NEARLY_ONE = 0.995  # larger correlations count as 1, which ranks and curves reach with few points
ROUNDING = 1e-9  # correlations that differ by less are equal


class Chance(NamedTuple):
    """A correlation beside what chance makes of it.

    Parameters
    ----------
    low, high : limits of the 95 % interval; None with fewer than five conditions
    p_value : share of orders of the conditions whose correlation is at least as large, either way
    """

    low: float | None
    high: float | None
    p_value: float


def condition_orders(points: Points, rng: np.random.Generator) -> Indices:
    """Return the orders in which the scores could have belonged to the conditions, the observed order first.

    Conditions change places only with others that are in the same datasets. So if every dataset has conditions of its
    own, each dataset is permuted by itself.

    Parameters
    ----------
    points : N points
    rng : Generator, used where there are too many orders to take all

    Returns
    -------
    intp (P, N), for each point the one whose score it gets
    """
    place = np.full((points.dataset.max(initial=-1) + 1, points.condition.max(initial=-1) + 1), -1)
    place[points.dataset, points.condition] = np.arange(len(points))
    groups: dict[bytes, list[int]] = {}
    for condition in np.unique(points.condition).tolist():
        groups.setdefault((place[:, condition] >= 0).tobytes(), []).append(condition)
    taken = np.arange(place.shape[1])
    orders = np.tile(taken, (_n_orders(list(groups.values())), 1))
    if len(orders) < MOST_ORDERS:
        for row, arranged in enumerate(product(*(permutations(group) for group in groups.values()))):
            for group, order in zip(groups.values(), arranged, strict=True):
                orders[row, group] = order
    else:
        for group in groups.values():
            orders[1:, group] = rng.permuted(np.tile(group, (len(orders) - 1, 1)), axis=1)
    return np.asarray(place[points.dataset, orders[:, points.condition]])


def _n_orders(groups: list[list[int]]) -> int:
    return min(prod(factorial(len(group)) for group in groups), MOST_ORDERS)


def chance(correlations: Array, observed: float, n_conditions: int) -> Chance:
    """Return the p-value and the interval of a correlation.

    The interval is Fisher's, with the spread that the orders show: tanh(atanh(r) - c) to tanh(atanh(r) + c), where c is
    the 95 % quantile of |atanh(r)| over the orders. So it excludes zero where the permutation test rejects zero, and
    for a normal sample it is Fisher's interval. Equal correlations count half (mid-p), else rank correlations of six
    conditions would err in 2 to 3 % instead of 5 %; the p-value counts them whole, so that it is exact.

    Parameters
    ----------
    correlations : float64 (P,), -1 to 1, one of each order of the conditions, the observed order first
    observed : the correlation to report; differs from the first where that was found on a coarser grid
    n_conditions : number of conditions

    Source
    ------
    Fisher (1921); mid-p: Lancaster (1961); random orders with the observed one counted: Phipson and Smyth (2010).
    """
    sizes = np.abs(correlations)
    p_value = float(np.mean(sizes >= sizes[0] - ROUNDING))
    if n_conditions < FEWEST_CONDITIONS:
        return Chance(None, None, p_value)
    levels, counts = np.unique(np.round(sizes, 9).astype(np.float64), return_counts=True)
    half = _upper_quantile(levels, counts)
    inner = levels[levels < NEARLY_ONE]
    limit = (1 + inner[-1]) / 2 if len(inner) else 0.5  # a perfect correlation of few points is not certain
    centre = np.arctanh(np.clip(observed, -limit, limit))
    low, high = np.tanh(centre - half), np.tanh(centre + half)
    return Chance(float(min(low, observed)), float(max(high, observed)), p_value)


def _upper_quantile(levels: Array, counts: NDArray[np.intp]) -> float:
    """Return atanh of the level above which 5 % of the correlations lie, between two levels linearly; equal ones count
    half.
    """
    above = (np.cumsum(counts[::-1])[::-1] - counts / 2) / counts.sum()  # falls with the level
    if above[-1] > 1 - LEVEL + ROUNDING:
        return float(np.inf)
    level = float(np.interp(LEVEL, 1 - above, np.minimum(levels, 1.0)))
    return float(np.arctanh(level)) if level < 1 else float(np.inf)

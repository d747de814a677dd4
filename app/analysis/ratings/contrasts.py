"""Find which conditions the ratings tell apart: paired differences of all conditions, corrected by Holm's method."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from app.analysis.contrasts import MOST_ITEMS, Contrast, critical_value, holm
from app.analysis.ratings.opinion_scores import columns_by_condition, mean_with_interval, person_means
from app.analysis.ratings.table import RatingTable

Array = NDArray[np.float64]

ALIKE = 1e-9  # grades; a smaller error is rounding


def rating_contrasts(table: RatingTable) -> list[Contrast]:
    """Compare the mean ratings of every two conditions over the datasets on which both were rated.

    A participant's ratings of two conditions are paired, so individual biases cancel out. The interval is that of a
    mean over participants, t(n - 1). If all differ by the same amount, a sign test gives the p-value.

    Returns
    -------
    list of Contrast, of grades; empty with more than 40 conditions, and without pairs that two participants rated
    """
    conditions = columns_by_condition(table)
    if len(conditions) > MOST_ITEMS:
        return []
    rows = list(_differences(person_means(table), table, conditions))
    corrected = holm(np.array([p_value for *_, p_value in rows])).tolist()
    return [
        Contrast(first, second, mean, se, p_value, p_holm, mean - half, mean + half, "difference of means")
        for (first, second, mean, se, half, p_value), p_holm in zip(rows, corrected, strict=True)
    ]


def _differences(
    means: Array, table: RatingTable, conditions: dict[str, list[int]]
) -> Iterator[tuple[str, str, float, float, float, float]]:
    """Yield names, difference, its error, half its interval, and its p-value of each pair that has an error."""
    for first, second in combinations(conditions, 2):
        columns = {table.items[column][0]: column for column in conditions[second]}
        both = [(c, columns[table.items[c][0]]) for c in conditions[first] if table.items[c][0] in columns]
        values = np.array([means[:, a] - means[:, b] for a, b in both]).T
        difference = mean_with_interval(values) if both else {"n": 0}
        if difference["n"] > 1:
            n, mean = difference["n"], difference["mean"]
            half = difference["ci_high"] - mean
            se = half / critical_value(n)
            yield first, second, mean, se, half, _p_value(mean, se, n)


def _p_value(mean: float, se: float, n: int) -> float:
    if se > ALIKE:
        return float(2 * student.sf(abs(mean) / se, n - 1))
    return 1.0 if abs(mean) < ALIKE else 2 * 0.5**n

"""Find which conditions the ratings tell apart: paired differences of all conditions, corrected by Holm's method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import MOST_ITEMS, Contrast, holm, two_sided
from app.analysis.model.separation import SIGN_TEST
from app.analysis.ratings.opinion_scores import ALIKE, columns_by_condition, mean_with_interval, person_means
from app.analysis.ratings.table import RatingTable

Array = NDArray[np.float64]


def rating_contrasts(table: RatingTable) -> list[Contrast]:
    """Compare the mean ratings of every two conditions over the datasets on which both were rated.

    Returns
    -------
    list of Contrast, as from `paired_contrasts`
    """
    datasets = [dataset for dataset, _ in table.items]
    return paired_contrasts(person_means(table), datasets, columns_by_condition(table))


def paired_contrasts(
    means: Array, datasets: Sequence[str], columns_by_condition: Mapping[str, Sequence[int]]
) -> list[Contrast]:
    """Compare every two conditions by the ratings of those who rated both.

    A participant's ratings of two conditions are paired, so individual biases cancel out. The interval is that of a
    mean over participants, t(n - 1). If all differ by the same amount, a sign test gives the p-value, and there is no
    interval.

    Parameters
    ----------
    means : float64 (P, I), as from `person_means`
    datasets : the dataset of each item, (I,)
    columns_by_condition : condition -> its items, at most one of each dataset

    Returns
    -------
    list of Contrast, of grades; empty with more than 40 conditions, and without pairs that two participants rated
    """
    if len(columns_by_condition) > MOST_ITEMS:
        return []
    rows: list[Contrast] = []
    for first, second in combinations(columns_by_condition, 2):
        partner = {datasets[column]: column for column in columns_by_condition[second]}
        both = [(a, partner[datasets[a]]) for a in columns_by_condition[first] if datasets[a] in partner]
        row = mean_with_interval(np.array([means[:, a] - means[:, b] for a, b in both]).T) if both else {"n": 0}
        if row["n"] > 1:
            rows.append(Contrast(first, second, row["mean"], *_tested(row)))
    corrected = holm(np.array([row.p_value for row in rows])).tolist()
    return [replace(row, p_holm=p_holm) for row, p_holm in zip(rows, corrected, strict=True)]


def _tested(row: Mapping[str, Any]) -> tuple[float | None, float, float, float | None, float | None, str]:
    """Return error, p-values, limits and method of a mean difference, as `mean_with_interval` gives it.

    Without any spread an error of zero would say that other people are certain to agree.
    """
    mean, error = row["mean"], row["se"]
    if error > ALIKE:
        p_value = float(two_sided(np.array(mean / error), 1 + row["freedom"]))
        return error, p_value, 1.0, row["ci_low"], row["ci_high"], "difference of means"
    return None, 1.0 if abs(mean) < ALIKE else 2 * 0.5 ** row["n"], 1.0, None, None, SIGN_TEST[True]

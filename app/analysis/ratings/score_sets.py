"""Take from ratings what measures are compared with: scores, their intervals, and which pairs of items differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from app.analysis.contrasts import MOST_ITEMS, SIGNIFICANT, holm
from app.analysis.objective.points import ScoreSet
from app.analysis.ratings.opinion_scores import item_rows, person_means
from app.analysis.ratings.table import RatingTable

Row = Mapping[str, Any]
Array = NDArray[np.float64]
FEWEST_PARTICIPANTS = 2  # who rated both items of a pair


def opinion_score_sets(table: RatingTable) -> dict[str, ScoreSet]:
    """Return dataset -> mean opinion scores; two items differ by a paired t-test over participants, Holm-corrected.

    Parameters
    ----------
    table : RatingTable
    """
    means, columns = person_means(table), {place: column for column, place in enumerate(table.items)}
    sets = {}
    for dataset, rows in _by_dataset(item_rows(table), "mos").items():
        different, similar = _tested(means[:, [columns[dataset, row["condition"]] for row in rows]])
        sets[dataset] = _score_set(rows, "mos", different, similar)
    return sets


def comparison_score_sets(rows: Sequence[Row]) -> dict[str, ScoreSet]:
    """Return dataset -> scores of comparisons; which pairs differ is left open.

    Parameters
    ----------
    rows : `comparison_items` of `analyse_comparisons`
    """
    single = [row for row in rows if row["dataset"] != "all"]
    return {dataset: _score_set(part, "score") for dataset, part in _by_dataset(single or rows, "score").items()}


def _by_dataset(rows: Any, score: str) -> dict[str, list[Row]]:
    parts: dict[str, list[Row]] = {}
    for row in rows:
        if row[score] is not None:
            parts.setdefault(row["dataset"], []).append(row)
    return parts


def _score_set(
    rows: Sequence[Row], score: str, different: Sequence[tuple[int, int]] = (), similar: Sequence[tuple[int, int]] = ()
) -> ScoreSet:
    half_widths = [np.nan if row["ci_low"] is None else (row["ci_high"] - row["ci_low"]) / 2 for row in rows]
    scores = np.array([row[score] for row in rows], np.float64)
    return ScoreSet(tuple(row["condition"] for row in rows), scores, np.array(half_widths), different, similar)


def _tested(means: Array) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return the pairs of items that differ, the better first, and the other pairs that enough participants rated.

    Where all participants see the same difference, its error is zero and says nothing about other people: the pair
    does not count as different.

    Parameters
    ----------
    means : float64 (P, I), each participant's mean rating of each item, NaN where missing
    """
    n_items = means.shape[1]
    if n_items > MOST_ITEMS:
        return [], []
    first, second = np.triu_indices(n_items, 1)
    differences = means[:, first] - means[:, second]  # (P, K)
    n = np.sum(~np.isnan(differences), axis=0)
    is_tested = n >= FEWEST_PARTICIPANTS
    first, second, differences, n = first[is_tested], second[is_tested], differences[:, is_tested], n[is_tested]
    if not len(n):
        return [], []
    mean, error = np.nanmean(differences, axis=0), np.nanstd(differences, axis=0, ddof=1) / np.sqrt(n)
    varies = error > 0
    p_values = np.ones(len(n))
    p_values[varies] = 2 * student.sf(np.abs(mean[varies] / error[varies]), n[varies] - 1)
    is_different = holm(p_values) < SIGNIFICANT
    pairs = [(int(a), int(b)) if up else (int(b), int(a)) for a, b, up in zip(first, second, mean > 0, strict=True)]
    different = [pair for pair, apart in zip(pairs, is_different, strict=True) if apart]
    return different, [pair for pair, apart in zip(pairs, is_different, strict=True) if not apart]

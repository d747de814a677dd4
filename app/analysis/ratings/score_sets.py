"""Take from ratings what measures are compared with: scores, their intervals, and which pairs of items differ."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from app.analysis.model.contrasts import Contrast
from app.analysis.objective.points import ScoreSet, score_set
from app.analysis.ratings.contrasts import paired_contrasts
from app.analysis.ratings.opinion_scores import item_rows, person_means
from app.analysis.ratings.table import RatingTable
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]


def opinion_score_sets(table: RatingTable) -> dict[str, ScoreSet]:
    """Return dataset -> mean opinion scores; two items differ as `paired_contrasts` tells.

    Parameters
    ----------
    table : RatingTable
    """
    means, columns = person_means(table), {item: column for column, item in enumerate(table.items)}
    datasets = [dataset for dataset, _ in table.items]
    sets = {}
    for dataset, rows in _by_dataset(item_rows(table), "mos").items():
        rated = {row["condition"]: [columns[dataset, row["condition"]]] for row in rows}
        sets[dataset] = _score_set(rows, "mos", paired_contrasts(means, datasets, rated))
    return sets


def comparison_score_sets(rows: Sequence[Row]) -> dict[str, ScoreSet]:
    """Return dataset -> scores of comparisons; which pairs differ is left open.

    Parameters
    ----------
    rows : `comparison_items` of `analyse_comparisons`
    """
    single = [row for row in rows if row["dataset"] != ALL]
    return {dataset: _score_set(part, "score") for dataset, part in _by_dataset(single or rows, "score").items()}


def _by_dataset(rows: Iterable[Row], score: str) -> dict[str, list[Row]]:
    parts: dict[str, list[Row]] = {}
    for row in rows:
        if row[score] is not None:
            parts.setdefault(row["dataset"], []).append(row)
    return parts


def _score_set(rows: Sequence[Row], score: str, contrasts: Sequence[Contrast] = ()) -> ScoreSet:
    half_widths = [np.nan if row["ci_low"] is None else (row["ci_high"] - row["ci_low"]) / 2 for row in rows]
    scores = np.array([row[score] for row in rows], np.float64)
    return score_set(tuple(row["condition"] for row in rows), scores, np.array(half_widths), contrasts)

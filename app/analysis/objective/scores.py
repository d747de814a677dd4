"""Take from a fit what measures are compared with: scores, their intervals, and which pairs of items differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.analysis.comparison import ALL, Comparison
from app.analysis.contrasts import SIGNIFICANT
from app.analysis.objective.points import ScoreSet
from app.analysis.result_rows import intervals
from app.analysis.separation import NEVER_COMPARED


def score_sets(compared: Sequence[Comparison]) -> dict[str, ScoreSet]:
    """Return dataset -> scores of all items, of the single datasets if there are any, else of all votes together."""
    there = {
        comparison.dataset: score_set(comparison)
        for comparison in compared
        if comparison.comparison == ALL and comparison.fit.scores is not None
    }
    return {dataset: scores for dataset, scores in there.items() if dataset != ALL} or there


def score_set(comparison: Comparison) -> ScoreSet:
    """Return the scores of a fit that has any; which pairs differ is left open where there are no tests."""
    fit = comparison.fit
    assert fit.scores is not None
    low, high, _ = intervals(fit, comparison.bootstrap)
    half_widths = np.full(len(fit.items), np.nan) if low is None or high is None else (high - low) / 2
    place = {item: index for index, item in enumerate(fit.items)}
    different: list[tuple[int, int]] = []
    similar: list[tuple[int, int]] = []
    for contrast in comparison.contrasts:
        if contrast.method == NEVER_COMPARED:
            continue
        a, b = place[contrast.item_a], place[contrast.item_b]
        better_first = (a, b) if contrast.difference > 0 else (b, a)
        (different if contrast.p_holm < SIGNIFICANT else similar).append(better_first)
    return ScoreSet(fit.items, fit.scores, half_widths, different, similar)

"""Take from a fit what measures are compared with: scores, their intervals, and which pairs of items differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.analysis.comparisons.comparison import Comparison
from app.analysis.comparisons.result_rows import intervals
from app.analysis.model.contrasts import NEVER_COMPARED
from app.analysis.objective.points import ScoreSet, score_set
from app.analysis.reading.votes_table import ALL


def score_sets(compared: Sequence[Comparison]) -> dict[str, ScoreSet]:
    """Return dataset -> scores of all items, of the single datasets if there are any, else of all votes together."""
    there = {
        comparison.dataset: _score_set(comparison)
        for comparison in compared
        if comparison.comparison == ALL and comparison.fit.scores is not None
    }
    return {dataset: scores for dataset, scores in there.items() if dataset != ALL} or there


def _score_set(comparison: Comparison) -> ScoreSet:
    """Return the scores of a fit that has any; which pairs differ is left open where there are no tests."""
    fit = comparison.fit
    scores = fit.ranked_scores
    assert scores is not None
    low, high, _ = intervals(fit, comparison.bootstrap)
    half_widths = np.full(len(fit.items), np.nan) if low is None or high is None else (high - low) / 2
    tested = [contrast for contrast in comparison.contrasts if contrast.method != NEVER_COMPARED]
    return score_set(fit.items, scores, half_widths, tested)

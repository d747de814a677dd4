"""How often what is said of objective measures beside scores is right, in simulated studies.

A part of `bench/sentences.py`, which prints the lines.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))
from verdicts import Kind, line, study

from app.analysis.comparisons.comparison import compare
from app.analysis.model.contrasts import SIGNIFICANT, holm
from app.analysis.model.settings import AnalysisSettings
from app.analysis.objective.correlations import pearsons
from app.analysis.objective.permutation import chance, condition_orders
from app.analysis.objective.points import Points, matched
from app.analysis.objective.scores import score_sets

Array = NDArray[np.float64]


def measure_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often random measures are said to go with the scores, of twelve."""
    for people in (8, 22, 60):
        rng, hits = np.random.default_rng(seed), []
        for _ in range(n_studies):
            votes, _ = study(Kind(people=people), rng)
            values = {
                f"m{number}": {f"d{k}": dict(zip(votes.items, rng.random(6).tolist(), strict=True)) for k in range(5)}
                for number in range(12)
            }
            sets = score_sets(list(compare(votes, AnalysisSettings())))
            p_values = [_pearson_p(matched(sets, by_dataset), rng) for by_dataset in values.values()]
            hits.append(float((holm(np.array(p_values)) < SIGNIFICANT).any()))
        yield line(f"{people} people: any of 12 random measures goes with the scores (Holm)", hits)


def _pearson_p(points: Points, rng: np.random.Generator) -> float:
    """Return the p-value of Pearson's correlation over all datasets, as `prediction_rows` has it."""
    by_order = pearsons(points.relative_values, points.relative_scores[condition_orders(points, rng)])
    return chance(by_order, float(by_order[0]), points.n_conditions).p_value


MEASURES: dict[str, Callable[[int, int], Iterator[str]]] = {
    "measures": measure_lines,
}

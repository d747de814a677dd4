"""How often what is said of objective measures beside scores is right, in simulated studies.

A part of `bench/sentences.py`, which prints the lines.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))
from verdicts import Kind, drawn_kind, line, study

from app.analysis.comparisons.comparison import compare
from app.analysis.model.contrasts import SIGNIFICANT, holm
from app.analysis.model.settings import AnalysisSettings
from app.analysis.objective.comparison import comparison_rows
from app.analysis.objective.correlations import pearsons
from app.analysis.objective.permutation import chance, condition_orders
from app.analysis.objective.points import Points, matched
from app.analysis.objective.prediction import describe
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


@dataclass(frozen=True)
class Stimuli:
    """How true scores and measures come about: standard deviations, log-odds.

    Parameters
    ----------
    of_conditions, of_scenes : of what a condition has on all datasets, and on each alone; of scores and measures alike
    """

    people: int = 22
    conditions: int = 6
    of_conditions: float = 0.5
    of_scenes: float = 0.0


STIMULI = {
    "22 people": Stimuli(),
    "60 people": Stimuli(people=60),
    "22, 12 conditions": Stimuli(conditions=12),
    "22, scenes differ": Stimuli(of_scenes=0.4),
    "22, 12 conditions, scenes differ": Stimuli(conditions=12, of_scenes=0.4),
}
TRUE = {"none": 0.0, "none too": 0.0, "middle": 0.6, "middle too": 0.6, "high": 0.9}  # correlations of measures
DATASETS = 5
CURVES = ("pearson_logistic", "pearson_logistic5", "pearson_monotone")


def correlation_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often intervals of correlations hold the true ones: of conditions like these, and of these alone."""
    for name, stimuli in STIMULI.items():
        rng, values = np.random.default_rng(seed), dict[str, list[float]]()
        for _ in range(n_studies):
            for what, value in _correlated(stimuli, rng):
                values.setdefault(what, []).append(value)
        yield from (line(f"measures, {name}: {what}", each) for what, each in values.items())


def _correlated(stimuli: Stimuli, rng: np.random.Generator) -> Iterator[tuple[str, float]]:
    """Yield of a study which intervals hold, and what tests of measures against each other say."""
    scores, *own = (
        stimuli.of_conditions * rng.standard_normal((1, stimuli.conditions))
        + stimuli.of_scenes * rng.standard_normal((DATASETS, stimuli.conditions))
        for _ in range(1 + len(TRUE))
    )
    measured = {
        name: rho * scores + np.sqrt(1 - rho**2) * part for (name, rho), part in zip(TRUE.items(), own, strict=True)
    }
    kind = drawn_kind(Kind(people=stimuli.people, datasets=DATASETS, conditions=stimuli.conditions), scores)
    sets = score_sets(list(compare(study(kind, rng)[0], AnalysisSettings())))
    measures = {
        name: {f"d{d}": {f"C{c}": float(value) for c, value in enumerate(row)} for d, row in enumerate(values)}
        for name, values in measured.items()
    }
    points = {name: matched(sets, values) for name, values in measures.items()}
    orders = condition_orders(points["none"], rng)
    for name in ("none", "middle", "high"):
        here = float(np.corrcoef(_relative(measured[name]), _relative(scores))[0, 1])
        yield from _held(describe(points[name], orders, "higher"), TRUE[name], here)
    for row in comparison_rows(points, dict.fromkeys(TRUE, "higher"), rng):
        a, b = row["measure_a"], row["measure_b"]
        if TRUE[a] == TRUE[b] or (a, b) == ("middle", "high"):
            for name in ("p_value", "auc_p"):
                yield f"{TRUE[a]} against {TRUE[b]}, {name} below 5 %", _below(row[name])


def _held(row: dict[str, Any], rho: float, here: float) -> Iterator[tuple[str, float]]:
    """Yield which intervals of a measure hold its correlation with scores of conditions like these, and of these."""
    population = {"pearson": rho, "spearman": 6 / np.pi * np.arcsin(rho / 2), "kendall": 2 / np.pi * np.arcsin(rho)}
    for name, true in (population | dict.fromkeys(CURVES, rho)).items():
        yield f"{rho}, {name} holds", float(row[f"{name}_low"] <= true <= row[f"{name}_high"])
    yield f"{rho}, pearson holds that of these stimuli", float(row["pearson_low"] <= here <= row["pearson_high"])
    for name in ("pearson_p", "pairs_correct_p"):
        yield f"{rho}, {name} below 5 %", _below(row[name])


def _relative(values: Array) -> Array:
    """Return values less their dataset's mean, (D n,); of a single row for all datasets it is repeated."""
    every = np.broadcast_to(values, (DATASETS, values.shape[1]))
    return np.asarray((every - every.mean(axis=1, keepdims=True)).ravel())


def _below(p_value: float | None) -> float:
    return np.nan if p_value is None else float(p_value < SIGNIFICANT)


MEASURES: dict[str, Callable[[int, int], Iterator[str]]] = {
    "measures": measure_lines,
    "correlations": correlation_lines,
}

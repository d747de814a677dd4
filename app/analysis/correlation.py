"""Correlate objective measures with scores: linear, monotone and rank correlations, and the share of pairs in the right
order, over datasets and items.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression
from scipy.stats import kendalltau, rankdata

Array = NDArray[np.float64]
Measures = Mapping[str, Mapping[str, Mapping[str, float]]]  # measure -> dataset -> item -> value

ALL = "all"
SIGNIFICANT = 0.05
LEVEL = 0.95
FEWEST_POINTS = 3  # two always lie on a line


@dataclass(frozen=True)
class ScoreSet:
    """Scores of a dataset.

    Parameters
    ----------
    items : names
    scores : float64 (n,), log-odds
    replicates : float64 (R, n), log-odds, scores of the participant bootstrap, NaN in replicates without a maximum; R
        is 0 without a bootstrap
    different : pairs of indices of items, the better first, that differ significantly
    """

    items: tuple[str, ...]
    scores: Array
    replicates: Array
    different: Sequence[tuple[int, int]]


def correlation_rows(
    by_dataset: Mapping[str, ScoreSet], measures: Measures, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Correlate every measure with the scores, on each dataset and over all.

    Scores of different datasets have no common zero, so over all datasets both sides are taken relative to their
    dataset's mean.

    Parameters
    ----------
    by_dataset : dataset -> scores; datasets and items without a value of the measure are left out, and counted
    measures : measure -> dataset -> item -> value
    rng : Generator, for the resampling of datasets; participants were resampled before

    Returns
    -------
    list of dict, `measure, dataset, n, n_missing, pearson, pearson_monotone, spearman, kendall, pairs_different,
    pairs_correct`, and 95 % intervals of the correlations and of `pairs_correct` (`…_low, …_high`) from resampling
    participants, over all datasets also datasets; None without replicates. A measure of which less is better has
    negative correlations. Pairs count as correct in the direction of the measure's rank correlation, so that an
    uninformative measure gets slightly more than one half.
    """
    rows = []
    for measure, values in measures.items():
        parts = {name: part for name, part in _matched(by_dataset, values).items() if len(part[0]) >= 2}
        missing = sum(len(score_set.items) for score_set in by_dataset.values()) - sum(
            len(part[0]) for part in parts.values()
        )
        measure_rows = [
            {"measure": measure, "dataset": name, "n_missing": len(by_dataset[name].items) - len(part[0])}
            | _described([part], rng)
            for name, part in parts.items()
        ]
        if len(parts) > 1:
            together = list(parts.values())
            measure_rows.append({"measure": measure, "dataset": ALL, "n_missing": missing} | _described(together, rng))
        rows += measure_rows
    return rows


Part = tuple[Array, Array, Array, list[tuple[int, int]]]  # values, scores, replicates, significantly different pairs


def _matched(by_dataset: Mapping[str, ScoreSet], values: Mapping[str, Mapping[str, float]]) -> dict[str, Part]:
    parts = {}
    for dataset, score_set in by_dataset.items():
        known = values.get(dataset, {})
        there = [index for index, item in enumerate(score_set.items) if item in known]
        place = {index: new for new, index in enumerate(there)}
        pairs = [(place[a], place[b]) for a, b in score_set.different if a in place and b in place]
        value = np.array([known[score_set.items[index]] for index in there], float)
        parts[dataset] = (value, score_set.scores[there], score_set.replicates[:, there], pairs)
    return parts


def _described(parts: Sequence[Part], rng: np.random.Generator) -> dict[str, Any]:
    observed = [(values, scores, pairs) for values, scores, _, pairs in parts]
    return _association(observed) | _intervals(parts, rng)


def _association(parts: Sequence[tuple[Array, Array, list[tuple[int, int]]]]) -> dict[str, Any]:
    """Return the correlations and the share of pairs in order from values, scores and significantly different pairs."""
    values = np.concatenate([_centred(part[0]) for part in parts])
    scores = np.concatenate([_centred(part[1]) for part in parts])
    direction = defined(spearman, values, scores) or 0.0
    differences = [value[a] - value[b] for value, _, pairs in parts for a, b in pairs]
    correct = float(sum(1.0 if d * direction > 0 else 0.5 * (d == 0) for d in differences))
    return {
        "n": len(values),
        **{name: defined(correlation, values, scores) for name, correlation in CORRELATIONS.items()},
        "pairs_different": len(differences),
        "pairs_correct": correct / len(differences) if differences and direction else None,
    }


def _centred(values: Array) -> Array:
    """Subtract the mean; equal values become exactly zero, without rounding noise."""
    return np.zeros_like(values) if np.ptp(values) == 0 else values - values.mean()


def defined(correlation: Callable[[Array, Array], float], values: Array, scores: Array) -> float | None:
    """Return a correlation; None for fewer than three points, or if either side is constant.

    Parameters
    ----------
    correlation : function of values and scores
    values : float64 (n,), of the measure
    scores : float64 (n,), log-odds
    """
    if len(values) < FEWEST_POINTS or np.ptp(values) == 0 or np.ptp(scores) == 0:
        return None
    return correlation(values, scores)


def pearson(values: Array, scores: Array) -> float:
    """Return the linear correlation of float64 (n,) values; each side is scaled first, so squares of tiny differences
    do not vanish.
    """
    x, y = (part - part.mean() for part in (values, scores))
    x, y = x / np.abs(x).max(), y / np.abs(y).max()
    return float(x @ y / np.sqrt((x @ x) * (y @ y)))


def spearman(values: Array, scores: Array) -> float:
    """Return the rank correlation of float64 (n,) values."""
    return pearson(rankdata(values), rankdata(scores))


def kendall(values: Array, scores: Array) -> float:
    """Return Kendall's tau-b of float64 (n,) values."""
    return float(kendalltau(values, scores).statistic)


def monotone_pearson(values: Array, scores: Array) -> float:
    """Return the correlation of the scores with their best monotone function of the measure, both float64 (n,).

    It has the sign of the function's direction and is never smaller in size than the linear correlation. With few
    points it flatters the measure, so the report also gives the others.
    """
    sign = 1.0 if spearman(values, scores) >= 0 else -1.0
    _, place, times = np.unique(sign * values, return_inverse=True, return_counts=True)
    means = np.bincount(place, scores) / times  # items of equal measure get one value
    fitted = np.asarray(isotonic_regression(means, weights=times).x)[place]
    return 0.0 if np.ptp(fitted) == 0 else sign * pearson(fitted, scores)


def _intervals(parts: Sequence[Part], rng: np.random.Generator) -> dict[str, Any]:
    """Return percentile intervals from the replicates' scores; with several datasets, these are resampled here."""
    samples: dict[str, list[float]] = {name: [] for name in (*CORRELATIONS, "pairs_correct")}
    for replicate in range(min(len(part[2]) for part in parts)):
        chosen = [parts[index] for index in rng.integers(0, len(parts), len(parts))]
        drawn = [(values, replicates[replicate], pairs) for values, _, replicates, pairs in chosen]
        if not any(np.isnan(scores).any() for _, scores, _ in drawn):
            for name, value in _association(drawn).items():
                if value is not None and name in samples:
                    samples[name].append(value)
    tail = (1 - LEVEL) / 2
    limits: dict[str, Any] = {}
    for name, values in samples.items():
        low, high = np.quantile(values, [tail, 1 - tail]).tolist() if values else (None, None)
        limits |= {f"{name}_low": low, f"{name}_high": high}
    return limits


CORRELATIONS: dict[str, Callable[[Array, Array], float]] = {
    "pearson": pearson,
    "pearson_monotone": monotone_pearson,
    "spearman": spearman,
    "kendall": kendall,
}

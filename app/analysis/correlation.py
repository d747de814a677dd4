"""Do objective measures predict what people prefer? Every measure against the scores, over datasets and items."""

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
FEWEST = 3  # points; two always lie on a line


@dataclass(frozen=True)
class ScoreSet:
    """The scores of one dataset.

    Parameters
    ----------
    items : tuple of str
    scores : float64 (n,)
    replicates : float64 (R, n)
        Scores of the participant bootstrap, NaN in replicates without a maximum; R is 0 without a bootstrap.
    different : list of (int, int)
        Pairs of items, better one first, that differ significantly.
    """

    items: tuple[str, ...]
    scores: Array
    replicates: Array
    different: Sequence[tuple[int, int]]


def correlation_rows(
    by_dataset: Mapping[str, ScoreSet], measures: Measures, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Correlate every measure with the scores, in each dataset and over all.

    Scores say nothing across datasets, so over all of them both sides are taken relative to their dataset's mean.

    Parameters
    ----------
    by_dataset : mapping
        Dataset -> scores; datasets and items without a value of the measure are left out, and counted.
    measures : mapping
        Measure -> dataset -> item -> value.
    rng : Generator
        Of the resampling of datasets; participants were drawn already.

    Returns
    -------
    list of dict
        `measure, dataset, n, n_missing, pearson, pearson_monotone, spearman, kendall, pairs_different,
        pairs_correct`, and 95 % intervals of the correlations and of the last (`…_low, …_high`) from resampling
        participants, over all datasets also datasets; None without replicates. A measure of which less is better has
        negative correlations. Pairs count as correct in the direction of its rank correlation, which gives a measure
        that says nothing somewhat more than one half.
    """
    rows = []
    for measure, values in measures.items():
        parts = {name: part for name, part in _matched(by_dataset, values).items() if len(part[0]) >= 2}
        missing = sum(len(one.items) for one in by_dataset.values()) - sum(len(part[0]) for part in parts.values())
        found = [
            {"measure": measure, "dataset": name, "n_missing": len(by_dataset[name].items) - len(part[0])}
            | _described([part], rng)
            for name, part in parts.items()
        ]
        if len(parts) > 1:
            together = list(parts.values())
            found.append({"measure": measure, "dataset": ALL, "n_missing": missing} | _described(together, rng))
        rows += found
    return rows


Part = tuple[Array, Array, Array, list[tuple[int, int]]]  # values, scores, replicates, significantly different pairs


def _matched(by_dataset: Mapping[str, ScoreSet], values: Mapping[str, Mapping[str, float]]) -> dict[str, Part]:
    parts = {}
    for dataset, one in by_dataset.items():
        known = values.get(dataset, {})
        there = [index for index, item in enumerate(one.items) if item in known]
        place = {index: new for new, index in enumerate(there)}
        pairs = [(place[a], place[b]) for a, b in one.different if a in place and b in place]
        value = np.array([known[one.items[index]] for index in there], float)
        parts[dataset] = (value, one.scores[there], one.replicates[:, there], pairs)
    return parts


def _described(parts: Sequence[Part], rng: np.random.Generator) -> dict[str, Any]:
    observed = [(values, scores, pairs) for values, scores, _, pairs in parts]
    return _association(observed) | _intervals(parts, rng)


def _association(parts: Sequence[tuple[Array, Array, list[tuple[int, int]]]]) -> dict[str, Any]:
    """Return the correlations and the pairs in order, of values, scores and significantly different pairs."""
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
    """Values without their mean; equal ones are zero, and no rounding noise."""
    return np.zeros_like(values) if np.ptp(values) == 0 else values - values.mean()


def defined(correlation: Callable[[Array, Array], float], values: Array, scores: Array) -> float | None:
    if len(values) < FEWEST or np.ptp(values) == 0 or np.ptp(scores) == 0:
        return None
    return correlation(values, scores)


def pearson(values: Array, scores: Array) -> float:
    """Return the linear correlation; each side is scaled first, so that squares of tiny differences do not vanish."""
    x, y = (part - part.mean() for part in (values, scores))
    x, y = x / np.abs(x).max(), y / np.abs(y).max()
    return float(x @ y / np.sqrt((x @ x) * (y @ y)))


def spearman(values: Array, scores: Array) -> float:
    """Return the correlation of the ranks."""
    return pearson(rankdata(values), rankdata(scores))


def kendall(values: Array, scores: Array) -> float:
    """Return Kendall's tau-b."""
    return float(kendalltau(values, scores).statistic)


def monotone_pearson(values: Array, scores: Array) -> float:
    """Return the correlation of the scores with the best monotone function of the measure, with the sign of its
    direction.

    Never below the linear correlation in size; with few points it flatters, so it stands beside the others.
    """
    sign = 1.0 if spearman(values, scores) >= 0 else -1.0
    _, place, times = np.unique(sign * values, return_inverse=True, return_counts=True)
    means = np.bincount(place, scores) / times  # a function has one value for what measures alike
    fitted = np.asarray(isotonic_regression(means, weights=times).x)[place]
    return 0.0 if np.ptp(fitted) == 0 else sign * pearson(fitted, scores)


def _intervals(parts: Sequence[Part], rng: np.random.Generator) -> dict[str, Any]:
    """Return percentile intervals: participants drawn for the replicates' scores, datasets drawn here if there are
    several.
    """
    found: dict[str, list[float]] = {name: [] for name in (*CORRELATIONS, "pairs_correct")}
    for replicate in range(min(len(part[2]) for part in parts)):
        chosen = [parts[index] for index in rng.integers(0, len(parts), len(parts))]
        drawn = [(values, replicates[replicate], pairs) for values, _, replicates, pairs in chosen]
        if not any(np.isnan(scores).any() for _, scores, _ in drawn):
            for name, value in _association(drawn).items():
                if value is not None and name in found:
                    found[name].append(value)
    tail = (1 - LEVEL) / 2
    limits: dict[str, Any] = {}
    for name, values in found.items():
        low, high = np.quantile(values, [tail, 1 - tail]).tolist() if values else (None, None)
        limits |= {f"{name}_low": low, f"{name}_high": high}
    return limits


CORRELATIONS: dict[str, Callable[[Array, Array], float]] = {
    "pearson": pearson,
    "pearson_monotone": monotone_pearson,
    "spearman": spearman,
    "kendall": kendall,
}

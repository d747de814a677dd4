"""The tables of scores against sizes: a row for each condition, and for each two methods that share sizes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.comparisons.comparison import Comparison
from app.analysis.model.bootstrap import Bootstrap
from app.analysis.model.contrasts import Estimates, half_widths, scores_of
from app.analysis.rates.curves import (
    BYTES,
    Curve,
    best_at_their_size,
    curve_of,
    difference_weights,
    level_of,
    method_of,
    numeric_factor,
)
from app.analysis.reading.votes_table import ALL

Array = NDArray[np.float64]
Row = Mapping[str, Any]
Factors = Mapping[str, Mapping[str, str]]


def rate_rows(scores: Sequence[Row], settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a row for each condition whose size and score are known, on each dataset and on all together.

    Over all datasets a size is the geometric mean, as sizes are compared by their ratios.

    Parameters
    ----------
    scores : `dataset, item, score, ci_low, ci_high`
    settings : of an analysis: its measures and factors
    """
    sizes, factors = settings["measures"].get(BYTES, {}), settings.get("factors", {})
    numeric = numeric_factor(factors)
    rows = []
    for dataset in dict.fromkeys(row["dataset"] for row in scores):
        known = _sizes_on(sizes, dataset)
        there = [row for row in scores if row["dataset"] == dataset and row["item"] in known]
        there = [row for row in there if row["score"] is not None]
        front = best_at_their_size([known[row["item"]] for row in there], [row["score"] for row in there])
        for row, is_best in zip(there, front, strict=True):
            item = row["item"]
            rows.append(
                {
                    "dataset": dataset,
                    "item": item,
                    "method": method_of(item, factors, numeric),
                    "level": level_of(item, factors, numeric),
                    "bytes": known[item],
                    **{name: row.get(name) for name in ("score", "ci_low", "ci_high")},
                    "is_on_front": is_best,
                }
            )
    return rows


def rate_differences(compared: Sequence[Comparison], settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the mean difference of every two methods' scores over the sizes that both have, with its interval.

    Parameters
    ----------
    compared : the fits of the items' scores
    settings : of an analysis: its measures and factors
    """
    sizes, factors = settings["measures"].get(BYTES, {}), settings["factors"]
    numeric = numeric_factor(factors)
    if not sizes or numeric is None:
        return []
    rows: list[dict[str, Any]] = []
    for comparison in compared:
        if comparison.comparison == ALL and comparison.fit.status == "ok":
            known = _sizes_on(sizes, comparison.dataset)
            curves = _curves(comparison.fit.items, known, factors, numeric)
            rows += _differences(comparison, curves)
    return rows


def _curves(items: Sequence[str], sizes: Mapping[str, float], factors: Factors, numeric: str) -> dict[str, Curve]:
    """Return the curves of the methods of two sizes or more."""
    places: dict[str, list[int]] = {}
    for place, item in enumerate(items):
        if item in sizes and item in factors[numeric]:
            places.setdefault(method_of(item, factors, numeric), []).append(place)
    every = [sizes.get(item, np.nan) for item in items]
    curves = {method: curve_of(places_of, every) for method, places_of in places.items()}
    return {method: curve for method, curve in curves.items() if curve is not None}


def _differences(comparison: Comparison, curves: Mapping[str, Curve]) -> Iterator[dict[str, Any]]:
    fit, estimates = comparison.fit, scores_of(comparison.fit) if comparison.fit.covariance is not None else None
    n = len(fit.items)
    for first, second in combinations(curves, 2):
        weighed = difference_weights(curves[first], curves[second], n)
        if weighed is None or fit.scores is None:
            continue
        weights, smallest, largest = weighed
        row: dict[str, Any] = {"dataset": comparison.dataset, "method_a": first, "method_b": second}
        row |= {"difference": float(weights @ fit.scores), "ci_low": None, "ci_high": None}
        limits = None if estimates is None else _interval(estimates, weights, comparison.bootstrap)
        if limits is not None:
            row |= {"ci_low": limits[0], "ci_high": limits[1]}
        yield row | {"bytes_low": smallest, "bytes_high": largest}


def _interval(estimates: Estimates, weights: Array, bootstrap: Bootstrap | None) -> tuple[float, float] | None:
    """Return the 95 % interval of a weighted sum of scores: of other participants, where they are known."""
    n = len(estimates.names)
    people, clustered = estimates.n_participants, estimates.participant_covariance

    def variance(covariance: Array) -> Array:
        return np.array([[weights @ covariance[:n, :n] @ weights]])

    summed = Estimates(
        ("difference",),
        np.array([weights @ estimates.values]),
        variance(estimates.covariance),
        None if clustered is None else variance(clustered),
        people,
        estimates.is_few,
    )
    half = half_widths(summed)
    if half is None or np.isnan(half[0]):
        return None
    if bootstrap is not None and not estimates.is_few and bootstrap.has_percentiles(people or 0):
        low, high = Bootstrap(bootstrap.scores @ weights[:, None], bootstrap.kept).interval(people or 0)[:, 0]
        return float(low), float(high)
    return float(summed.values[0] - half[0]), float(summed.values[0] + half[0])


def _sizes_on(sizes: Mapping[str, Mapping[str, float]], dataset: str) -> dict[str, float]:
    """Return the sizes of conditions on a dataset; over all, the geometric mean of those that have one everywhere."""
    single = {name: by_item for name, by_item in sizes.items() if name != ALL}
    everywhere = {item: size for item, size in sizes.get(ALL, {}).items() if size > 0}
    if dataset != ALL:
        return everywhere | {item: size for item, size in single.get(dataset, {}).items() if size > 0}
    logs: dict[str, list[float]] = {}
    for by_item in single.values():
        for item, size in by_item.items():
            if size > 0:
                logs.setdefault(item, []).append(float(np.log(size)))
    means = {item: float(np.exp(np.mean(values))) for item, values in logs.items() if len(values) == len(single)}
    return everywhere | means

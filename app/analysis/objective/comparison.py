"""Test whether a measure predicts the scores better than another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import holm, two_sided
from app.analysis.objective.pair_order import better_worse, pair_differences
from app.analysis.objective.permutation import FEWEST_CONDITIONS, ROUNDING
from app.analysis.objective.points import Points
from app.analysis.screening.correlation import pearson, spearman

Array = NDArray[np.float64]

MOST_SWAPS = 512  # all swaps of up to ten conditions; else so many drawn at random
LARGEST = 1 - 1e-6  # correlation; beyond it Fisher's z is a matter of rounding


def comparison_rows(measured: Mapping[str, Points], better: Mapping[str, str], rng: np.random.Generator) -> list[Any]:
    """Compare every two measures over the points that both have a value of.

    Parameters
    ----------
    measured : measure -> points, over all datasets together
    better : measure -> `higher` or `lower`, where it is known; else the direction of the rank correlation
    rng : Generator, for swaps of more than ten conditions

    Returns
    -------
    list of dict, `measure_a, measure_b, n, n_conditions, pearson_a, pearson_b, p_value, p_holm, auc_a, auc_b, auc_p,
    auc_p_holm`: correlations and areas in the direction of `better`; p-values of their differences, two-sided, alone
    and corrected by Holm (1979) for all pairs. None where there are fewer than five conditions.
    """
    directed = {measure: _directed(points, better.get(measure)) for measure, points in measured.items()}
    rows = list(_rows({measure: points for measure, points in directed.items() if _varies(points)}, rng))
    for name in ("p_value", "auc_p"):
        there = [row for row in rows if row[name] is not None]
        corrected = holm(np.array([row[name] for row in there])).tolist() if there else []
        for row, value in zip(there, corrected, strict=True):
            row[f"{name.removesuffix('_value')}_holm"] = value
    return rows


def _directed(points: Points, better: str | None) -> Points:
    """Turn a measure so that more is better."""
    falls = (
        better == "lower"
        if better
        else _varies(points) and spearman(points.relative_values, points.relative_scores) < 0
    )
    return replace(points, values=-points.values) if falls else points


def _varies(points: Points) -> bool:
    return bool(len(points)) and all(np.ptp(side) > 0 for side in (points.relative_values, points.relative_scores))


def _rows(measures: Mapping[str, Points], rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    known: dict[tuple[str, bytes], Array] = {}  # Fisher's z of a measure on some points
    for a, b in combinations(measures, 2):
        first, second = _shared(measures[a], measures[b])
        row: dict[str, Any] = {"measure_a": a, "measure_b": b, "n": len(first), "n_conditions": first.n_conditions}
        row |= dict.fromkeys(("pearson_a", "pearson_b", "p_value", "p_holm", "auc_a", "auc_b", "auc_p", "auc_p_holm"))
        if first.n_conditions >= FEWEST_CONDITIONS and _varies(first) and _varies(second):
            for measure, points in ((a, first), (b, second)):
                if (measure, points.key) not in known:
                    known[measure, points.key] = left_out_z(points)
            z_a, z_b = known[a, first.key], known[b, second.key]
            row |= {"pearson_a": float(np.tanh(z_a[0])), "pearson_b": float(np.tanh(z_b[0]))}
            row["p_value"] = jackknife_test(z_a, z_b)
            if len(first.different):
                row |= dict(zip(("auc_a", "auc_b", "auc_p"), swap_test(first, second, rng), strict=True))
        yield row


def _shared(first: Points, second: Points) -> tuple[Points, Points]:
    """Return both measures on the points that both have."""
    if first.key == second.key:
        return first, second
    width = 1 + max(first.condition.max(initial=0), second.condition.max(initial=0))
    keys = [part.dataset * width + part.condition for part in (first, second)]
    return first.where(np.isin(keys[0], keys[1])), second.where(np.isin(keys[1], keys[0]))


def left_out_z(points: Points) -> Array:
    """Return Fisher's z of the linear correlation: of all points, then without each condition in turn.

    Returns
    -------
    float64 (K + 1,), for K conditions
    """
    parts = (points.where(points.condition != condition) for condition in np.unique(points.condition))
    return np.array([_fisher_z(part) for part in (points, *parts)])


def _fisher_z(points: Points) -> float:
    if not _varies(points):
        return 0.0
    return float(np.arctanh(np.clip(pearson(points.relative_values, points.relative_scores), -LARGEST, LARGEST)))


def jackknife_test(first: Array, second: Array) -> float:
    """Return the two-sided p-value of a difference of linear correlations.

    The difference of Fisher's z is divided by its jackknife error, which leaves out a condition on all datasets at a
    time, and referred to t with one degree of freedom less than there are conditions. Formulas for dependent
    correlations (Williams 1959; Meng, Rosenthal and Rubin 1992) would take the points of a condition as independent.

    Parameters
    ----------
    first, second : float64 (K + 1,), of `left_out_z` for each measure on the same points

    Returns
    -------
    float; 1 where leaving out a condition changes nothing

    Source
    ------
    Tukey (1958); Efron and Tibshirani (1993), chapter 11.
    """
    difference, n_conditions = first - second, len(first) - 1
    error = float(np.sqrt((n_conditions - 1) * np.var(difference[1:])))
    return 1.0 if error < ROUNDING else float(two_sided(np.array(difference[0] / error), n_conditions))


def swap_test(first: Points, second: Points, rng: np.random.Generator) -> tuple[float, float, float]:
    """Compare the areas under the better-worse curves of two measures.

    If both measures predict alike, their values of a condition, in units of their standard deviation, could have been
    exchanged. The p-value is the share of all exchanges of conditions, on all datasets together, that make the areas
    differ as much as they do: with six conditions at least 2/64.

    Parameters
    ----------
    first, second : the same N points with the values of each measure
    rng : Generator, for more than ten conditions

    Returns
    -------
    both areas and the two-sided p-value
    """
    a, b = (part.relative_values / np.std(part.relative_values) for part in (first, second))
    is_swapped = _swaps(first.n_conditions, rng)[:, np.unique(first.condition, return_inverse=True)[1]]
    areas = [
        better_worse(pair_differences(np.where(is_swapped, *couple), first.different)) for couple in ((b, a), (a, b))
    ]
    sizes = np.abs(areas[0] - areas[1])
    return float(areas[0][0]), float(areas[1][0]), float(np.mean(sizes >= sizes[0] - ROUNDING))


def _swaps(n_conditions: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which conditions to exchange, bool (S, K), none in the first row; the complement of a row is the same."""
    if 2 ** (n_conditions - 1) <= MOST_SWAPS:
        return np.array([(False, *rest) for rest in product((False, True), repeat=n_conditions - 1)])
    swaps = rng.random((MOST_SWAPS, n_conditions)) < 0.5
    swaps[0] = False
    return swaps

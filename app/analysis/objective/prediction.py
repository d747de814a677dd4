"""Describe how well each measure predicts the scores, on each dataset and over all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.objective.correlations import kendalls, monotones, pearsons, spearmans
from app.analysis.objective.logistic import (
    PARAMETERS,
    PARAMETERS_WITH_LINE,
    fit_logistic,
    fit_logistic_with_line,
    grid_correlations,
)
from app.analysis.objective.pair_order import better_worse, different_similar, pair_differences, share_in_order
from app.analysis.objective.permutation import chance, condition_orders
from app.analysis.objective.points import Indices, Points, ScoreSet, matched
from app.analysis.reading.votes_table import ALL
from app.analysis.screening.correlation import FEWEST_POINTS

Array = NDArray[np.float64]
Measures = Mapping[str, Mapping[str, Mapping[str, float]]]  # measure -> dataset -> item -> value

SIGNS = {"higher": 1.0, "lower": -1.0}
CORRELATIONS = ("pearson", "pearson_logistic", "pearson_logistic5", "pearson_monotone", "spearman", "kendall")
SHARES = ("pairs_correct", "auc_better_worse", "auc_different_similar")  # 1/2 without information


def measures_by_rank(rows: Sequence[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Return each measure's row over all datasets, or on the last one, by its name, the best predictor first.

    The order is that of the rank correlation, in the direction that should be better.
    """
    last = {row["measure"]: row for row in rows}
    return dict(sorted(last.items(), key=lambda measure: -(directed(measure[1], "spearman") or 0.0)))


def directed(row: Mapping[str, Any], name: str) -> float | None:
    """Return a correlation of a row, positive where the measure predicts as it should; without a stated direction that
    of the rank correlation is taken to be right.
    """
    value: float | None = row[name]
    falls = row["better"] == "lower" if row["better"] else (row["spearman"] or 0.0) < 0
    return -value if falls and value is not None else value


@dataclass(frozen=True)
class Reached:
    """A correlation or a share, and what every order of the conditions reaches.

    Parameters
    ----------
    observed : value that is reported
    by_order : float64 (P,), the observed order first
    is_searched : are the orders' values searched less closely than the observed one, so much that tests must compare
        like with like?
    """

    observed: float
    by_order: Array
    is_searched: bool = False


def prediction_rows(
    score_sets: Mapping[str, ScoreSet], measures: Measures, better: Mapping[str, str], rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Compare every measure with the scores, on each dataset and over all.

    Scores of different datasets have no common zero, so over all datasets both sides are taken relative to their
    dataset's mean.

    Parameters
    ----------
    score_sets : dataset -> scores; datasets and items without a value of the measure are left out, and counted
    measures : measure -> dataset -> item -> value
    better : measure -> `higher` or `lower`, where it is known
    rng : Generator, for orders of more than six conditions

    Returns
    -------
    list of dict; docs/analysis.md names the columns. Correlations, areas and `pairs_correct` have a p-value `…_p` and a
    95 % interval `…_low`, `…_high` from permuting conditions. A measure of which less is better has negative
    correlations. Pairs count as correct in the direction of `better`; without one in that of the rank correlation, so
    that a measure without information gets more than one half.
    """
    rows = []
    cached: dict[bytes, Indices] = {}
    n_items = {name: len(score_set.items) for name, score_set in score_sets.items()}
    for measure, values in measures.items():
        parts = {name: matched({name: score_set}, values) for name, score_set in score_sets.items()}
        kept = {name: score_sets[name] for name, part in parts.items() if len(part)}
        comparisons = {name: (parts[name], n_items[name]) for name in kept}
        if len(kept) > 1:
            comparisons[ALL] = matched(kept, values), sum(n_items.values())
        for name, (points, n_there) in comparisons.items():
            head = {"measure": measure, "dataset": name, "n_missing": n_there - len(points)}
            if points.key not in cached:
                cached[points.key] = condition_orders(points, rng)
            rows.append(head | describe(points, cached[points.key], better.get(measure)))
    return rows


def describe(points: Points, orders: Indices, better: str | None) -> dict[str, Any]:
    """Return how well a measure predicts the scores of some points; None where there are too few or all are alike.

    Parameters
    ----------
    points : N points
    orders : intp (P, N), of `condition_orders`
    better : `higher` or `lower` where it is known
    """
    values, scores = points.relative_values, points.relative_scores
    can_tell = len(points) >= FEWEST_POINTS and np.ptp(values) > 0 and np.ptp(scores) > 0
    ranks = spearmans(values, scores, orders) if can_tell else np.zeros(1)
    signs = np.full(len(ranks), SIGNS[better]) if better else np.sign(ranks)
    reached: dict[str, Reached] = {}
    curve: dict[str, Any] = dict.fromkeys((*CURVE, *CURVE_WITH_LINE))
    if can_tell:
        reached, curve = _correlations(points, orders, ranks)
        reached |= _shares(points, orders, signs)
    return {
        "n": len(points),
        "n_conditions": points.n_conditions,
        "p_smallest": 1 / len(orders),
        "better": better,
        "direction_from": "measure" if better else "rank correlation",
        "pairs_different": len(points.different),
        "pairs_similar": len(points.similar),
        **{name: value for key in CORRELATIONS for name, value in _judged(key, reached.get(key), points).items()},
        **{name: value for key in SHARES for name, value in _judged_share(key, reached.get(key), points).items()},
        **curve,
    }


CURVE = (
    *("logistic_bottom", "logistic_top", "logistic_middle", "logistic_width", "logistic_status"),
    *("rmse", "rmse_epsilon", "outlier_ratio"),
)
COEFFICIENTS = ("b1", "b2", "b3", "b4", "b5")
CURVE_WITH_LINE = (*(f"logistic5_{name}" for name in COEFFICIENTS), "logistic5_status", "rmse_logistic5")


def _correlations(points: Points, orders: Indices, ranks: Array) -> tuple[dict[str, Reached], dict[str, Any]]:
    """Return all correlations, and the logistic curve with its errors."""
    values, scores = points.relative_values, points.relative_scores
    by_order = scores[orders]
    everywhere = {
        "pearson": pearsons(values, by_order),
        "pearson_monotone": monotones(values, by_order, np.where(ranks >= 0, 1.0, -1.0)),
        "spearman": ranks,
        "kendall": kendalls(values, scores, orders),
    }
    reached = {name: Reached(float(part[0]), part) for name, part in everywhere.items()}
    if len(points) <= PARAMETERS:
        nothing = dict.fromkeys((*CURVE, *CURVE_WITH_LINE))
        return reached, nothing | dict.fromkeys(("logistic_status", "logistic5_status"), "too few points")
    fit = fit_logistic(values, scores)
    reached["pearson_logistic"] = Reached(fit.correlation, grid_correlations(values, by_order))
    curve = {
        "logistic_bottom": fit.bottom,
        "logistic_top": fit.top,
        "logistic_middle": fit.middle,
        "logistic_width": fit.width,
        "logistic_status": fit.status,
    }
    curve |= _errors(scores - fit(values), points.half_widths)
    if len(points) <= PARAMETERS_WITH_LINE:
        return reached, curve | dict.fromkeys(CURVE_WITH_LINE) | {"logistic5_status": "too few points"}
    with_line = fit_logistic_with_line(values, scores)
    by_curve = grid_correlations(values, by_order, with_line=True)
    reached["pearson_logistic5"] = Reached(with_line.correlation, by_curve, is_searched=True)
    residuals = scores - with_line(values)
    return reached, curve | {
        **{f"logistic5_{name}": getattr(with_line, name) for name in COEFFICIENTS},
        "logistic5_status": with_line.status,
        "rmse_logistic5": float(np.sqrt(residuals @ residuals / (len(residuals) - PARAMETERS_WITH_LINE))),
    }


def _errors(residuals: Array, half_widths: Array) -> dict[str, float | None]:
    """Return the errors after the fit, in the scores' unit, and the share of points outside their score's interval.

    Source
    ------
    ITU-T P.1401 (2020): root mean square error, its epsilon-insensitive form, and the outlier ratio.
    """
    freedom = len(residuals) - PARAMETERS
    has_intervals = not np.isnan(half_widths).any()
    beyond = np.maximum(0.0, np.abs(residuals) - half_widths)
    return {
        "rmse": float(np.sqrt(residuals @ residuals / freedom)),
        "rmse_epsilon": float(np.sqrt(beyond @ beyond / freedom)) if has_intervals else None,
        "outlier_ratio": float(np.mean(beyond > 0)) if has_intervals else None,
    }


def _shares(points: Points, orders: Indices, signs: Array) -> dict[str, Reached]:
    """Return the shares of pairs in order and the areas; those that need a direction only where there is one."""
    # Scores in an order stand beside the values as values in the inverse order beside the scores.
    values = np.empty(orders.shape)
    np.put_along_axis(values, orders, points.values[None], axis=1)
    apart = pair_differences(values, points.different)
    result = {}
    if len(points.different) and signs[0]:
        directed = signs[:, None] * apart
        result["pairs_correct"] = share_in_order(directed)
        result["auc_better_worse"] = better_worse(directed)
    if len(points.different) and len(points.similar):
        result["auc_different_similar"] = different_similar(apart, pair_differences(values, points.similar))
    return {name: Reached(float(share[0]), share) for name, share in result.items()}


def _judged(name: str, reached: Reached | None, points: Points) -> dict[str, float | None]:
    """Return a correlation with its interval and p-value."""
    if reached is None:
        return {name: None, f"{name}_low": None, f"{name}_high": None, f"{name}_p": None}
    tested = float(reached.by_order[0]) if reached.is_searched else reached.observed
    low, high, p_value = chance(reached.by_order, tested, points.n_conditions)
    return {name: reached.observed, f"{name}_low": low, f"{name}_high": high, f"{name}_p": p_value}


def _judged_share(name: str, reached: Reached | None, points: Points) -> dict[str, float | None]:
    """Return a share with its interval and p-value; 2 x share - 1 is treated as a correlation (Somers' D)."""
    twice = reached and Reached(2 * reached.observed - 1, 2 * reached.by_order - 1)
    row = _judged(name, twice, points)
    return {key: value if value is None or key.endswith("_p") else (value + 1) / 2 for key, value in row.items()}

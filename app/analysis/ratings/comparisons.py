"""Analyse comparison category ratings (CCR): the mean of every pair, and a score for every item."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, critical_value
from app.analysis.ratings.opinion_scores import ALIKE, limits, mean_with_interval
from app.analysis.ratings.table import ComparisonTable
from app.analysis.reading.phrases import listed
from app.analysis.reading.votes_table import ALL
from app.analysis.warnings import no_interval

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

RANK_TOLERANCE = 1e-10  # relative eigenvalues below it are rounding errors of 0
NOT_BOTH = "the orders cannot tell an order effect from the scores, as no pair was shown in both orders"
MOST_AT_THE_END = 0.5  # share of ratings; above, the scale cuts off what an order adds


def analyse_comparisons(table: ComparisonTable) -> dict[str, list[dict[str, Any]]]:
    """Analyse comparison category ratings: means of pairs, scores of items, and the effect of the order.

    Parameters
    ----------
    table : ComparisonTable

    Returns
    -------
    dict, the rows of each table by its name: `comparison_pairs`, `comparison_items` (of each dataset and, with several,
    of `all`), `comparison_models` and `rating_warnings`; only lists, dictionaries, text, numbers and None

    Source
    ------
    ITU-T P.910 and BT.500, comparison category rating (double-stimulus comparison scale); the scale is the linear model
    of Scheffe (1952), "An Analysis of Variance for Paired Comparisons", with a common effect of the order.
    """
    names = list(dict.fromkeys(dataset for dataset, _ in table.items))
    dataset = np.array([names.index(name) for name, _ in table.items])[table.item_a]
    conditions = list(dict.fromkeys(condition for _, condition in table.items))
    condition = np.array([conditions.index(name) for _, name in table.items], np.intp)
    pairs: list[dict[str, Any]] = []
    scores: list[dict[str, Any]] = []
    models: list[dict[str, Any]] = []
    for number, name in enumerate(names):
        rows = np.flatnonzero(dataset == number)
        if len(rows):
            part = _Part.of(table, rows, condition)
            fit = _fit(part)
            pairs += _pair_rows(name, conditions, part, fit)
            scores += _score_rows(name, conditions, part, fit)
            models.append(_model_row(name, part, fit))
    if len(models) > 1:
        part = _Part.of(table, np.arange(len(table)), condition)
        fit = _fit(part)
        scores += _score_rows(ALL, conditions, part, fit)
        models.append(_model_row(ALL, part, fit))
    return {
        "comparison_pairs": pairs,
        "comparison_items": scores,
        "comparison_models": models,
        "rating_warnings": [{"warning": text} for text in _warnings(models, scores)],
    }


@dataclass(frozen=True)
class _Part:
    """Comparisons between conditions, numbered without gaps.

    Parameters
    ----------
    conditions : intp (K,), index of each condition's name
    a, b : intp (N,), the conditions compared
    person : intp (N,)
    rating : float64 (N,), above 0 where b is better
    order : float64 (N,), 1 where b was shown second, -1 where it was shown first
    high : end of the scale
    has_order : is the order recorded?
    """

    conditions: Indices
    a: Indices
    b: Indices
    person: Indices
    rating: Array
    order: Array
    high: float
    has_order: bool

    @classmethod
    def of(cls, table: ComparisonTable, rows: Indices, condition: Indices) -> _Part:
        """Take some rows of a table whose items have these conditions, (I,)."""
        ends = condition[np.stack([table.item_a[rows], table.item_b[rows]])]
        conditions, number = np.unique(ends, return_inverse=True)
        _, person = np.unique(table.person[rows], return_inverse=True)
        a, b = number.reshape(2, -1)
        order = np.where(table.a_first[rows], 1.0, -1.0)
        return cls(conditions, a, b, person, table.rating[rows], order, table.high, table.has_order)


@dataclass(frozen=True)
class _Fit:
    """Least squares estimates: scores (K,) with mean 0 in each connected group, their covariance, the order effect.

    `least_se` (K,) are the scores' errors if ratings did not depend on each other, where participants are so few that
    clustered errors are too small by chance; else 0. `order_influence` (J,) is what each participant adds to the order
    effect; its square sums to the variance. `no_order` says why there is no order effect.
    """

    score: Array
    covariance: Array | None
    least_se: Array
    order_effect: float | None
    order_se: float | None
    order_influence: Array
    n_participants: int
    n_groups: int
    no_order: str | None


def _fit(part: _Part) -> _Fit:
    """Fit rating = score of b - score of a + order effect, with errors clustered by participant.

    The order effect is what being shown second adds; it is left out where `_why_no_order_effect` says so.
    """
    n, n_items = len(part.rating), len(part.conditions)
    rows = np.arange(n)
    design = np.zeros((n, n_items + 1))
    design[rows, part.a] -= 1
    design[rows, part.b] += 1
    design[:, n_items] = part.order
    squares = design.T @ design
    graph = coo_array((np.ones(n), (part.a, part.b)), shape=(n_items, n_items))
    n_groups = int(connected_components(graph, directed=False)[1].max()) + 1
    n_free = n_items - n_groups
    no_order = _why_no_order_effect(part)
    has_order = no_order is None
    if not has_order:
        design[:, n_items] = 0
        squares = design.T @ design
    inverse = np.linalg.pinv(squares, rcond=RANK_TOLERANCE, hermitian=True)
    estimate = inverse @ (design.T @ part.rating)
    residue = part.rating - design @ estimate
    n_participants = int(part.person.max()) + 1
    by_person = np.zeros((n_participants, n_items + 1))
    np.add.at(by_person, part.person, design * residue[:, None])
    spread = by_person @ inverse * np.sqrt(n_participants / max(n_participants - 1, 1))
    covariance = spread.T @ spread if n_participants > 1 else None
    variance = 0.0
    if n > n_free + has_order and n_participants < max(FEWEST_PARTICIPANTS, n_free + has_order + 1):
        variance = float(residue @ residue) / (n - n_free - has_order)
    return _Fit(
        score=estimate[:n_items],
        covariance=None if covariance is None else covariance[:n_items, :n_items],
        least_se=np.sqrt(variance * np.diag(inverse)[:n_items]),
        order_effect=float(estimate[n_items]) if has_order else None,
        order_se=None if covariance is None or not has_order else float(np.sqrt(covariance[n_items, n_items])),
        order_influence=spread[:, n_items],
        n_participants=n_participants,
        n_groups=n_groups,
        no_order=no_order,
    )


def _why_no_order_effect(part: _Part) -> str | None:
    """Return why these ratings cannot tell an order effect from the scores, or from the end of the scale; else None.

    It needs pairs that were shown both ways: where none was, sums of differences that the scale cuts off look like an
    effect of the order.
    """
    if not part.has_order:
        return "the order in which the two were shown is not recorded (first_shown)"
    low, high = np.minimum(part.a, part.b), np.maximum(part.a, part.b)
    pair = low * len(part.conditions) + high
    low_first = (part.order > 0) == (part.a == low)
    is_both = np.isin(pair, np.intersect1d(pair[low_first], pair[~low_first]))
    if not is_both.any():
        return NOT_BOTH
    at_the_end = np.abs(part.rating) == part.high
    if max(at_the_end.mean(), at_the_end[is_both].mean()) > MOST_AT_THE_END:
        return "most ratings lie at the ends of the scale, from which an order effect cannot be told"
    return None


def _pair_rows(dataset: str, conditions: list[str], part: _Part, fit: _Fit) -> Iterator[dict[str, Any]]:
    """Yield each pair's mean, the order effect taken off; the first of the two names is the first to appear.

    Where a pair was shown in one order more often, the error of the order effect is a part of the mean's.
    """
    low, high = np.minimum(part.a, part.b), np.maximum(part.a, part.b)
    sign = np.where(part.a == low, 1.0, -1.0)
    corrected = sign * (part.rating - (fit.order_effect or 0.0) * part.order)
    for key in np.unique(low * len(part.conditions) + high):
        first, second = divmod(int(key), len(part.conditions))
        rows = (low == first) & (high == second)
        times, *sums = (
            np.bincount(part.person[rows], weight, fit.n_participants)
            for weight in (None, corrected[rows], sign[rows] * part.order[rows])
        )
        there = times > 0
        means, surplus = (total[there] / times[there] for total in sums)
        scores = mean_with_interval(means)
        if (n := len(means)) > 1:
            influence = -fit.order_influence * surplus.mean()
            influence[there] += (means - means.mean()) / np.sqrt(n * (n - 1))
            scores |= limits(scores["mean"], critical_value(n), float(np.linalg.norm(influence)))
        yield {
            "dataset": dataset,
            "item_a": conditions[part.conditions[first]],
            "item_b": conditions[part.conditions[second]],
            "n_ratings": int(rows.sum()),
            "n_a_first": int((part.order[rows] == sign[rows]).sum()) if part.has_order else None,
            "n": scores["n"],
            "cmos": scores["mean"],
            "sd": scores["sd"],
            "ci_low": scores["ci_low"],
            "ci_high": scores["ci_high"],
        }


def _score_rows(dataset: str, conditions: list[str], part: _Part, fit: _Fit) -> Iterator[dict[str, Any]]:
    """Yield each item's score; none if pairs do not link all items.

    With few participants, an interval is at least as wide as if ratings did not depend on each other.
    """
    if fit.n_groups > 1:
        return
    n_ratings = np.bincount(np.r_[part.a, part.b])
    factor = critical_value(max(fit.n_participants, 2))
    for number, name in enumerate(part.conditions):
        score = float(fit.score[number])
        row = {"dataset": dataset, "condition": conditions[name], "n_ratings": int(n_ratings[number]), "score": score}
        row |= dict.fromkeys(("se", "ci_low", "ci_high"))
        if fit.covariance is not None:
            error = float(np.sqrt(fit.covariance[number, number]))
            row["se"] = error if error > ALIKE else None
            row |= limits(score, factor, error, critical_value(None) * float(fit.least_se[number]))
        yield row


def _model_row(dataset: str, part: _Part, fit: _Fit) -> dict[str, Any]:
    second, first = ((part.rating * part.order * side > 0).sum() for side in (1, -1))
    return {
        "dataset": dataset,
        "low": -part.high,
        "high": part.high,
        "n_ratings": len(part.rating),
        "n_participants": fit.n_participants,
        "order_effect": fit.order_effect,
        "order_se": None if fit.order_se is None or fit.order_se <= ALIKE else fit.order_se,
        "order_left_out": fit.no_order,
        "n_second_better": int(second) if part.has_order else None,
        "n_first_better": int(first) if part.has_order else None,
        "status": "ok" if fit.n_groups == 1 else "disconnected",
    }


def _warnings(models: Sequence[dict[str, Any]], scores: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield what is to know of the fits, each sentence once."""
    datasets: dict[str, list[str]] = {}
    for row in models:
        agreed = [each["condition"] for each in scores if each["dataset"] == row["dataset"] and each["se"] is None]
        for text in (*_about(row), *no_interval(agreed if row["n_participants"] > 1 else ())):
            datasets.setdefault(text, []).append(row["dataset"])
    for text, names in datasets.items():
        single = [name for name in names if name not in (ALL, "")]
        where = f", dataset{'s' if len(single) > 1 else ''} {listed(single)}" if single else ""
        yield f"comparisons{where}{', all datasets together' if ALL in names else ''}: {text}"


def _about(row: dict[str, Any]) -> Iterator[str]:
    if row["status"] != "ok":
        yield "no pair links some conditions to the others, so there are no scores"
    if row["order_left_out"] is not None:
        advice = "; show each pair in both orders" if row["order_left_out"] == NOT_BOTH else ""
        yield f"{row['order_left_out']}, so no order effect is taken off, and means are plain{advice}"

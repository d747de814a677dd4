"""Average ratings: mean opinion scores of items and conditions, and differential scores to the reference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import critical_value, or_none
from app.analysis.ratings.table import RatingTable

Array = NDArray[np.float64]

ALIKE = 1e-9  # grades; a smaller error is rounding


def person_means(table: RatingTable) -> Array:
    """Return each participant's mean rating of each item, so that repeated ratings count as one opinion.

    Parameters
    ----------
    table : RatingTable of N ratings

    Returns
    -------
    float64 (P, I), NaN where a participant did not rate an item
    """
    shape = (len(table.participants), len(table.items))
    cell = np.ravel_multi_index((table.person, table.item), shape)
    times = np.bincount(cell, minlength=shape[0] * shape[1])
    totals = np.bincount(cell, table.rating, minlength=len(times))
    return np.where(times > 0, totals / np.maximum(times, 1), np.nan).reshape(shape)


def differential_scores(table: RatingTable) -> Array:
    """Return each participant's rating of each item relative to the same participant's rating of the reference.

    With a hidden reference: rating - rating of the dataset's reference + high end of the scale, which on the scale from
    1 to 5 is the + 5 of the Recommendation. Values above the high end (better than the reference) stay as they are.
    With degradation category rating, the rating itself.

    Returns
    -------
    float64 (P, I), NaN where a participant did not rate the item or its reference, and for the references themselves

    Source
    ------
    ITU-T P.910, ACR with hidden reference: DV(PVS) = V(PVS) - V(REF) + 5.
    """
    means = person_means(table)
    if table.protocol == "dcr":
        return means
    reference = {table.items[column][0]: means[:, column] for column in np.flatnonzero(table.is_reference)}
    missing = np.full(len(table.participants), np.nan)
    columns = [
        missing if is_reference else means[:, column] - reference.get(dataset, missing) + table.high
        for column, ((dataset, _), is_reference) in enumerate(zip(table.items, table.is_reference, strict=True))
    ]
    return np.stack(columns, axis=1)


def mean_with_interval(values: Array) -> dict[str, Any]:
    """Return the mean of items with its 95 % interval over participants; each item counts alike.

    For a single item, and wherever everybody rated every item, it is mean +- t(n - 1) sd / sqrt(n) of the participants'
    means. Where ratings are missing, the mean of the items' means has the variance sum(u^2), where u is a participant's
    part in it: the average over items of (value - item's mean) / sqrt(k (k - 1)) for k values of the item. One value
    says nothing about its item's spread; its distance from the mean of all items stands in, times sqrt(n / (n - 1)),
    which is too large rather than too small (in surveys: strata with a single unit). Few values of an item tell little
    about its spread, however many people rated others: `freedom` of t is n - 1 only where everybody rated everything.

    Parameters
    ----------
    values : float64 (P,) for an item or (P, M) for M items, NaN where missing

    Returns
    -------
    dict, `n` (participants), `mean`, `se`, `sd` (of the participants' means; denominator n - 1), `freedom`, `ci_low`,
    `ci_high`; None where too few values define it; no limits where all agree exactly, which says nothing of others
    """
    values = values[:, None] if values.ndim == 1 else values
    values = values[:, ~np.isnan(values).all(axis=0)]
    values = values[~np.isnan(values).all(axis=1)]
    n = len(values)
    row: dict[str, Any] = {"n": n} | dict.fromkeys(("mean", "se", "sd", "freedom", "ci_low", "ci_high"))
    if n == 0:
        return row
    if n == 1:
        return row | {"mean": float(values.mean())}
    mean, error, freedom = (float(part[0]) for part in means_with_errors(values[None]))
    parts = np.nanmean(values, axis=1)
    row |= {"mean": mean, "se": error, "sd": float(parts.std(ddof=1)), "freedom": freedom}
    return row | limits(mean, critical_value(1 + freedom), error)


def limits(value: float, factor: float, error: float, least: float = 0.0) -> dict[str, float | None]:
    """Return the 95 % interval of a value of ratings, `factor` errors or `least` to each side; None without an error.

    Parameters
    ----------
    value, error, least : in the unit of the ratings
    factor : from the degrees of freedom
    """
    half = np.nan if error <= ALIKE else max(factor * error, least)
    return dict(zip(("ci_low", "ci_high"), or_none(np.array([value - half, value + half])), strict=True))


def means_with_errors(values: Array) -> tuple[Array, Array, Array]:
    """Return means of items with their standard errors and degrees of freedom, as `mean_with_interval` defines them.

    Parameters
    ----------
    values : float64 (R, P, M), of R tables, NaN where missing

    Returns
    -------
    three float64 (R,); without values of two participants the last is 0 or less, and the others mean nothing
    """
    there = ~np.isnan(values)
    known, rated = np.where(there, values, 0.0), there.astype(np.float64)
    times, n = rated.sum(axis=1), there.any(axis=2).sum(axis=1)
    n_items = np.maximum((times > 0).sum(axis=1), 1)
    item_means = known.sum(axis=1) / np.maximum(times, 1)
    mean = item_means.sum(axis=1) / n_items
    is_single = times == 1
    centre, size = np.where(is_single, mean[:, None], item_means), np.where(is_single, n[:, None], times)
    scale = np.sqrt(size / np.maximum(size - 1, 1)) / np.maximum(times, 1)
    influence = ((known - centre[:, None]) * rated * scale[:, None]).sum(axis=2) / n_items[:, None]
    return mean, np.sqrt((influence**2).sum(axis=1)), _freedom(rated)


def _freedom(rated: Array) -> Array:
    """Return the degrees of freedom of the variance of means of items, of which some ratings are missing, float64 (R,).

    The variance is a sum of squares of the participants' parts. If ratings did not depend on each other, these would
    have a covariance G, and the sum as many degrees of freedom as a chi-square of the same mean and variance has.

    Parameters
    ----------
    rated : float64 (R, P, M), 1 where the participant rated the item, else 0

    Source
    ------
    Satterthwaite (1946): (trace of G)^2 / (sum of the squares of G).
    """
    times = rated.sum(axis=1)
    is_single = times == 1
    weight = np.where(is_single, 1.0, 1 / np.maximum(times * (times - 1), 1)) * (times > 0)
    together = np.where(is_single, 0.0, weight / np.maximum(times, 1))
    alone, shared = (np.einsum("rpm,rm->rp", rated, part) for part in (weight, together))
    both = np.swapaxes(rated, 1, 2) @ rated  # G = diag(alone) - sum of together r r'
    trace = alone.sum(axis=1) - (together * times).sum(axis=1)
    squares = (alone * (alone - 2 * shared)).sum(axis=1) + np.einsum("rm,rmn,rn->r", together, both**2, together)
    freedom = trace**2 / np.where(squares > 0, squares, 1.0)
    return np.asarray(np.minimum(rated.any(axis=2).sum(axis=1) - 1.0, freedom))


def item_rows(table: RatingTable) -> Iterator[dict[str, Any]]:
    """Yield each item's mean opinion score, and its differential score where there is a reference."""
    means, differences = person_means(table), differential_scores(table)
    times = np.bincount(table.item, minlength=len(table.items))
    for column, (dataset, condition) in enumerate(table.items):
        place = {"dataset": dataset, "condition": condition, "is_reference": bool(table.is_reference[column])}
        yield place | {"n_ratings": int(times[column])} | _scores(means[:, column], differences[:, column])


def condition_rows(table: RatingTable) -> Iterator[dict[str, Any]]:
    """Yield each condition's mean opinion score over all datasets, each of which counts alike."""
    means, differences = person_means(table), differential_scores(table)
    for condition, columns in columns_by_condition(table).items():
        place = {
            "condition": condition,
            "n_datasets": len(columns),
            "n_ratings": int(np.isin(table.item, columns).sum()),
        }
        yield place | _scores(means[:, columns], differences[:, columns])


def columns_by_condition(table: RatingTable) -> dict[str, list[int]]:
    """Return the indices of each condition's items that somebody rated."""
    rated = set(table.item.tolist())
    columns: dict[str, list[int]] = {}
    for column, (_, condition) in enumerate(table.items):
        if column in rated:
            columns.setdefault(condition, []).append(column)
    return columns


def _scores(values: Array, differences: Array) -> dict[str, Any]:
    opinion, differential = mean_with_interval(values), mean_with_interval(differences)
    return {
        "n": opinion["n"],
        "mos": opinion["mean"],
        "sd": opinion["sd"],
        "ci_low": opinion["ci_low"],
        "ci_high": opinion["ci_high"],
        "dmos": differential["mean"],
        "dmos_sd": differential["sd"],
        "dmos_low": differential["ci_low"],
        "dmos_high": differential["ci_high"],
    }

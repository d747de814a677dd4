"""Average ratings: mean opinion scores of items and conditions, and differential scores to the reference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from app.analysis.ratings.table import RatingTable
from app.analysis.settings import LEVEL

Array = NDArray[np.float64]


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


def mean_with_interval(values: Array) -> dict[str, Any]:
    """Return the mean of one value per participant, its standard deviation and 95 % interval.

    The interval is mean +- t(n - 1) sd / sqrt(n), with the deviation's denominator n - 1.

    Parameters
    ----------
    values : float64 (n,), NaN where missing

    Returns
    -------
    dict, `n`, `mean`, `sd`, `ci_low`, `ci_high`; None where too few values define it
    """
    there = values[~np.isnan(values)]
    n = len(there)
    row: dict[str, Any] = {"n": n, "mean": float(there.mean()) if n else None}
    if n < 2:
        return row | {"sd": None, "ci_low": None, "ci_high": None}
    sd = float(there.std(ddof=1))
    half = float(student.ppf((1 + LEVEL) / 2, n - 1)) * sd / np.sqrt(n)
    return row | {"sd": sd, "ci_low": row["mean"] - half, "ci_high": row["mean"] + half}


def item_rows(table: RatingTable) -> Iterator[dict[str, Any]]:
    """Yield the mean opinion score of every item."""
    means = person_means(table)
    for column, (dataset, condition) in enumerate(table.items):
        place = {"dataset": dataset, "condition": condition, "is_reference": bool(table.is_reference[column])}
        yield place | mean_with_interval(means[:, column])

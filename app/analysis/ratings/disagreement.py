"""Test whether people who rate disagree more than their own noise explains, and whether they fall into two camps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import SIGNIFICANT, Contrast
from app.analysis.ratings.contrasts import rating_contrasts
from app.analysis.ratings.opinion_scores import columns_by_condition, person_means
from app.analysis.ratings.table import RatingTable
from app.analysis.screening.disagreement import CAMPS, find_camps

Array = NDArray[np.float64]

PERMUTED = 199  # times somebody's residuals change places
MOST_VALUES = 200_000  # participants times items
FEWEST_PEOPLE = 3
CENTRED = 20  # rounds that take off means of items and people in turn, where ratings are missing


def rating_disagreement(table: RatingTable) -> dict[str, Any] | None:
    """Test whether people disagree on conditions more than their own noise explains, and find two camps.

    Means of items and of people are taken off. If the rest were noise, it would not matter on which film somebody left
    which of it: within a person it changes places. The statistic is the sum over people and conditions of the squared
    sum over datasets, which grows if somebody likes a condition everywhere.

    Returns
    -------
    dict, `ratio` (of the statistic to its mean by chance), `p_value` and `camps` (as from `find_camps`, with
    `differences`: how much higher each camp rates `item_first` than `item_second`) or None; None with fewer than three
    participants, or where nobody rated a condition on two datasets: then an opinion looks like noise
    """
    means, by_condition = person_means(table), columns_by_condition(table)
    kept = np.array(sorted(column for columns in by_condition.values() for column in columns), np.intp)
    is_there = (~np.isnan(means)).any(axis=1)
    residuals = _centred(means[is_there][:, kept])
    place = {column: number for number, column in enumerate(kept.tolist())}
    belongs = np.zeros((len(kept), len(by_condition)))
    for number, columns in enumerate(by_condition.values()):
        belongs[[place[column] for column in columns], number] = 1.0
    n_rated = (~np.isnan(residuals)).astype(float) @ belongs
    if (
        len(residuals) < FEWEST_PEOPLE
        or not residuals.size
        or residuals.size > MOST_VALUES
        or n_rated.max() < 2
        or len(by_condition) < 2
    ):
        return None
    rng = np.random.default_rng(len(table))
    known = np.nan_to_num(residuals) @ belongs
    statistic = float(np.sum(known**2))
    by_chance = np.array([np.sum((_moved(residuals, rng) @ belongs) ** 2) for _ in range(PERMUTED)])
    if not by_chance.any():
        return None
    p_value = float((1 + np.count_nonzero(by_chance >= statistic - 1e-9)) / (PERMUTED + 1))
    names = [table.participants[index] for index in np.flatnonzero(is_there)]
    camps = None
    if p_value < SIGNIFICANT:
        opinions = known / np.maximum(n_rated, 1)
        camps = find_camps(opinions, names, tuple(by_condition), rng)
        camps = camps and _with_differences(camps, table)
    return {"ratio": statistic / float(by_chance.mean()), "p_value": p_value, "camps": camps}


def _centred(values: Array) -> Array:
    """Take the means of items and of people off, float64 (P, I), NaN where missing."""
    rated = ~np.isnan(values)
    rest = np.where(rated, values, 0.0)
    for _ in range(CENTRED):
        for axis in (0, 1):
            n = np.maximum(rated.sum(axis=axis, keepdims=True), 1)
            rest = np.where(rated, rest - rest.sum(axis=axis, keepdims=True) / n, 0.0)
    return np.where(rated, rest, np.nan)


def _moved(residuals: Array, rng: np.random.Generator) -> Array:
    """Let each person's values change places among what the person rated; 0 where nothing was."""
    rated = ~np.isnan(residuals)
    order = np.argsort(np.where(rated, rng.random(rated.shape), 2.0), axis=1)
    moved = np.zeros_like(residuals)
    moved[rated] = np.take_along_axis(residuals, order, axis=1)[np.sort(~rated, axis=1) == 0]
    return moved


def _with_differences(camps: dict[str, Any], table: RatingTable) -> dict[str, Any] | None:
    """Add how each camp rates what the camps differ in most; None if a camp prefers nothing: who clicks is no camp."""
    differences = []
    for other in camps["participants"][::-1]:
        contrasts = rating_contrasts(table.without(other))
        if not any(row.p_holm < CAMPS for row in contrasts):
            return None
        differences.append(_difference(contrasts, camps["item_first"], camps["item_second"]))
    return camps | {"differences": differences}


def _difference(contrasts: Sequence[Contrast], first: str, second: str) -> float | None:
    for row in contrasts:
        if {row.item_a, row.item_b} == {first, second}:
            return float(row.difference if row.item_a == first else -row.difference)
    return None

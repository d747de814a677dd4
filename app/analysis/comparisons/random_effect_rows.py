"""Turn fits with random effects into the rows of analysis.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from app.analysis.comparisons.comparison import Comparison
from app.analysis.model.contrasts import MOST_ITEMS, holm
from app.analysis.model.random_effects import (
    PARTICIPANTS,
    Posterior,
    fit_random_effects,
    mixture_interval,
    opposite_sign,
)
from app.analysis.reading.votes_table import ALL

Array = NDArray[np.float64]

TABLES = ("random_effects", "random_effects_scores", "random_effects_contrasts")


def random_effect_tables(
    compared: Sequence[Comparison], random_effects: str
) -> tuple[dict[str, list[dict[str, Any]]], list[str]]:
    """Fit all items on all datasets together with random effects.

    Parameters
    ----------
    compared : the fits without random effects
    random_effects : as in `AnalysisSettings`

    Returns
    -------
    The tables `TABLES`, and in a sentence why they are empty although random effects were asked for.
    """
    tables: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}
    pooled = [row for row in compared if (row.comparison, row.dataset) == (ALL, ALL)]
    if not random_effects or not pooled:
        return tables, []
    posterior = fit_random_effects(pooled[0].fit, pooled[0].votes, random_effects.split(","))
    if isinstance(posterior, str):
        return tables, [f"there is no fit with random effects: {posterior}"]
    for name, rows in zip(TABLES, (_spread_rows, _score_rows, _contrast_rows), strict=True):
        tables[name] = list(rows(posterior))
    return tables, []


def _spread_rows(posterior: Posterior) -> Iterator[dict[str, Any]]:
    """Return how much each level varies: a standard deviation in log-odds with its 95 % interval."""
    for level in posterior.levels:
        median, low, high = posterior.spread(level)
        yield {"level": level, "sd": median, "sd_low": low, "sd_high": high}


def _score_rows(posterior: Posterior) -> Iterator[dict[str, Any]]:
    n = len(posterior.items)
    means, sds = posterior.along(np.eye(n))
    for item, *numbers in zip(posterior.items, *_summary(posterior, means, sds), strict=True):
        yield {"item": item} | dict(zip(("score", "se", "ci_low", "ci_high"), numbers, strict=True))


def _contrast_rows(posterior: Posterior) -> Iterator[dict[str, Any]]:
    """Return all pairs; `people_preferring` is the share of people whose own score of the first item is higher."""
    n = len(posterior.items)
    if n > MOST_ITEMS:
        return
    first, second = np.triu_indices(n, 1)
    means, sds = posterior.along(np.eye(n)[first] - np.eye(n)[second])
    p_values = opposite_sign(posterior.weights, means, sds)
    between_people = np.sqrt(2) * posterior.spreads[:, posterior.levels.index(PARTICIPANTS), None]
    people = posterior.weights @ ndtr(means / between_people)
    names = ("difference", "se", "ci_low", "ci_high", "p_value", "p_holm", "people_preferring")
    columns = *_summary(posterior, means, sds), p_values.tolist(), holm(p_values).tolist(), people.tolist()
    for a, b, *numbers in zip(first, second, *columns, strict=True):
        pair = {"item_a": posterior.items[a], "item_b": posterior.items[b]}
        yield pair | dict(zip(names, numbers, strict=True))


def _summary(posterior: Posterior, means: Array, sds: Array) -> tuple[list[float], ...]:
    """Return mean, standard deviation and limits of the 95 % interval of each column."""
    mean = posterior.weights @ means
    sd = np.sqrt(posterior.weights @ (sds**2 + (means - mean) ** 2))
    low, high = mixture_interval(posterior.weights, means, sds)
    return mean.tolist(), sd.tolist(), low.tolist(), high.tolist()

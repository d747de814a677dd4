"""Turn fits with random effects into the rows of analysis.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from app.analysis.comparisons.comparison import Comparison
from app.analysis.model.contrasts import MOST_ITEMS, holm
from app.analysis.model.random_effects import (
    PARTICIPANTS,
    Posterior,
    fit_random_effects,
    mixture_interval,
    opposite_sign,
)
from app.analysis.model.settings import LEVEL
from app.analysis.reading.votes_table import ALL

Array = NDArray[np.float64]

HALVINGS_OF_A_SHARE = 30
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
    people_low, people_high = (
        _share_quantile(posterior.weights, means, sds, between_people, tail)
        for tail in ((1 - LEVEL) / 2, (1 + LEVEL) / 2)
    )
    names = (
        "difference",
        "se",
        "ci_low",
        "ci_high",
        "p_value",
        "p_holm",
        "people_preferring",
        "people_low",
        "people_high",
    )
    columns = (
        *_summary(posterior, means, sds),
        *(part.tolist() for part in (p_values, holm(p_values), people, people_low, people_high)),
    )
    for a, b, *numbers in zip(first, second, *columns, strict=True):
        pair = {"item_a": posterior.items[a], "item_b": posterior.items[b]}
        yield pair | dict(zip(names, numbers, strict=True))


def _share_quantile(weights: Array, means: Array, sds: Array, between: Array, tail: float) -> Array:
    """Find a quantile of the share of people with a higher score of the first item, float64 (M,), by bisection.

    Parameters
    ----------
    weights : float64 (K,), of the mixture's parts
    means, sds : float64 (K, M), of the difference of two scores
    between : float64 (K, 1), standard deviation of that difference between people
    tail : share below the quantile
    """
    low, high = np.zeros(means.shape[1]), np.ones(means.shape[1])
    for _ in range(HALVINGS_OF_A_SHARE):
        middle = (low + high) / 2
        is_below = weights @ ndtr((between * ndtri(middle) - means) / sds) < tail
        low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
    return np.asarray((low + high) / 2)


def _summary(posterior: Posterior, means: Array, sds: Array) -> tuple[list[float], ...]:
    """Return mean, standard deviation and limits of the 95 % interval of each column."""
    mean = posterior.weights @ means
    sd = np.sqrt(posterior.weights @ (sds**2 + (means - mean) ** 2))
    low, high = mixture_interval(posterior.weights, means, sds)
    return mean.tolist(), sd.tolist(), low.tolist(), high.tolist()

"""Test what makes an item good: each factor alone, all factors in an additive model, and their interaction.

A factor alone is studied on the pairs that differ in nothing else, as in the paper. The additive model uses every pair
and needs half to a third of the votes for the same precision; the interaction test tells whether it holds. Items
without a level of every factor, such as the models of another program, take no part in either.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.contrasts import (
    Contrast,
    Estimates,
    contrasts_of,
    corrected_together,
    half_widths,
    has_few_participants,
    letters,
    or_none,
)
from app.analysis.model.likelihood.fit import ALIKE, Fit
from app.analysis.reading.votes_table import ALL, VotesTable

Array = NDArray[np.float64]
Factors = Mapping[str, Mapping[str, str]]  # factor -> item -> level


def votes_with_levels(votes: VotesTable, factors: Factors) -> VotesTable:
    """Return the votes on pairs of items that have a level of every factor, with those items alone.

    Parameters
    ----------
    votes : VotesTable of the items
    factors : factor -> item -> level, all factors of the items
    """
    without = items_without_levels(votes.items, factors)
    if not without:
        return votes
    is_kept = np.array([item not in without for item in votes.items])
    return votes.where(is_kept[votes.item_a] & is_kept[votes.item_b]).with_items(is_kept)


def items_without_levels(items: tuple[str, ...], factors: Factors) -> dict[str, list[str]]:
    """Return, for each item that lacks levels, the factors that it has no level of."""
    lacking = {item: [factor for factor, levels in factors.items() if item not in levels] for item in items}
    return {item: names for item, names in lacking.items() if names}


def level_names(factors: Factors, factor: str, items: tuple[str, ...]) -> tuple[str, ...]:
    """Return the levels of a factor among these items, in order of appearance.

    Parameters
    ----------
    factors : factor -> item -> level
    factor : its name
    items : names
    """
    return tuple(dict.fromkeys(factors[factor][item] for item in items))


def votes_on_factor(votes: VotesTable, factors: Factors, factor: str) -> VotesTable:
    """Return the votes on pairs that differ in this factor and in no other; its levels become the items.

    Parameters
    ----------
    votes : VotesTable of the items
    factors : factor -> item -> level, all factors of the items
    factor : the factor to keep
    """
    codes = {name: _codes(votes, factors, name) for name in factors}
    differs = codes[factor][votes.item_a] != codes[factor][votes.item_b]
    for other in factors:
        if other != factor:
            differs &= codes[other][votes.item_a] == codes[other][votes.item_b]
    kept = votes.where(differs)
    return replace(
        kept,
        items=level_names(factors, factor, votes.items),
        item_a=codes[factor][kept.item_a],
        item_b=codes[factor][kept.item_b],
    )


def _codes(votes: VotesTable, factors: Factors, factor: str) -> NDArray[np.int32]:
    names = level_names(factors, factor, votes.items)
    return np.array([names.index(factors[factor][item]) for item in votes.items], np.int32)


@dataclass(frozen=True)
class Effect:
    """Contribution of a factor's level to the score in the additive model, log-odds; the levels of a factor sum to
    zero.

    Levels of a factor share a letter if they are not told apart, all else equal (all pairs of its levels, Holm); there
    are no letters where that is unknown. `ci_low` and `ci_high` are the limits of the 95 % interval.
    """

    dataset: str
    factor: str
    level: str
    effect: float
    se: float
    se_participant: float | None
    letters: str
    n_participants: int | None
    ci_low: float | None
    ci_high: float | None


@dataclass(frozen=True)
class ModelTest:
    """A likelihood-ratio test, and a Wald test of the same hypothesis with errors clustered by participant.

    Parameters
    ----------
    name : `factor <name>`, `interaction`, `order effect`, `datasets differ` or `group <name>`
    model : what the hypothesis is about: `items` (a score for each), `additive`, or a factor alone
    dataset : name, or `all`
    g2 : likelihood-ratio statistic
    df : its degrees of freedom
    p_value : of `g2`, with votes as the sample
    p_participant : with participants as the sample: Hotelling's, from F(df, J - df); for `datasets differ` and groups
        Rao and Scott's correction of G2; None without enough participants, or where all voted alike
    """

    name: str
    model: str
    dataset: str
    g2: float
    df: int
    p_value: float
    p_participant: float | None


def coding(factors: Factors, items: tuple[str, ...]) -> tuple[Array, list[tuple[str, tuple[str, ...]]]]:
    """Return the effect coding of items by factors.

    Returns
    -------
    levels : float64 (n, q), +1 for the level of a column, -1 for the last level of its factor, 0 else
    columns : factors and their levels; a factor with L levels has L - 1 columns, and a factor with a single level is
        left out
    """
    parts, columns = [], []
    for factor in factors:
        names = level_names(factors, factor, items)
        if len(names) > 1:
            has_level = np.array([[float(factors[factor][item] == name) for name in names] for item in items])
            parts.append(has_level[:, :-1] - has_level[:, -1:])
            columns.append((factor, names))
    return np.concatenate(parts, axis=1) if parts else np.zeros((len(items), 0)), columns


def fit_additive(votes: VotesTable, factors: Factors, *, ties: str, order_effect: bool) -> Fit | None:
    """Fit the items' scores as sums of the factors' effects; None if no factor has two levels.

    Parameters
    ----------
    votes : VotesTable of compared items
    factors : factor -> item -> level
    ties : key of `TIE_MODELS`
    order_effect : add the advantage of the item shown first
    """
    levels, columns = coding(factors, votes.items)
    return fit_scores(votes, ties=ties, order_effect=order_effect, levels=levels) if columns else None


def effects_of(fits: Mapping[str, Fit], factors: Factors) -> list[Effect]:
    """Return the effect of every level on every dataset with its standard errors.

    Parameters
    ----------
    fits : dataset -> fit of the additive model, with status `ok`; letters of single datasets are corrected over all
    factors : factor -> item -> level, as fitted
    """
    levels = {(dataset, factor): part for dataset, fit in fits.items() for factor, part in _levels_of(fit, factors)}
    contrasts = {place: contrasts_of(part) for place, part in levels.items()}
    together = corrected_together(contrasts, lambda place: place[1] if place[0] != ALL else None)
    return [
        effect
        for place, part in levels.items()
        for effect in _effects(part, place[1], place[0], _letters(part, together[place]))
    ]


def _levels_of(fit: Fit, factors: Factors) -> Iterator[tuple[str, Estimates]]:
    """Yield each factor and the effects of its levels."""
    if fit.theta is None or fit.covariance is None:
        return
    column = 0
    for factor, names in coding(factors, fit.items)[1]:
        size = len(names) - 1
        to_levels = np.zeros((len(names), len(fit.theta)))
        to_levels[:size, column : column + size] = np.eye(size)
        to_levels[size, column : column + size] = -1
        yield factor, _levels(fit, names, to_levels)
        column += size


def _effects(levels: Estimates, factor: str, dataset: str, shown: Mapping[str, str]) -> Iterator[Effect]:
    """Yield the effects of a factor's levels; `shown` has the letters of each."""
    se, clustered, half = np.sqrt(np.diag(levels.covariance)), levels.participant_covariance, half_widths(levels)
    half = np.full(len(se), np.nan) if half is None else half
    between = np.full(len(se), np.nan) if clustered is None else np.sqrt(np.maximum(np.diag(clustered), 0.0))
    columns = (
        levels.names,
        levels.values.tolist(),
        se.tolist(),
        or_none(np.where(np.isnan(half), np.nan, between)),
        [shown.get(name, "") for name in levels.names],
        [levels.n_participants] * len(levels.names),
        or_none(levels.values - half),
        or_none(levels.values + half),
    )
    for row in zip(*columns, strict=True):
        yield Effect(dataset, factor, *row)


def _levels(fit: Fit, names: tuple[str, ...], to_levels: Array) -> Estimates:
    """Return the effects of a factor's levels, which are `to_levels` times the parameters."""
    assert fit.theta is not None
    assert fit.covariance is not None
    clustered = fit.participant_covariance
    return Estimates(
        names,
        to_levels @ fit.theta,
        to_levels @ fit.covariance @ to_levels.T,
        None if clustered is None else to_levels @ clustered @ to_levels.T,
        fit.n_participants,
        has_few_participants(fit),
    )


def _letters(levels: Estimates, compared: Sequence[Contrast]) -> dict[str, str]:
    best_first = [levels.names[index] for index in np.argsort(-levels.values)]
    return letters(best_first, compared) if compared else {}


def model_tests(additive: Fit, votes: VotesTable, factors: Factors, dataset: str) -> list[ModelTest]:
    """Test each factor within the additive model, and the interaction: does the additive model explain the items'
    scores?

    Parameters
    ----------
    additive : Fit of the additive model, with status `ok`
    votes : VotesTable, the votes it was fitted to
    factors : factor -> item -> level, as fitted
    dataset : name for the result
    """
    ties, order_effect = additive.ties, additive.design.has_order
    tests, column = [], 0
    for factor, names in coding(factors, votes.items)[1]:
        size = len(names) - 1
        others = {name: levels for name, levels in factors.items() if name != factor}
        levels = coding(others, votes.items)[0]
        restricted = fit_scores(votes, ties=ties, order_effect=order_effect, levels=levels)
        picked = np.eye(additive.design.n_parameters)[column : column + size]
        tests.append(likelihood_ratio(f"factor {factor}", "additive", dataset, additive, restricted, picked))
        column += size
    items = fit_scores(votes, ties=ties, order_effect=order_effect)
    if items.status == "ok" and items.design.n_free > additive.design.n_free:
        tests.append(likelihood_ratio("interaction", "items", dataset, items, additive, beyond(items, additive)))
    return [test for test in tests if test is not None]


def beyond(items: Fit, additive: Fit) -> Array:
    """Return the directions of the items' scores, float64 (r, P), that no sum of factors' effects reaches."""
    assert additive.design.levels is not None
    n = len(items.items)
    reached = np.c_[additive.design.levels, np.ones(n)]
    rank = np.linalg.matrix_rank(reached)
    left = np.linalg.svd(reached)[0][:, rank:]
    return np.concatenate([left.T, np.zeros((left.shape[1], items.design.n_parameters - n))], axis=1)


def likelihood_ratio(
    name: str, model: str, dataset: str, full: Fit, restricted: Fit, directions: Array
) -> ModelTest | None:
    """Compare two nested fits; None unless both have a maximum.

    Parameters
    ----------
    name, model, dataset : as in `ModelTest`
    full, restricted : Fit, the restricted one nested in the full one
    directions : float64 (r, P), directions of the full fit's parameters that are zero in the restricted fit
    """
    if full.loglik is None or restricted.loglik is None or restricted.status != "ok" or full.theta is None:
        return None
    g2 = max(2 * (full.loglik - restricted.loglik), 0.0)
    df = full.design.n_free - restricted.design.n_free
    p_participant = wald_p_value(full, directions)
    return ModelTest(name, model, dataset, g2, df, float(chi2.sf(g2, df)), p_participant)


def wald_p_value(fit: Fit, directions: Array) -> float | None:
    """Return the p-value of functions of the parameters being zero, by Hotelling's T2 with participants as the sample.

    Parameters
    ----------
    fit : Fit
    directions : float64 (r, P), the functions

    Returns
    -------
    float, or None without participants, with no more of them than directions, or if they differ in too few ways
    """
    r, covariance, n_participants = len(directions), fit.participant_covariance, fit.n_participants
    if fit.theta is None or fit.covariance is None or covariance is None or n_participants is None:
        return None
    spread, of_votes = (directions @ part @ directions.T for part in (covariance, fit.covariance))
    are_alike = np.trace(spread) <= ALIKE * np.trace(of_votes)
    if n_participants <= r or are_alike or np.linalg.matrix_rank(spread, hermitian=True) < r:
        return None
    values = directions @ fit.theta
    t2 = float(values @ np.linalg.solve(spread, values))
    return float(f_distribution.sf(t2 * (n_participants - r) / (r * (n_participants - 1)), r, n_participants - r))


def order_test(fit: Fit, without: Fit, model: str, dataset: str) -> ModelTest | None:
    """Test whether being shown first matters.

    Parameters
    ----------
    fit, without : Fit with and without the order effect
    model, dataset : as in `ModelTest`
    """
    if fit.status != "ok":
        return None
    picked = np.eye(fit.design.n_parameters)[fit.design.n_effects : fit.design.n_effects + 1]
    return likelihood_ratio("order effect", model, dataset, fit, without, picked)

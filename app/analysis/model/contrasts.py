"""Find which items, or levels of a factor, differ: all pairwise contrasts, corrected by Holm's method, and letters that
group those without significant difference.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from string import ascii_letters
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from app.analysis.model.likelihood.fit import ALIKE, Fit
from app.analysis.model.settings import LEVEL

Array = NDArray[np.float64]
Place = TypeVar("Place", bound=Hashable)

MOST_ITEMS = 40  # 780 contrasts
SIGNIFICANT = 0.05
DRAWN = 4000  # vectors of scores; the limit of simultaneous intervals is exact to about 2 %
NEVER_COMPARED = "never compared"
BY_SCORES, ALL_ALIKE = "difference of scores", "all participants voted alike"  # methods of a contrast
FEWEST_PARTICIPANTS = 12  # clusters; with fewer, a clustered error is too small by chance (Cameron and Miller 2015)


@dataclass(frozen=True)
class Contrast:
    """Difference of two scores.

    Parameters
    ----------
    difference, se : log-odds; the error is clustered by participant where participants are known
    p_value, p_holm : two-sided, uncorrected and corrected for all contrasts of this fit
    ci_low, ci_high : limits of the 95 % interval of the difference, uncorrected; if only one of them is there, the
        interval is one-sided: 95 % of such limits hold
    method : what the test and the interval rest on
    """

    item_a: str
    item_b: str
    difference: float
    se: float | None
    p_value: float
    p_holm: float
    ci_low: float | None
    ci_high: float | None
    method: str = BY_SCORES


class Differences(NamedTuple):
    """Differences of scores with their errors and two-sided p-values, all float64 (K,).

    Parameters
    ----------
    half : half the width of the 95 % interval
    is_alike : bool (K,), did all participants vote alike, so that nothing is known of others?
    """

    difference: Array
    se: Array
    half: Array
    p_value: Array
    is_alike: NDArray[np.bool_]


@dataclass(frozen=True)
class Estimates:
    """What is compared in pairs: scores of items, or effects of a factor's levels, all of one fit.

    Parameters
    ----------
    names : (K,)
    values : float64 (K,), log-odds
    covariance : float64, with votes as the sample; its first K rows and columns are those of the values
    participant_covariance : the same with participants as the sample; None where it is unknown
    n_participants : None where they are unknown
    is_few : are they few, as `has_few_participants` tells?
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    participant_covariance: Array | None
    n_participants: int | None
    is_few: bool


def scores_of(fit: Fit) -> Estimates:
    """Return the scores of a fit that has them and their covariances."""
    assert fit.scores is not None
    assert fit.covariance is not None
    clustered, is_few = fit.participant_covariance, has_few_participants(fit)
    return Estimates(fit.items, fit.scores, fit.covariance, clustered, fit.n_participants, is_few)


def contrasts(fit: Fit) -> list[Contrast]:
    """Compare every pair of items; empty without a finite maximum or errors, or with too many items."""
    has_errors = fit.status == "ok" and fit.scores is not None and fit.covariance is not None
    return contrasts_of(scores_of(fit)) if has_errors else []


def contrasts_of(estimates: Estimates) -> list[Contrast]:
    """Compare every pair of estimates; empty with too many, or where errors clustered by participant are unknown."""
    n = len(estimates.names)
    has_errors = estimates.participant_covariance is not None or estimates.n_participants is None
    if n > MOST_ITEMS or not has_errors:
        return []
    first, second = np.triu_indices(n, 1)
    compared = differences(estimates, first, second)
    limits = compared.difference - compared.half, compared.difference + compared.half
    methods = np.where(compared.is_alike, ALL_ALIKE, BY_SCORES)
    numbers_of = compared.difference, compared.se, compared.p_value, holm(compared.p_value), *limits, methods
    columns = [column.tolist() for column in numbers_of]
    names = [(estimates.names[a], estimates.names[b]) for a, b in zip(first, second, strict=True)]
    return [Contrast(a, b, *numbers) for (a, b), *numbers in zip(names, *columns, strict=True)]


def differences(estimates: Estimates, first: NDArray[np.intp], second: NDArray[np.intp]) -> Differences:
    """Return the differences of pairs of estimates.

    If all participants voted alike on a pair, the clustered error is zero and says nothing about other people. Such
    a difference gets the error from the information, and a p-value of 1. Few participants make the clustered error
    too small by chance; interval and p-value are then at least those of the votes as independent.

    Parameters
    ----------
    estimates : Estimates
    first, second : intp (K,), indices of the pairs

    Returns
    -------
    Differences, each (K,)
    """
    difference = estimates.values[first] - estimates.values[second]
    naive = np.sqrt(_variances(estimates.covariance, first, second))
    if estimates.participant_covariance is None:
        half, p_value = critical_value(None) * naive, two_sided(difference / naive, None)
        return Differences(difference, naive, half, p_value, np.zeros(len(naive), bool))
    n, is_few = estimates.n_participants, estimates.is_few
    clustered = np.sqrt(_variances(estimates.participant_covariance, first, second))
    is_alike = clustered**2 <= ALIKE * naive**2
    clustered = np.where(is_alike, naive, clustered)
    p_value = two_sided(difference / clustered, n)
    if is_few:
        p_value = np.maximum(p_value, two_sided(difference / naive, None))
    se = np.maximum(clustered, naive) if is_few else clustered
    half = _half_width(clustered, naive, estimates)
    return Differences(difference, se, half, np.where(is_alike, 1.0, p_value), is_alike)


def simultaneous_factor(estimates: Estimates) -> float:
    """Return how much wider than alone the intervals of all pairs are that hold together in 95 % of studies.

    The 95 % point of the largest of all pairs' t statistics, from `DRAWN` random vectors (fixed seed), is compared with
    that of a single one.

    Parameters
    ----------
    estimates : Estimates
    """
    n = len(estimates.names)
    clustered = estimates.participant_covariance
    covariance = (estimates.covariance if clustered is None else clustered)[:n, :n]
    first, second = np.triu_indices(n, 1)
    errors = np.sqrt(_variances(covariance, first, second))
    known = errors**2 > ALIKE * _variances(estimates.covariance, first, second)
    if n < 3 or not known.any():
        return 1.0
    rng = np.random.default_rng(n)
    values, vectors = np.linalg.eigh(covariance)
    drawn = (rng.standard_normal((DRAWN, n)) * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    largest = (np.abs(drawn[:, first[known]] - drawn[:, second[known]]) / errors[known]).max(axis=1)
    if estimates.n_participants is not None:
        df = estimates.n_participants - 1
        largest = largest / np.sqrt(rng.chisquare(df, DRAWN) / df)
    return max(1.0, float(np.quantile(largest, LEVEL)) / critical_value(estimates.n_participants))


def half_widths(estimates: Estimates) -> Array | None:
    """Return half the width of each estimate's 95 % interval, log-odds, float64 (K,).

    It is by t(J - 1) on errors clustered by participant, or by the normal distribution where participants are unknown;
    None where they are known but their variation is not, NaN where they agree on an estimate exactly.
    """
    n = len(estimates.names)
    naive = np.sqrt(np.diag(estimates.covariance)[:n])
    if estimates.participant_covariance is None:
        return critical_value(None) * naive if estimates.n_participants is None else None
    clustered = np.sqrt(np.maximum(np.diag(estimates.participant_covariance)[:n], 0.0))
    return np.where(clustered**2 <= ALIKE * naive**2, np.nan, _half_width(clustered, naive, estimates))


def or_none(values: Array) -> list[float | None]:
    """Return numbers with None in the place of NaN.

    Parameters
    ----------
    values : float64 (K,)
    """
    return [None if np.isnan(value) else value for value in values.tolist()]


def _half_width(clustered: Array, naive: Array, estimates: Estimates) -> Array:
    """Return half the width of 95 % intervals by t(J - 1) on errors clustered by participant.

    With few participants it is at least that of the normal distribution on the errors of the votes. In simulations of
    4 to 8 people such intervals hold 96 to 98 %, where t(J - 1) on the larger error holds 98 to 100 %.
    """
    half = critical_value(estimates.n_participants) * clustered
    return np.maximum(half, critical_value(None) * naive) if estimates.is_few else half


def has_few_participants(fit: Fit) -> bool:
    """Are the participants too few, or no more than the free parameters, for errors clustered by participant alone?"""
    n = fit.n_participants
    return n is not None and (n < FEWEST_PARTICIPANTS or n <= fit.design.n_free)


def critical_value(n_participants: float | None) -> float:
    """Return how many standard errors a 95 % interval reaches: by t(J - 1), or normal without participants."""
    tail = (1 + LEVEL) / 2
    return float(norm.ppf(tail) if n_participants is None else student.ppf(tail, n_participants - 1))


def _variances(covariance: Array, first: NDArray[np.intp], second: NDArray[np.intp]) -> Array:
    """Return the variances of differences of parameters, float64 (K,); rounding takes none below zero."""
    variances = np.diag(covariance)
    return np.maximum(variances[first] + variances[second] - 2 * covariance[first, second], 0.0)


def two_sided(ratio: Array, n_participants: float | None) -> Array:
    """Return two-sided p-values from t(J - 1), or from the normal distribution without participants.

    Parameters
    ----------
    ratio : float64 (K,), estimates in units of their standard errors
    """
    tail = norm.sf(np.abs(ratio)) if n_participants is None else student.sf(np.abs(ratio), n_participants - 1)
    return np.asarray(2 * tail)


def holm(p_values: Array) -> Array:
    """Correct p-values for their number.

    Parameters
    ----------
    p_values : float64 (K,)

    Source
    ------
    Holm (1979).
    """
    order = np.argsort(p_values)
    stepped = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    result = np.empty_like(p_values)
    result[order] = np.minimum(stepped, 1.0)
    return result


def corrected_together(
    contrasts: Mapping[Place, Sequence[Contrast]], family: Callable[[Place], Hashable | None]
) -> dict[Place, Sequence[Contrast]]:
    """Return contrasts of several fits corrected over each family of fits, by Holm's method.

    Panels of datasets stand side by side, and a reader looks for differences in each of them.

    Parameters
    ----------
    contrasts : of each fit
    family : function of a fit's key; fits without one, None, keep their own correction
    """
    result = dict(contrasts)
    members: dict[Hashable, list[Place]] = {}
    for place in contrasts:
        members.setdefault(family(place), []).append(place)
    members.pop(None, None)
    for places in members.values():
        rows = [row for place in places for row in contrasts[place]]
        tested = [row.method != NEVER_COMPARED for row in rows]
        corrected = iter(holm(np.array([row.p_value for row, is_it in zip(rows, tested, strict=True) if is_it])))
        together = [
            replace(row, p_holm=float(next(corrected))) if is_it else row
            for row, is_it in zip(rows, tested, strict=True)
        ]
        for place in places:
            size = len(contrasts[place])
            result[place], together = together[:size], together[size:]
    return result


def letters(items: Sequence[str], comparisons: Sequence[Contrast]) -> dict[str, str]:
    """Give out letters: two items share a letter if and only if they do not differ significantly.

    Parameters
    ----------
    items : in the order in which letters are given out, the best first
    comparisons : contrasts of all pairs

    Source
    ------
    Piepho (2004), insert and absorb: start with one group of all items; every significant pair splits the groups that
    hold both.
    """
    groups = [frozenset(items)]
    for contrast in comparisons:
        if contrast.p_holm < SIGNIFICANT:
            apart = {contrast.item_a, contrast.item_b}
            split = [group - {item} if apart <= group else group for group in groups for item in apart]
            groups = _absorbed(split)
    rank = {item: place for place, item in enumerate(items)}
    groups.sort(key=lambda group: sorted(rank[item] for item in group))
    return {item: "".join(_letter(place) for place, group in enumerate(groups) if item in group) for item in items}


def _absorbed(groups: Sequence[frozenset[str]]) -> list[frozenset[str]]:
    """Drop groups that are part of another group."""
    different = list(dict.fromkeys(groups))
    return [group for group in different if not any(group < other for other in different)]


def _letter(place: int) -> str:
    """Return a to z, A to Z, then a. to Z., a.. and so on, as multcompView does."""
    dots, letter = divmod(place, len(ascii_letters))
    return ascii_letters[letter] + "." * dots

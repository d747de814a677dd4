"""Recover the quality of items from noisy ratings: a model of each participant's bias and inconsistency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import chi2
from scipy.stats import t as student

from app.analysis.model.settings import LEVEL
from app.analysis.ratings.opinion_scores import ALIKE
from app.analysis.ratings.table import RatingTable

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

FEWEST_RATINGS = 3  # of a participant; with fewer, bias and quality can follow them without a residue
# Of the scale's length; an inconsistency below it is on its way to 0, where the likelihood is infinite.
COLLAPSED = 1e-3
TOLERANCE = 1e-10  # of the scale's length, between iterations
MOST_ITERATIONS = 10_000
COMMON = "common inconsistency"
UPPER = (1 + LEVEL) / 2


@dataclass(frozen=True)
class SubjectModel:
    """Estimates of the model rating = quality + bias + inconsistency x standard normal noise.

    Parameters
    ----------
    quality : float64 (I,), units of the scale; NaN for items that nobody in the model rated
    bias : float64 (P,), units of the scale, mean 0; NaN for participants left out
    inconsistency : float64 (P,), standard deviation in units of the scale; NaN for participants left out
    quality_covariance : float64 (I, I)
    bias_se : float64 (P,)
    log_inconsistency_se : float64 (P,), of the natural logarithm; NaN if participants share one
    loglik : log-likelihood; NaN without estimates
    iterations : number of alternating projections
    status : `ok`; `common inconsistency`: the likelihood has no maximum, so all participants have the same one, and
        `inconsistency` only describes the residues; `disconnected` or `not converged`: there are no estimates
    """

    quality: Array
    bias: Array
    inconsistency: Array
    quality_covariance: Array
    bias_se: Array
    log_inconsistency_se: Array
    loglik: float
    iterations: int
    status: str


@dataclass(frozen=True)
class _Fit:
    """Estimates for participants and items that are numbered without gaps; fields as in `SubjectModel`."""

    quality: Array
    bias: Array
    inconsistency: Array
    iterations: int


class _NoMaximumError(Exception):
    """The likelihood grows without limit, or has a saddle point where it should have a maximum."""


def fit_subject_model(table: RatingTable) -> SubjectModel:
    """Estimate quality, bias and inconsistency by maximum likelihood with alternating projections.

    A participant p rates item j with quality_j + bias_p + inconsistency_p e, where e is standard normal. Repeated
    ratings are further observations, missing ones are none. Each round estimates the inconsistencies from the residues,
    then the qualities with weights 1 / inconsistency^2, then the biases; a fixed point is a stationary point of the
    likelihood. Errors come from the inverse of the observed information of all parameters under sum(bias) = 0: they
    hold for repeated ratings by these participants.

    The likelihood has no global maximum: it is infinite where the qualities follow a participant without residue. The
    estimate is the local maximum that the plain means lead to. With few ratings, or with a participant who is far more
    consistent than all others, there may be none; then all participants get the same weight, which is least squares
    with biases removed. Participants with fewer than three ratings are left out.

    Parameters
    ----------
    table : RatingTable

    Returns
    -------
    SubjectModel

    Source
    ------
    ITU-T P.910 (10/2023) Annex E; Li, Bampis, Krasula, Janowski and Katsavounidis (2020), "A Simple Model for Subject
    Behavior in Subjective Experiments". Biases alone: ITU-T P.913 (06/2021), clause 12.4.
    """
    counts = np.bincount(table.person, minlength=len(table.participants))
    is_used = counts[table.person] >= FEWEST_RATINGS
    people, person = np.unique(table.person[is_used], return_inverse=True)
    items, item = np.unique(table.item[is_used], return_inverse=True)
    rating, length = table.rating[is_used], table.high - table.low
    if len(people) < 2 or not _is_connected(person, item):
        return _without_estimates(table, "disconnected")
    try:
        fit, status = _fit_projections(person, item, rating, length), "ok"
        residue = rating - fit.quality[item] - fit.bias[person]
        errors = _errors(person, item, residue, 1 / fit.inconsistency**2)
    except _NoMaximumError:
        fit, status = _fit_common(person, item, rating, length), COMMON
        residue = rating - fit.quality[item] - fit.bias[person]
        freedom = max(len(rating) - len(items) - len(people) + 1, 1)
        spread = float(np.sqrt(residue @ residue / freedom))
        is_known = spread > ALIKE * length  # else nothing is left that could tell the noise
        common = np.full(len(people), max(spread, COLLAPSED * length) ** -2)
        errors = _errors(person, item, np.zeros(len(item)), common)
        errors = errors if is_known else (errors[0] * np.nan, errors[1] * np.nan, errors[2])
    if fit.iterations == MOST_ITERATIONS:
        return _without_estimates(table, "not converged")
    result = _without_estimates(table, status)
    covariance, bias_se, log_se = errors
    result.quality[items], result.bias[people], result.inconsistency[people] = fit.quality, fit.bias, fit.inconsistency
    result.quality_covariance[np.ix_(items, items)], result.bias_se[people] = covariance, bias_se
    if status == COMMON:
        return replace(result, iterations=fit.iterations)
    result.log_inconsistency_se[people] = log_se
    loglik = -float(np.bincount(person) @ np.log(fit.inconsistency)) - len(rating) * (1 + np.log(2 * np.pi)) / 2
    return replace(result, iterations=fit.iterations, loglik=loglik)


def rater_intervals(table: RatingTable, model: SubjectModel) -> tuple[Array, Array, Array]:
    """Return half the width of each bias's 95 % interval, and the limits of each inconsistency's; NaN where unknown.

    Maximum likelihood takes somebody's residues for all of the noise, but their bias, and the qualities as far as they
    follow this person's weight, have taken a part: of n ratings n (1 - weight) - 1 or so are left, which chi-square and
    t take as degrees of freedom. Without that the intervals of 8 people hold in 81 and 92 % (bench/sentences.py).

    Parameters
    ----------
    table : RatingTable
    model : of this table

    Returns
    -------
    bias_half, inconsistency_low, inconsistency_high, float64 (P,) each
    """
    if model.status != "ok":
        nothing = np.full(len(model.bias), np.nan)
        return student.ppf(UPPER, np.inf) * model.bias_se, nothing, nothing
    weight = np.nan_to_num(model.inconsistency, nan=np.inf) ** -2.0
    of_item = np.bincount(table.item, weight[table.person])[table.item]
    share = np.divide(weight[table.person], of_item, out=np.zeros(len(of_item)), where=of_item > 0)
    n = np.bincount(table.person, minlength=len(weight)).astype(np.float64)
    freedom = np.maximum((n - 1) * (1 - np.bincount(table.person, share, len(n)) / np.maximum(n, 1)), 1.0)
    low, high = (model.inconsistency * np.sqrt(n / chi2.ppf(end, freedom)) for end in (UPPER, 1 - UPPER))
    half = student.ppf(UPPER, freedom) * model.bias_se * np.sqrt(n / freedom)
    return half, np.minimum(low, model.inconsistency), high


def _without_estimates(table: RatingTable, status: str) -> SubjectModel:
    n_people, n_items = len(table.participants), len(table.items)
    return SubjectModel(
        quality=np.full(n_items, np.nan),
        bias=np.full(n_people, np.nan),
        inconsistency=np.full(n_people, np.nan),
        quality_covariance=np.full((n_items, n_items), np.nan),
        bias_se=np.full(n_people, np.nan),
        log_inconsistency_se=np.full(n_people, np.nan),
        loglik=np.nan,
        iterations=0,
        status=status,
    )


def _is_connected(person: Indices, item: Indices) -> bool:
    """Do the ratings link all participants and items, so that bias and quality can be told apart?"""
    n_people, n_nodes = person.max() + 1, person.max() + item.max() + 2
    graph = coo_array((np.ones(len(person)), (person, n_people + item)), shape=(n_nodes, n_nodes))
    return bool((connected_components(graph, directed=False)[1] == 0).all())


def _fit_projections(person: Indices, item: Indices, rating: Array, length: float) -> _Fit:
    """Return the local maximum that the plain means lead to.

    Raises
    ------
    _NoMaximumError
        If an inconsistency goes to 0.
    """
    n_ratings = np.bincount(person)

    def weights(residue: Array) -> Array:
        variance = np.bincount(person, residue**2) / n_ratings
        if variance.min() < (COLLAPSED * length) ** 2:
            raise _NoMaximumError
        return np.asarray(1 / variance)

    return _project(person, item, rating, weights, TOLERANCE * length)


def _fit_common(person: Indices, item: Indices, rating: Array, length: float) -> _Fit:
    """Return the least squares estimate, in which all participants have the same weight."""
    equal = np.ones(int(person.max()) + 1)
    return _project(person, item, rating, lambda _: equal, TOLERANCE * length)


def _project(
    person: Indices, item: Indices, rating: Array, weights: Callable[[Array], Array], tolerance: float
) -> _Fit:
    """Alternate between qualities and biases until the qualities change less than the tolerance.

    Parameters
    ----------
    weights : function of the residues (N,); returns the participants' weights (P,)
    """
    n_ratings = np.bincount(person)
    quality = np.bincount(item, rating) / np.bincount(item)
    bias = np.bincount(person, rating - quality[item]) / n_ratings
    iterations, change = 0, np.inf
    while change >= tolerance and iterations < MOST_ITERATIONS:
        before = quality
        weight = weights(rating - quality[item] - bias[person])[person]
        quality = np.bincount(item, weight * (rating - bias[person])) / np.bincount(item, weight)
        bias = np.bincount(person, rating - quality[item]) / n_ratings
        change, iterations = np.abs(quality - before).max(), iterations + 1
    residue = rating - quality[item] - bias[person]
    inconsistency = np.sqrt(np.bincount(person, residue**2) / n_ratings)
    return _Fit(quality + bias.mean(), bias - bias.mean(), inconsistency, iterations)


def _errors(person: Indices, item: Indices, residue: Array, weight: Array) -> tuple[Array, Array, Array]:
    """Return the qualities' covariance (I, I), and the errors of biases and of log inconsistencies, both (P,).

    The information about biases (b) and log inconsistencies (s) is diagonal, so both are eliminated from that about
    qualities (q). What remains is singular along "all qualities up, all biases down", which sum(b) = 0 fixes.

    Raises
    ------
    _NoMaximumError
        If the information is not positive.
    """
    n_people, n_items = len(weight), int(item.max()) + 1
    n_ratings = np.bincount(person)
    shape = (n_items, n_people)
    times = coo_array((np.ones(len(item)), (item, person)), shape=shape).toarray()
    with_bias = times * weight  # (I, P), information q, b
    with_spread = coo_array((residue, (item, person)), shape=shape).toarray() * 2 * weight  # (I, P), q, s
    on_bias, on_spread = n_ratings * weight, 2.0 * n_ratings  # (P,), b, b and s, s
    from_bias, from_spread = with_bias / on_bias, with_spread / on_spread
    remaining = np.diag(with_bias.sum(axis=1)) - from_bias @ with_bias.T - from_spread @ with_spread.T
    scale = with_bias.sum() / n_items**2
    try:
        factor = cho_factor(remaining + scale)  # adds ones times ones: the singular direction
    except LinAlgError as error:
        raise _NoMaximumError from error
    free = cho_solve(factor, np.eye(n_items))
    mean_part = from_bias.mean(axis=1)  # (I,), how the mean bias follows the qualities
    with_mean = free @ mean_part
    mean_variance = float((1 / on_bias).sum() / n_people**2 + mean_part @ with_mean)
    covariance = free - with_mean[:, None] - with_mean[None, :] + mean_variance
    bias_variance = (
        1 / on_bias
        + np.einsum("ip,ij,jp->p", from_bias, free, from_bias, optimize=True)
        - 2 * (1 / (on_bias * n_people) + from_bias.T @ with_mean)
        + mean_variance
    )
    log_variance = 1 / on_spread + np.einsum("ip,ij,jp->p", from_spread, free, from_spread, optimize=True)
    return covariance, np.sqrt(np.maximum(bias_variance, 0)), np.sqrt(log_variance)

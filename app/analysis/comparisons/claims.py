"""Simulate many studies at once, and find how often each claim that a report can make would be made.

Hundreds of simulated studies are fitted in one batch, so the power of a claim takes about a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, norm
from scipy.stats import t as student

from app.analysis.model.bootstrap import RUNAWAY
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, SIGNIFICANT
from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.model.likelihood.newton import Design, Search, maximise
from app.analysis.model.likelihood.participant_errors import ALIKE
from app.analysis.model.likelihood.ties import TIE_MODELS

Array = NDArray[np.float64]

DAVIDSON = TIE_MODELS["davidson"]
TOGETHER = 1_500_000  # votes simulated at once
MEASURE_CORRELATION = 0.9  # of a good measure with the true scores
FEWEST_DATASETS = 3


@dataclass(frozen=True)
class People:
    """Who judges what, of the studies that are simulated.

    Parameters
    ----------
    conditions, datasets, participants : numbers
    tie_rate : share of "no preference" between equal conditions
    spread : standard deviation over participants of their opinion of a condition, log-odds
    by_dataset : the same of an opinion on each dataset apart
    dataset_spread : standard deviation over datasets of a condition's score
    drop_out : share of the participants who leave half-way
    careless : share of the participants who throw a coin
    """

    conditions: int
    datasets: int
    participants: int
    tie_rate: float
    spread: float
    by_dataset: float = 0.0
    dataset_spread: float = 0.0
    drop_out: float = 0.0
    careless: float = 0.0


@dataclass(frozen=True)
class Fitted:
    """Fits of R studies: scores, and covariances with participants and with votes as the sample.

    Parameters
    ----------
    scores : float64 (R, n), log-odds
    people, votes : float64 (R, n, n)
    is_there : bool (R,), has the study a maximum?
    """

    scores: Array
    people: Array
    votes: Array
    is_there: NDArray[np.bool_]


def simulated_votes(people: People, abilities: Array, n_studies: int, rng: np.random.Generator) -> Array:
    """Simulate the votes of studies in which everybody judges every pair on every dataset once.

    Parameters
    ----------
    people : who judges what
    abilities : float64 (n,), true scores, log-odds
    n_studies : R
    rng : Generator

    Returns
    -------
    float64 (R, J, D, 3, C), votes for the first, for the second and for neither of each pair
    """
    n, shape = people.conditions, (n_studies, people.participants, people.datasets)
    low, high = np.triu_indices(n, 1)
    scores = np.broadcast_to(abilities, (*shape, n)).copy()
    for spread, size in (
        (people.spread, (n_studies, people.participants, 1, n)),
        (people.dataset_spread, (n_studies, 1, people.datasets, n)),
        (people.by_dataset, (*shape, n)),
    ):
        if spread:
            scores += spread * rng.standard_normal(size)
    if people.careless:
        scores *= rng.random((*shape[:2], 1, 1)) >= people.careless
    d = scores[..., low] - scores[..., high]
    weights = np.stack(
        [np.exp(d / 2), np.exp(-d / 2), np.full(d.shape, 2 * people.tie_rate / (1 - people.tie_rate))], 3
    )
    bounds = np.cumsum(weights, axis=3)
    drawn = rng.random(d.shape) * bounds[..., -1, :]
    choice = (drawn[..., None, :] > bounds[..., :2, :]).sum(axis=3)
    votes = (choice[..., None, :] == np.arange(3)[:, None]).astype(np.float64)
    if people.drop_out:
        leaves = rng.random((*shape[:2], 1, 1, 1)) < people.drop_out
        votes = votes * ~(leaves & (rng.random((*shape, 1, len(low))) < 0.5))
    return np.asarray(votes, np.float64)


def fitted_together(votes: Array) -> Fitted:
    """Fit the scores of many studies.

    Parameters
    ----------
    votes : float64 (R, J, 3, C), of every pair of n items
    """
    n_studies, n_people, _, n_pairs = votes.shape
    n = round((1 + np.sqrt(1 + 8 * n_pairs)) / 2)
    low, high = np.triu_indices(n, 1)
    nothing = np.zeros(n_pairs)
    design = Design(PairCounts(n, low, high, nothing, nothing, nothing), DAVIDSON, bool(votes[:, :, 2].any()))
    table = votes.sum(axis=1)
    maximum = maximise(design, *(table[:, kind] for kind in range(3)), search=Search(runaway=RUNAWAY))
    d, t = design.predictors(np.where(maximum.converged[:, None], maximum.theta, 0.0))
    information = design.information(DAVIDSON.derivatives(d, t, *(table[:, kind] for kind in range(3))))
    inverse = np.asarray(np.linalg.pinv(information, hermitian=True), np.float64)
    by_person = DAVIDSON.derivatives(d[:, None], t[:, None], *(votes[:, :, kind] for kind in range(3)))
    slopes = np.broadcast_to(by_person.d, (n_studies, n_people, n_pairs))
    gradients = [slopes @ design.incidence.toarray()]
    if design.has_tie:
        gradients.append(np.broadcast_to(by_person.t, slopes.shape).sum(axis=2, keepdims=True))
    influence = np.concatenate(gradients, axis=2) @ inverse
    people = np.swapaxes(influence, 1, 2) @ influence * n_people / max(n_people - 1, 1)
    return Fitted(maximum.theta[:, :n], people[:, :n, :n], inverse[:, :n, :n], maximum.converged)


def contrast_p_values(fitted: Fitted, votes: Array, directions: Array) -> Array:
    """Return two-sided p-values of contrasts as the report's tests give them, float64 (R, K).

    With fewer than twelve participants they are no surer than the votes. A study without a maximum has sign tests over
    participants of the pairs.

    Parameters
    ----------
    fitted : Fitted
    votes : float64 (R, J, 3, C)
    directions : float64 (K, n)
    """
    n_people = votes.shape[1]
    value = fitted.scores @ directions.T
    clustered, naive = (
        np.sqrt(np.maximum(np.einsum("ki,rij,kj->rk", directions, part, directions, optimize=True), 0.0))
        for part in (fitted.people, fitted.votes)
    )
    is_alike = clustered**2 <= ALIKE * naive**2
    p_value = 2 * student.sf(np.abs(value) / np.where(is_alike, 1.0, clustered), n_people - 1)
    if n_people < FEWEST_PARTICIPANTS:
        p_value = np.maximum(p_value, 2 * norm.sf(np.abs(value) / np.where(naive > 0, naive, 1.0)))
    p_value = np.where(is_alike, 1.0, p_value)
    return np.where(fitted.is_there[:, None], p_value, _sign_tests(votes, directions))


def _sign_tests(votes: Array, directions: Array) -> Array:
    """Return sign tests over participants of the pairs that directions compare; 1 of other directions."""
    n = directions.shape[1]
    low, high = np.triu_indices(n, 1)
    balance = np.sign(votes[:, :, 0] - votes[:, :, 1])
    result = np.ones((len(votes), len(directions)))
    for column, direction in enumerate(directions):
        places = np.flatnonzero(direction)
        if len(places) == 2:
            pair = int(np.flatnonzero((low == places[0]) & (high == places[1]))[0])
            for_first, decided = (balance[..., pair] > 0).sum(axis=1), (balance[..., pair] != 0).sum(axis=1)
            fewer = np.minimum(for_first, decided - for_first)
            result[:, column] = np.minimum(1.0, 2 * binom.cdf(fewer, decided, 0.5))
    return result


def holm_together(p_values: Array) -> Array:
    """Return p-values (R, K) corrected over each row by Holm's method."""
    order = np.argsort(p_values, axis=1)
    factors = np.arange(p_values.shape[1], 0, -1)
    stepped = np.maximum.accumulate(np.take_along_axis(p_values, order, 1) * factors, axis=1)
    result = np.empty_like(p_values)
    np.put_along_axis(result, order, np.minimum(stepped, 1.0), 1)
    return result


def pair_directions(n: int) -> Array:
    """Return the contrast of every pair of n conditions, float64 (n (n - 1) / 2, n)."""
    low, high = np.triu_indices(n, 1)
    return np.eye(n)[low] - np.eye(n)[high]


def _two_apart(n: int, effect: float) -> Array:
    """Return scores of which the first two differ, and the others lie halfway."""
    return np.asarray(np.r_[effect / 2, -effect / 2, np.zeros(n - 2)])


def _one_above(n: int, effect: float) -> Array:
    return np.asarray(np.r_[effect, np.zeros(n - 1)])


def _two_halves(n: int, effect: float) -> Array:
    return np.where(np.arange(n) < n // 2, effect / 2, -effect / 2)


def _evenly(n: int, effect: float) -> Array:
    return np.linspace(effect / 2, -effect / 2, n)


def _told_apart(votes: Array, fitted: Fitted, _rng: np.random.Generator) -> NDArray[np.bool_]:
    """Is the first pair told apart, as the report tells pairs apart: all pairs, Holm?"""
    pairs = pair_directions(fitted.scores.shape[1])
    return holm_together(contrast_p_values(fitted, votes.sum(axis=2), pairs))[:, 0] < SIGNIFICANT


def _pair(votes: Array, fitted: Fitted, _rng: np.random.Generator) -> NDArray[np.bool_]:
    pairs = pair_directions(fitted.scores.shape[1])[:1]
    return contrast_p_values(fitted, votes.sum(axis=2), pairs)[:, 0] < SIGNIFICANT


def _best(votes: Array, fitted: Fitted, _rng: np.random.Generator) -> NDArray[np.bool_]:
    pairs = pair_directions(fitted.scores.shape[1])
    corrected = holm_together(contrast_p_values(fitted, votes.sum(axis=2), pairs))
    is_of_first = pairs[:, 0] != 0
    is_above = (fitted.scores[:, :1] > fitted.scores[:, 1:]).all(axis=1)
    return np.asarray((corrected[:, is_of_first] < SIGNIFICANT).all(axis=1) & is_above)


def _factor(votes: Array, fitted: Fitted, _rng: np.random.Generator) -> NDArray[np.bool_]:
    n = fitted.scores.shape[1]
    half = np.where(np.arange(n) < n // 2, 1 / (n // 2), -1 / (n - n // 2))[None]
    p_value = contrast_p_values(fitted, votes.sum(axis=2), half)[:, 0]
    return np.asarray((p_value < SIGNIFICANT) & fitted.is_there)


def _measure(_votes: Array, fitted: Fitted, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Is the correlation of a measure with the scores shown?"""
    n = fitted.scores.shape[1]
    if n < 3:
        return np.zeros(len(fitted.scores), bool)
    truth = _evenly(n, 1.0) / _evenly(n, 1.0).std()
    noise = rng.standard_normal(fitted.scores.shape) * np.sqrt(1 - MEASURE_CORRELATION**2)
    measured = MEASURE_CORRELATION * truth + noise
    measured -= measured.mean(axis=1, keepdims=True)
    scores = fitted.scores - fitted.scores.mean(axis=1, keepdims=True)
    size = np.sqrt((measured**2).sum(axis=1) * (scores**2).sum(axis=1))
    r = np.divide((measured * scores).sum(axis=1), size, out=np.zeros_like(size), where=size > 0)  # all scores equal: 0
    p_value = 2 * student.sf(np.abs(r) * np.sqrt((n - 2) / np.maximum(1 - r**2, 1e-12)), n - 2)
    return np.asarray(p_value < SIGNIFICANT)


def _over_datasets(votes: Array, fitted: Fitted, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Is a pair fixed before told apart for datasets like these, datasets being a sample?"""
    n_studies, _, n_datasets = votes.shape[:3]
    if n_datasets < FEWEST_DATASETS:
        return np.zeros(n_studies, bool)
    apart = np.swapaxes(votes, 1, 2).reshape(n_studies * n_datasets, votes.shape[1], *votes.shape[3:])
    scores = fitted_together(apart).scores.reshape(n_studies, n_datasets, -1)
    differences = scores[..., 0] - scores[..., 1]
    spread = differences.var(axis=1, ddof=1) / n_datasets
    people, of_votes = (part[:, 0, 0] + part[:, 1, 1] - 2 * part[:, 0, 1] for part in (fitted.people, fitted.votes))
    shared = np.maximum(people - of_votes, 0.0)
    df = (spread + shared) ** 2 / (spread**2 / (n_datasets - 1) + shared**2 / (votes.shape[1] - 1))
    ratio = np.abs(differences.mean(axis=1)) / np.sqrt(spread + shared)
    return np.asarray((2 * student.sf(ratio, df) < SIGNIFICANT) & fitted.is_there & _pair(votes, fitted, rng))


Claim = Callable[[Array, Fitted, np.random.Generator], NDArray[np.bool_]]
CLAIMS: dict[str, tuple[str, Callable[[int, float], Array], Claim]] = {
    "told apart": ("two conditions are told apart (all pairs, Holm)", _two_apart, _told_apart),
    "pair": ("two conditions fixed before the study differ", _two_apart, _pair),
    "best": ("one condition is best: it differs from every other", _one_above, _best),
    "factor": ("a factor of two levels has an effect", _two_halves, _factor),
    "measure": (f"a measure (correlation {MEASURE_CORRELATION}) goes with the scores", _evenly, _measure),
    "datasets": ("two conditions fixed before differ for datasets like these", _two_apart, _over_datasets),
}


def claim_power(people: People, claim: str, effect: float, seed: int, replicates: int) -> float:
    """Return the share of simulated studies in which a claim is made.

    Parameters
    ----------
    people : who judges what
    claim : key of `CLAIMS`
    effect : what is true, log-odds: the difference of the two conditions, of the best from the others, of the factor's
        levels, or of the ends of evenly spaced conditions
    seed : for the simulated votes
    replicates : simulated studies
    """
    _, scores_of, is_made = CLAIMS[claim]
    rng = np.random.default_rng(seed)
    n_pairs = people.conditions * (people.conditions - 1) // 2
    size = max(1, TOGETHER // (people.participants * people.datasets * n_pairs))
    made = 0
    for start in range(0, replicates, size):
        n_studies = min(size, replicates - start)
        votes = simulated_votes(people, scores_of(people.conditions, effect), n_studies, rng)
        made += int(is_made(votes, fitted_together(votes.sum(axis=2)), rng).sum())
    return made / replicates

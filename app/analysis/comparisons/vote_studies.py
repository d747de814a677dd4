"""Plan a study of pair comparisons, and simulate and fit hundreds of such studies in one batch."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, norm
from scipy.stats import t as student

from app.analysis.comparisons.datasets_sample import FEWEST_DATASETS
from app.analysis.comparisons.study_plan import PlannedStudy, Studies
from app.analysis.model.bootstrap import RUNAWAY
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS
from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.model.likelihood.fit import ALIKE
from app.analysis.model.likelihood.newton import Design, Search, maximise
from app.analysis.model.likelihood.ties import TIE_MODELS, WITHOUT_TIES
from app.analysis.model.scales import LOG_ODDS_PER_JOD
from app.study.planning import TYPICAL_SPREAD, TYPICAL_TIE_RATE

Array = NDArray[np.float64]

DAVIDSON = TIE_MODELS["davidson"]


@dataclass(frozen=True)
class StudyPlan(PlannedStudy):
    """A study in which every participant judges every pair of conditions on every dataset once.

    Parameters
    ----------
    tie_rate : share of "no preference" between equal conditions
    """

    unit: ClassVar[float] = LOG_ODDS_PER_JOD  # effects are in JOD

    tie_rate: float = TYPICAL_TIE_RATE
    spread: float = field(default=TYPICAL_SPREAD, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.tie_rate < 1:
            raise ValueError(f"tie_rate is {self.tie_rate}, expected 0 or more and less than 1")

    @property
    def trials(self) -> int:
        """Number of pairs of each dataset."""
        return self.conditions * (self.conditions - 1) // 2

    def simulated(self, scores: Array, n_studies: int, rng: np.random.Generator) -> Studies:
        """Simulate the votes of studies.

        Parameters
        ----------
        scores, n_studies, rng : as in `PlannedStudy.simulated`; float64 (n,), log-odds
        """
        return VoteStudies(simulated_votes(self, scores, n_studies, rng))


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


@dataclass(frozen=True)
class VoteStudies:
    """Simulated studies by their votes, float64 (R, J, D, 3, C)."""

    votes: Array

    @cached_property
    def fitted(self) -> Fitted:
        """Fits to the votes on all datasets."""
        return fitted_together(self.votes.sum(axis=2))

    @property
    def scores(self) -> Array:
        """Scores, float64 (R, n), log-odds."""
        return self.fitted.scores

    @property
    def has_scores(self) -> NDArray[np.bool_]:
        """Has each study a maximum? bool (R,)."""
        return self.fitted.is_there

    def p_values(self, directions: Array) -> Array:
        """Return two-sided p-values of contrasts, directions float64 (K, n); float64 (R, K)."""
        return contrast_p_values(self.fitted, self.votes.sum(axis=2), directions)

    def p_over_datasets(self) -> Array:
        """Return p-values of the first pair with datasets as a sample, float64 (R,), as `pair_p_values` has them."""
        n_studies, n_people, n_datasets = self.votes.shape[:3]
        apart = np.swapaxes(self.votes, 1, 2).reshape(n_studies * n_datasets, n_people, *self.votes.shape[3:])
        fitted = fitted_together(apart)
        is_there = fitted.is_there.reshape(n_studies, n_datasets, 1)
        scores = np.where(is_there, fitted.scores.reshape(n_studies, n_datasets, -1), 0.0)
        there = is_there.sum(axis=(1, 2))
        means = scores.sum(axis=1) / np.maximum(there, 1)[:, None]
        deviations = np.where(is_there, scores - means[:, None], 0.0)
        spread = np.swapaxes(deviations, 1, 2) @ deviations / np.maximum(there * (there - 1), 1)[:, None, None]
        total, size = np.trace(spread, axis1=1, axis2=2), np.sum(spread**2, axis=(1, 2))
        is_known = self.has_scores & (there >= FEWEST_DATASETS) & (total > 0)
        common = np.where(is_known, total, 1.0) / (scores.shape[2] - 1)
        df_common = (there - 1) * total**2 / np.where(is_known, size, 1.0)
        people, of_votes = (
            (part[:, 0, 0] + part[:, 1, 1] - 2 * part[:, 0, 1]) / 2 for part in (self.fitted.people, self.fitted.votes)
        )
        shared = np.maximum(people - of_votes, 0.0)
        df = (common + shared) ** 2 / (common**2 / np.maximum(df_common, 1.0) + shared**2 / (n_people - 1))
        ratio = np.abs(means[:, 0] - means[:, 1]) / np.sqrt(2 * (common + shared))
        return np.where(is_known, 2 * student.sf(ratio, df), 1.0)


def simulated_votes(plan: StudyPlan, abilities: Array, n_studies: int, rng: np.random.Generator) -> Array:
    """Simulate the votes of studies in which everybody judges every pair on every dataset once.

    Parameters
    ----------
    plan : the study
    abilities : float64 (n,), true scores, log-odds
    n_studies : R
    rng : Generator

    Returns
    -------
    float64 (R, J, D, 3, C), votes for the first, for the second and for neither of each pair
    """
    low, high = np.triu_indices(plan.conditions, 1)
    scores = plan.shifted(abilities, n_studies, rng)
    careless = plan.are_careless(n_studies, rng)
    if careless is not None:
        scores *= ~careless[..., None, None]
    d = scores[..., low] - scores[..., high]
    weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(d.shape, 2 * plan.tie_rate / (1 - plan.tie_rate))], 3)
    bounds = np.cumsum(weights, axis=3)
    drawn = rng.random(d.shape) * bounds[..., -1, :]
    choice = (drawn[..., None, :] > bounds[..., :2, :]).sum(axis=3)
    votes = (choice[..., None, :] == np.arange(3)[:, None]).astype(np.float64)
    left = plan.are_left((*d.shape[:3], 1, len(low)), rng)
    return np.asarray(votes if left is None else votes * ~left, np.float64)


def fitted_together(votes: Array) -> Fitted:
    """Fit the scores of many studies.

    Parameters
    ----------
    votes : float64 (R, J, 3, C), of every pair of n items
    """
    has_tie = np.asarray(votes[:, :, 2].any(axis=(1, 2)))  # a study without a tie has no tie parameter
    kinds = np.flatnonzero(has_tie), np.flatnonzero(~has_tie)
    parts = [_fitted(votes[rows], has_tie=bool(has_tie[rows[0]])) for rows in kinds if len(rows)]
    back = np.argsort(np.concatenate(kinds))
    return Fitted(
        *(np.concatenate(columns)[back] for columns in zip(*(vars(part).values() for part in parts), strict=True))
    )


def _fitted(votes: Array, *, has_tie: bool) -> Fitted:
    """Fit the scores of studies that all have ties, or all have none."""
    n_studies, n_people, _, n_pairs = votes.shape
    model = DAVIDSON if has_tie else WITHOUT_TIES
    n = round((1 + np.sqrt(1 + 8 * n_pairs)) / 2)
    low, high = np.triu_indices(n, 1)
    nothing = np.zeros(n_pairs)
    design = Design(PairCounts(n, low, high, nothing, nothing, nothing), model, has_tie)
    table = votes.sum(axis=1)
    maximum = maximise(design, *(table[:, kind] for kind in range(3)), search=Search(runaway=RUNAWAY))
    d, t = design.predictors(np.where(maximum.converged[:, None], maximum.theta, 0.0))
    information = design.information(model.derivatives(d, t, *(table[:, kind] for kind in range(3))))
    inverse = np.asarray(np.linalg.pinv(information, hermitian=True), np.float64)
    by_person = model.derivatives(d[:, None], t[:, None], *(votes[:, :, kind] for kind in range(3)))
    slopes = np.broadcast_to(by_person.d, (n_studies, n_people, n_pairs))
    gradients = [slopes @ design.incidence.toarray()]
    if design.has_tie:
        gradients.append(np.broadcast_to(by_person.t, slopes.shape).sum(axis=2, keepdims=True))
    influence = np.concatenate(gradients, axis=2) @ inverse
    people = np.swapaxes(influence, 1, 2) @ influence * n_people / max(n_people - 1, 1)
    return Fitted(maximum.theta[:, :n], people[:, :n, :n], inverse[:, :n, :n], maximum.converged)


def contrast_p_values(fitted: Fitted, votes: Array, directions: Array) -> Array:
    """Return two-sided p-values of contrasts as the report's tests give them, float64 (R, K).

    With few participants, as `has_few_participants` tells, they are no surer than the votes. A study without a maximum
    has sign tests over participants of the pairs.

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
    n_free = fitted.scores.shape[1] - 1 + votes[:, :, 2].any(axis=(1, 2))
    is_few = (n_people < FEWEST_PARTICIPANTS) | (n_people <= n_free)
    of_votes = 2 * norm.sf(np.abs(value) / np.where(naive > 0, naive, 1.0))
    p_value = np.where(is_few[:, None], np.maximum(p_value, of_votes), p_value)
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

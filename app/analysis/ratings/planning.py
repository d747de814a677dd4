"""Plan a study in which films are rated, and simulate hundreds of such studies in one batch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from app.analysis.comparisons.power import planned
from app.analysis.comparisons.study_plan import PlannedStudy, Studies
from app.analysis.ratings.opinion_scores import means_with_errors
from app.study.planning import REPORTED, Claim
from ground.progress import Progress, no_progress

Array = NDArray[np.float64]

GRADES = 5  # from which careless people take one at random


@dataclass(frozen=True)
class RatingPlan(PlannedStudy):
    """A study in which every participant rates every condition on every dataset once.

    A hidden reference is a condition, too.

    Parameters
    ----------
    inconsistency : standard deviation of a participant's ratings around the qualities, grades
    """

    inconsistency: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.inconsistency < np.inf:
            raise ValueError(f"inconsistency is {self.inconsistency}, expected more than 0")

    @property
    def trials(self) -> int:
        """Number of films of each dataset."""
        return self.conditions

    def simulated(self, scores: Array, n_studies: int, rng: np.random.Generator) -> Studies:
        """Simulate ratings; the participants' biases, which cancel out in differences, are left out.

        Parameters
        ----------
        scores, n_studies, rng : as in `PlannedStudy.simulated`; float64 (n,), grades
        """
        ratings = self.shifted(scores, n_studies, rng)
        careless = self.are_careless(n_studies, rng)
        ratings += self.inconsistency * rng.standard_normal(ratings.shape)
        if careless is not None:
            clicked = rng.integers(1, GRADES + 1, ratings.shape)
            ratings = np.where(careless[..., None, None], clicked, ratings)
        left = self.are_left(ratings.shape, rng)
        return RatingStudies(ratings if left is None else np.where(left, np.nan, ratings))


@dataclass(frozen=True)
class RatingStudies:
    """Simulated studies by their ratings, float64 (R, J, D, n), NaN where a participant left before."""

    ratings: Array

    @property
    def scores(self) -> Array:
        """Mean ratings, float64 (R, n), grades."""
        return np.asarray(_means(self.ratings, axis=1).mean(axis=1))

    @property
    def has_scores(self) -> NDArray[np.bool_]:
        """Has every condition a rating? bool (R,)."""
        return np.asarray(~np.isnan(self.scores).any(axis=1))

    def p_values(self, directions: Array) -> Array:
        """Return p-values of paired t-tests over participants, directions float64 (K, n); float64 (R, K).

        A participant counts on the datasets on which all that is compared was rated, and every dataset counts alike.
        """
        columns = []
        for direction in directions:
            compared = np.flatnonzero(direction)
            mean, error, freedom = means_with_errors(self.ratings[..., compared] @ direction[compared])
            is_known = freedom > 0
            ratio = np.abs(mean) / np.where(is_known, error, 1.0)
            columns.append(np.where(is_known, 2 * student.sf(ratio, np.where(is_known, freedom, 1.0)), 1.0))
        return np.stack(columns, axis=1)

    def p_over_datasets(self) -> Array:
        """Return p-values of the first pair with datasets as a sample, float64 (R,)."""
        differences = self.ratings[..., 0] - self.ratings[..., 1]  # (R, J, D)
        of_people, of_datasets = _means(differences, axis=2), _means(differences, axis=1)
        people, datasets, cells = (_variance_of_mean(part) for part in (of_people, of_datasets, _flat(differences)))
        shared = np.maximum(people - cells, 0.0)
        n_people, n_datasets = differences.shape[1:]
        df = (datasets + shared) ** 2 / (datasets**2 / (n_datasets - 1) + shared**2 / (n_people - 1))
        ratio = np.abs(np.nanmean(of_datasets, axis=1)) / np.sqrt(datasets + shared)
        return np.asarray(2 * student.sf(ratio, df))


def _flat(differences: Array) -> Array:
    return differences.reshape(len(differences), -1)


def _means(values: Array, axis: int) -> Array:
    """Return means over what is there, NaN where nothing is."""
    there = ~np.isnan(values)
    n = there.sum(axis=axis)
    return np.where(n > 0, np.where(there, values, 0.0).sum(axis=axis) / np.maximum(n, 1), np.nan)


def _variance_of_mean(values: Array) -> Array:
    """Return the variance of means over the second axis, of what is there, float64 (R,)."""
    return np.asarray(np.nanvar(values, axis=1, ddof=1) / (~np.isnan(values)).sum(axis=1))


def plan_ratings(
    plan: RatingPlan,
    effect: float,
    rng: np.random.Generator | None = None,
    *,
    replicates: int = 400,
    progress: Progress = no_progress,
    claim: Claim = REPORTED,
) -> dict[str, Any]:
    """Return the plan of a study of ratings, as `planned`; effects and differences are in grades.

    Parameters
    ----------
    plan : the study
    effect : true difference of two conditions, grades
    rng : Generator; by default of a fixed seed
    replicates, progress, claim : as in `planned`
    """
    rng = np.random.default_rng(1) if rng is None else rng
    return planned(plan, rng, effect, replicates=replicates, progress=progress, claim=claim)

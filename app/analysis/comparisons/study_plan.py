"""Say who takes part in a study that is planned: how many, how far they differ, and who leaves or clicks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Studies(Protocol):
    """Simulated studies, R of n conditions, with what a report would say of them."""

    @property
    def scores(self) -> Array:
        """Scores, float64 (R, n)."""

    @property
    def has_scores(self) -> NDArray[np.bool_]:
        """Does each study have finite scores? bool (R,)."""

    def p_values(self, directions: Array) -> Array:
        """Return two-sided p-values of contrasts, directions float64 (K, n); float64 (R, K)."""

    def p_over_datasets(self) -> Array:
        """Return p-values of the first pair with datasets as a sample, float64 (R,)."""


@dataclass(frozen=True)
class StudySize:
    """Numbers of conditions, datasets and participants of a study."""

    conditions: int
    datasets: int
    participants: int

    def __post_init__(self) -> None:
        for name, fewest in (("conditions", 2), ("datasets", 1), ("participants", 2)):
            if getattr(self, name) < fewest:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {fewest} or more")


@dataclass(frozen=True)
class PlannedStudy(StudySize):
    """A study in which everybody judges everything on every dataset once, with the people who take part.

    Parameters
    ----------
    spread : standard deviation over participants of their opinion of a condition, log-odds, or grades where rated
    by_dataset : the same of an opinion on each dataset apart
    dataset_spread : standard deviation over datasets of a condition's score
    drop_out : share of the participants who leave half-way
    careless : share of the participants who answer at random
    """

    unit: ClassVar[float] = 1.0  # of effects, in the scores' unit

    spread: float = field(default=0.0, kw_only=True)
    by_dataset: float = field(default=0.0, kw_only=True)
    dataset_spread: float = field(default=0.0, kw_only=True)
    drop_out: float = field(default=0.0, kw_only=True)
    careless: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("spread", "by_dataset", "dataset_spread"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 0 or more")
        for name in ("drop_out", "careless"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 0 or more and less than 1")

    @property
    def trials(self) -> int:
        """Number of trials of a participant on each dataset."""
        raise NotImplementedError

    def simulated(self, scores: Array, n_studies: int, rng: np.random.Generator) -> Studies:
        """Simulate studies.

        Parameters
        ----------
        scores : float64 (n,), the true ones
        n_studies : R
        rng : Generator
        """
        raise NotImplementedError

    def shifted(self, scores: Array, n_studies: int, rng: np.random.Generator) -> Array:
        """Draw the scores of every participant on every dataset, float64 (R, J, D, n).

        Parameters
        ----------
        scores, n_studies, rng : as in `simulated`
        """
        shape = (n_studies, self.participants, self.datasets, self.conditions)
        shifted = np.broadcast_to(scores, shape).copy()
        for spread, size in (
            (self.spread, (*shape[:2], 1, shape[3])),
            (self.dataset_spread, (n_studies, 1, *shape[2:])),
            (self.by_dataset, shape),
        ):
            if spread:
                shifted += spread * rng.standard_normal(size)
        return shifted

    def are_careless(self, n_studies: int, rng: np.random.Generator) -> NDArray[np.bool_] | None:
        """Draw who answers at random, bool (R, J); None where nobody does."""
        return rng.random((n_studies, self.participants)) < self.careless if self.careless else None

    def are_left(self, shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.bool_] | None:
        """Draw which trials, (R, J, D, …), those who leave half-way do not answer; None where nobody leaves."""
        if not self.drop_out:
            return None
        leaves = rng.random((*shape[:2], *(1 for _ in shape[2:]))) < self.drop_out
        return np.asarray(leaves & (rng.random(shape) < 0.5))

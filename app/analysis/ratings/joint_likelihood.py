"""Weigh ratings and pair votes together: the likelihood of qualities that explain both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, hstack

from app.analysis.model.likelihood.ties import TIE_MODELS, WITHOUT_TIES, Derivatives, TieModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observations:
    """Ratings and votes with common numbers of items and participants.

    Parameters
    ----------
    items : the K items, each (dataset, condition)
    rating : float64 (R,)
    rated : intp (R,), the item of each rating
    rater : intp (R,), the participant of each rating
    difference : sparse (V, K), 1 at the first and -1 at the second item of each vote
    choice : int8 (V,), as in `VotesTable`
    count : float64 (V,), votes that each row stands for
    voter : intp (V,), the participant of each vote
    n_participants : number of different participants; 0 if they are not all known
    """

    items: tuple[tuple[str, str], ...]
    rating: Array
    rated: NDArray[np.intp]
    rater: NDArray[np.intp]
    difference: csr_array
    choice: NDArray[np.int8]
    count: Array
    voter: NDArray[np.intp]
    n_participants: int


@dataclass(frozen=True)
class JointLikelihood:
    """The joint log-likelihood of parameters theta: qualities (K,), k, log noise and, with ties, log nu."""

    seen: Observations
    rating: Array
    wins: Array
    losses: Array
    ties: Array

    @property
    def has_ties(self) -> bool:
        return bool(self.ties.any())

    @property
    def model(self) -> TieModel:
        """Davidson's model; without ties Bradley and Terry's, which it is then."""
        return TIE_MODELS["davidson"] if self.has_ties else WITHOUT_TIES

    def _split(self, theta: Array) -> tuple[Array, float, float, Array]:
        n = len(self.seen.items)
        log_nu = theta[n + 2 :] if self.has_ties else np.zeros(1)
        return theta[:n], float(theta[n]), float(theta[n + 1]), log_nu

    def of_votes(self, theta: Array) -> float:
        quality, slope, _, log_nu = self._split(theta)
        d = np.asarray(slope * (self.seen.difference @ quality))
        return float(self.model.loglik(d, log_nu, self.wins, self.losses, self.ties).sum())

    def value(self, theta: Array) -> float:
        quality, _, log_noise, _ = self._split(theta)
        residue = (self.rating - quality[self.seen.rated]) / np.exp(log_noise)
        return float(self.of_votes(theta) - len(residue) * (log_noise + np.log(2 * np.pi) / 2) - residue @ residue / 2)

    def parts(self, theta: Array) -> tuple[csr_array, csr_array]:
        """Return the gradient of each vote (V, M) and of each rating (R, M)."""
        quality, slope, log_noise, log_nu = self._split(theta)
        gap, vote = self._votes(quality, slope, log_nu)
        columns: list[Any] = [self.seen.difference * (slope * vote.d)[:, None]]
        columns += [csr_array(column[:, None]) for column in (vote.d * gap, np.zeros_like(gap))]
        columns += [csr_array(vote.t[:, None])] if self.has_ties else []
        residue = (self.rating - quality[self.seen.rated]) / np.exp(log_noise)
        n_ratings, n = len(residue), len(quality)
        rows = np.arange(n_ratings)
        ratings = csr_array(
            (
                np.r_[residue / np.exp(log_noise), residue**2 - 1],
                (np.tile(rows, 2), np.r_[self.seen.rated, np.full(n_ratings, n + 1)]),
            ),
            shape=(n_ratings, len(theta)),
        )
        return csr_array(hstack(columns)), ratings

    def _votes(self, quality: Array, slope: float, log_nu: Array) -> tuple[Array, Derivatives]:
        gap = np.asarray(self.seen.difference @ quality)
        d, t = slope * gap, np.broadcast_to(log_nu, gap.shape)
        return gap, self.model.derivatives(d, t, self.wins, self.losses, self.ties)

    def loss(self, theta: Array) -> float:
        return -self.value(theta)

    def loss_gradient(self, theta: Array) -> Array:
        votes, ratings = self.parts(theta)
        return -np.asarray(votes.sum(axis=0) + ratings.sum(axis=0), float)

    def information(self, theta: Array) -> Array:
        """Return the negative Hessian, float64 (M, M)."""
        quality, slope, log_noise, log_nu = self._split(theta)
        n, precision = len(quality), np.exp(-2 * log_noise)
        gap, vote = self._votes(quality, slope, log_nu)
        across = self.seen.difference
        result = np.zeros((len(theta), len(theta)))
        result[:n, :n] = slope**2 * (across.T @ (across * vote.dd[:, None])).toarray()
        result[:n, n] = across.T @ (slope * vote.dd * gap - vote.d)
        result[n, n] = vote.dd @ gap**2
        residue = self.rating - quality[self.seen.rated]
        result[np.arange(n), np.arange(n)] += precision * np.bincount(self.seen.rated, minlength=n)
        result[:n, n + 1] = 2 * precision * np.bincount(self.seen.rated, residue, minlength=n)
        result[n + 1, n + 1] = 2 * precision * (residue @ residue)
        if self.has_ties:
            result[:n, n + 2] = slope * (across.T @ vote.dt)
            result[n, n + 2] = vote.dt @ gap
            result[n + 2, n + 2] = vote.tt.sum()
        upper = np.triu(result, 1)
        return np.asarray(np.diag(np.diagonal(result)) + upper + upper.T)

"""Fit scores of Thurstone's Case V with pwcmp's prior on distances, which keeps those of unanimous pairs finite."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr

from app.analysis.model.contrasts import critical_value
from app.analysis.model.likelihood.counts import PairCounts, count_pairs
from app.analysis.model.likelihood.existence import ford
from app.analysis.model.likelihood.participant_errors import is_agreement
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.analysis.model.thurstone import LOG_DENSITY_AT_0
from app.analysis.reading.votes_table import VotesTable

Array = NDArray[np.float64]

MOST_ITEMS = 30  # every pair's distance is compared with every other's
GAMMA = 0.1  # of the paper: no distance is impossible, however unlike the others
FARTHEST = 6.0  # standard deviations; a search that goes beyond has no finite maximum
ALIKE = 1e-6  # standard deviations; participants who differ by less voted alike
MOST_PARTS = 100  # that are left out in turn for the error


class PriorScores(NamedTuple):
    """Scores and the limits of their 95 % intervals, each float64 (n,), standard deviations of a difference."""

    scores: Array
    low: Array | None
    high: Array | None


def fit_with_prior(votes: VotesTable) -> PriorScores | None:
    """Fit the scores of Thurstone's Case V with the prior on distances, ties as half a win.

    The intervals are by t on the jackknife over participants.

    Parameters
    ----------
    votes : VotesTable; every one of its items is fitted

    Returns
    -------
    PriorScores, with sum zero, without limits where fewer than two participants are known, they voted alike (NaN: on
    a single score), or the votes without one of them have no maximum; None with more than `MOST_ITEMS`, where votes do
    not link all items, and where no finite maximum exists

    Source
    ------
    Perez-Ortiz and Mantiuk (2017), "A practical guide and software for analysing pairwise comparison experiments",
    arXiv:1712.03686, section 8: the likelihood of each pair's votes is multiplied by the prior of its distance,
    P(d_ij) = sum over pairs kl of L_kl(d_ij) / (sum over pairs mn of L_kl(d_mn)) + 0.1,
    where L_kl(d) = Phi(d)^k Phi(-d)^(n - k) is the likelihood of k of the n votes on pair kl.
    Jackknife: Tukey (1958); in groups: Kott (2001).
    """
    scores = _fit(votes, np.zeros(len(votes.items)))
    if scores is None:
        return None
    people, who = np.unique(votes.participant, return_inverse=True)
    if not votes.has_participants or len(people) < 2:
        return PriorScores(scores, None, None)
    n_parts = min(len(people), MOST_PARTS)
    without = [_fit(votes.where(who % n_parts != part), scores) for part in range(n_parts)]
    known = [replicate for replicate in without if replicate is not None]
    error = np.sqrt((n_parts - 1) * np.var(known, axis=0)) if len(known) == n_parts else np.zeros(len(scores))
    if is_agreement(error < ALIKE, n_parts):
        return PriorScores(scores, None, None)
    half = np.where(error < ALIKE, np.nan, critical_value(n_parts) * error)
    return PriorScores(scores, scores - half, scores + half)


def _fit(votes: VotesTable, start: Array) -> Array | None:
    """Return the scores with sum zero, float64 (n,); None without a finite maximum near the start."""
    counts = count_pairs(votes)
    if counts.n_items > MOST_ITEMS or not len(counts.first) or ford(counts).status == "disconnected":
        return None
    posterior = _Posterior(counts)
    # Scores sum to zero by a small penalty, as in pwcmp: nothing else depends on their mean.
    optimum: Any = minimize(posterior.negative, start, jac=True, method="BFGS", options={"gtol": 1e-8, "maxiter": 1000})
    scores: Array = optimum.x - optimum.x.mean()
    is_finite = np.abs(scores[posterior.first] - scores[posterior.second]).max() < FARTHEST
    return scores if is_finite and np.abs(optimum.jac).max() < 1e-4 else None


class _Posterior:
    """The logarithm of likelihood times prior, as a function of the scores.

    A distance d is as likely as the votes of all pairs say: each pair has votes for both orders (k of n, and n - k
    of n), of which each says Phi(d)^k Phi(-d)^(n - k), normalised over the distances of all pairs. Unanimous votes
    say what they would with one vote for the other.
    """

    def __init__(self, counts: PairCounts) -> None:
        wins, losses, _ = TIE_MODELS["half"].counted(counts.wins, counts.losses, counts.ties)
        self.first = np.r_[counts.first, counts.second]
        self.second = np.r_[counts.second, counts.first]
        self.n_items = counts.n_items
        self.wins, self.losses = np.r_[wins, losses], np.r_[losses, wins]
        total = self.wins + self.losses
        self.k = np.where(self.wins == 0, 1, np.where(self.losses == 0, total - 1, self.wins))
        self.rest = total - self.k

    def negative(self, scores: Array) -> tuple[float, Array]:
        """Return the value, with the sign that a minimiser needs, and its gradient, float64 (n,)."""
        d = scores[self.first] - scores[self.second]
        log_win, log_loss = log_ndtr(d), log_ndtr(-d)
        log_density = LOG_DENSITY_AT_0 - d**2 / 2
        to_win, to_loss = np.exp(log_density - log_win), np.exp(log_density - log_loss)
        said = np.outer(log_win, self.k) + np.outer(log_loss, self.rest)  # of a distance, by the votes of a pair
        share = np.exp(said - said.max(axis=0))
        share /= share.sum(axis=0)
        prior = share.sum(axis=1) + GAMMA
        slope = np.outer(to_win, self.k) - np.outer(to_loss, self.rest)
        by_distance = self.wins * to_win - self.losses * to_loss
        by_distance += (share * slope * (1 / prior[:, None] - (1 / prior) @ share)).sum(axis=1)
        mean = scores.mean()
        value = self.wins @ log_win + self.losses @ log_loss + np.log(prior).sum() - mean**2
        gradient = np.bincount(self.first, by_distance, self.n_items).astype(np.float64)
        gradient -= np.bincount(self.second, by_distance, self.n_items) + 2 * mean / self.n_items
        return -float(value), -gradient

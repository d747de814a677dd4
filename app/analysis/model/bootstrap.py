"""Bootstrap confidence intervals of scores: participants, not votes, are drawn with replacement, and all replicates are
fitted in one batch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from app.analysis.model.bradley_terry import fit_counts, is_identified
from app.analysis.model.likelihood.counts import PairCounts, exchanged, outcome_index
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.newton import Design, Search, maximise
from app.analysis.model.likelihood.ties import TIE_MODELS, WITHOUT_TIES
from app.analysis.model.settings import LEVEL
from app.analysis.reading.votes_table import VotesTable

Array = NDArray[np.float64]

TOLERANCE = 1e-5  # log-odds, of the last step: leaves errors below 1e-9, far below the sampling error
RUNAWAY = 15.0  # log-odds beyond which a replicate may have no maximum and is fitted alone


@dataclass(frozen=True)
class Bootstrap:
    """Scores of the bootstrap replicates.

    Parameters
    ----------
    scores : float64 (R, n), log-odds, of the replicates that have a maximum
    kept : bool (R',), which of all replicates these are
    """

    scores: Array
    kept: NDArray[np.bool_]

    @property
    def n_without_maximum(self) -> int:
        """Number of replicates without a maximum, which are left out."""
        return int((~self.kept).sum())

    def has_percentiles(self, n_participants: int) -> bool:
        """Are there enough replicates for percentiles? Those without a maximum are missing extremes."""
        is_many = len(self.scores) >= fewest_replicates(n_participants)
        return is_many and self.n_without_maximum <= percentile_tail(n_participants) * len(self.kept)

    def interval(self, n_participants: int) -> Array:
        """Return the expanded 95 % percentile interval of each score, float64 (2, n), log-odds.

        The k-th of R replicates has k / (R + 1) of the distribution below it (Davison and Hinkley 1997, section 2.4).
        """
        tail = percentile_tail(n_participants)
        result: Array = np.quantile(self.scores, [tail, 1 - tail], axis=0, method="weibull")
        return result


def percentile_tail(n_participants: int) -> float:
    """Return the share of replicates beyond each end of a 95 % interval.

    Plain percentiles of J participants are too narrow: their spread is that of a sample of J divided by J, not J - 1,
    and they have the tails of a normal distribution. These reach as far as t(J - 1) does.

    Source
    ------
    Hesterberg (2015), "What teachers should know about the bootstrap", on the expanded percentile interval.
    """
    n = n_participants
    return float(norm.cdf(-np.sqrt(n / (n - 1)) * student.ppf((1 + LEVEL) / 2, n - 1)))


def fewest_replicates(n_participants: int) -> int:
    """Return how many replicates reach as far as the ends of an interval."""
    return math.ceil(1 / percentile_tail(n_participants)) - 1


def participant_weights(n_participants: int, n_replicates: int, rng: np.random.Generator) -> Array:
    """Draw how often each participant appears in each replicate.

    Parameters
    ----------
    n_participants : J
    n_replicates : R
    rng : Generator

    Returns
    -------
    float64 (R, J), rows sum to J
    """
    return rng.multinomial(n_participants, np.full(n_participants, 1 / n_participants), n_replicates).astype(np.float64)


def participant_counts(fit: Fit, votes: VotesTable) -> NDArray[np.float32]:
    """Count each participant's wins, losses and ties on the pairs of the fit.

    Returns
    -------
    float32 (J, 3 * C), votes, exact up to 2^24
    """
    counts, n = fit.counts, fit.counts.n_items
    first, second, outcome = outcome_index(votes, is_ordered=counts.is_ordered)
    if not counts.is_ordered:
        first, second, outcome = exchanged(first > second, first, second, outcome)
    pair_of = np.full((n, n), -1)
    pair_of[counts.first, counts.second] = np.arange(len(counts.first))
    pair = pair_of[first, second]
    kept = pair >= 0  # where ties are dropped, the fit has no pair that only has ties
    n_cells = 3 * len(counts.first)
    code = votes.participant[kept] * n_cells + outcome[kept] * len(counts.first) + pair[kept]
    table = np.bincount(code, votes.count[kept], len(votes.participants) * n_cells)
    return table.reshape(len(votes.participants), n_cells).astype(np.float32)


def bootstrap_scores(fit: Fit, votes: VotesTable, weights: Array) -> Bootstrap:
    """Fit the model again to every bootstrap replicate.

    Parameters
    ----------
    fit : Fit with status `ok`
    votes : VotesTable, the votes it was fitted to
    weights : float64 (R, J), how often each participant of the table was drawn
    """
    assert fit.theta is not None
    # Single precision is exact for counts and twice as fast; `maximise` goes on in double precision.
    drawn = cast(Array, weights.astype(np.float32) @ participant_counts(fit, votes))
    size = len(fit.counts.first)
    counted = TIE_MODELS[fit.ties].counted
    wins, losses, ties = counted(drawn[:, :size], drawn[:, size : 2 * size], drawn[:, 2 * size :])
    has_tie = ties.any(axis=1) if fit.design.has_tie else np.zeros(len(weights), bool)
    scores = np.empty((len(weights), len(fit.items)))
    is_there = np.empty(len(weights), bool)
    for rows, is_with in ((has_tie, True), (~has_tie, False)):
        if rows.any():
            table = wins[rows], losses[rows], ties[rows]
            scores[rows], is_there[rows] = _fit_batch(fit, *table, has_tie=is_with)
    return Bootstrap(scores[is_there], is_there)


def _fit_batch(fit: Fit, wins: Array, losses: Array, ties: Array, *, has_tie: bool) -> tuple[Array, NDArray[np.bool_]]:
    """Return the scores (R, n), and for each replicate whether a maximum exists (R,)."""
    assert fit.theta is not None
    design, start = fit.design, fit.theta
    if design.has_tie and not has_tie:
        design, start = Design(fit.counts, WITHOUT_TIES, has_tie=False, levels=design.levels), start[:-1]
    is_possible = _is_possible(design, wins + losses + ties > 0)
    if not is_possible.all():
        wins, losses, ties = wins[is_possible], losses[is_possible], ties[is_possible]
    scores = np.full((len(is_possible), len(fit.items)), np.nan)
    is_there = np.zeros(len(is_possible), bool)
    if is_possible.any():
        scores[is_possible], is_there[is_possible] = _fit_possible(fit, design, start, wins, losses, ties)
    return scores, is_there


def _is_possible(design: Design, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Do the pairs drawn in each replicate, bool (R, C), link all items? Few different sets of pairs are drawn."""
    result = np.ones(len(seen), bool)
    partial = np.flatnonzero(~seen.all(axis=1))
    if len(partial):
        patterns, which = np.unique(seen[partial], axis=0, return_inverse=True)
        result[partial] = np.array([is_identified(design, pattern) for pattern in patterns])[which]
    return result


def _fit_possible(
    fit: Fit, design: Design, start: Array, wins: Array, losses: Array, ties: Array
) -> tuple[Array, NDArray[np.bool_]]:
    maximum = maximise(design, wins, losses, ties, start=start, search=Search(TOLERANCE, RUNAWAY))
    effects = maximum.theta[:, : design.n_effects]
    scores = effects if design.levels is None else effects @ design.levels.T
    is_there = maximum.converged.copy()
    for replicate in np.flatnonzero(~maximum.converged):
        alone = _fit_alone(fit, wins[replicate], losses[replicate], ties[replicate])
        if alone is not None:
            scores[replicate], is_there[replicate] = alone, True
    return scores, is_there


def _fit_alone(fit: Fit, wins: Array, losses: Array, ties: Array) -> Array | None:
    seen = wins + losses + ties > 0
    first, second = fit.counts.first[seen], fit.counts.second[seen]
    table = wins[seen].astype(float), losses[seen].astype(float), ties[seen].astype(float)
    counts = PairCounts(fit.counts.n_items, first, second, *table, is_ordered=fit.counts.is_ordered)
    try:
        refit = fit_counts(counts, fit.items, ties=fit.ties, levels=fit.design.levels, penalty=None)
    except RuntimeError:  # no estimate converged
        return None
    return refit.scores if refit.status == "ok" else None

"""Fit scores by Thurstone's model, Case V: just-objectionable differences (JOD) as the field defines them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from app.analysis.model.bradley_terry import MANY_ITEMS
from app.analysis.model.likelihood.counts import PairCounts, count_pairs
from app.analysis.model.likelihood.existence import ford
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.newton import Design, maximise
from app.analysis.model.likelihood.participant_errors import participant_covariance
from app.analysis.model.likelihood.ties import TIE_MODELS, Derivatives, TieModel
from app.analysis.reading.votes_table import VotesTable

Array = NDArray[np.float64]

JOD = float(ndtri(0.75))  # standard deviations of a difference; 75 % prefer what is one JOD better
LOG_DENSITY_AT_0 = -0.5 * np.log(2 * np.pi)


def _probabilities(d: Array, t: Array) -> Array:  # noqa: ARG001 (one signature for all models)
    """Return P(win) = Phi(d), P(loss), and 0 for ties, float64 (3, …, C).

    Source
    ------
    Thurstone (1927), Case V.
    """
    return np.stack([ndtr(d), ndtr(-d), np.zeros_like(d)])


def _loglik(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Array:  # noqa: ARG001
    """Return the log-likelihood of each pair, float64 (…, C)."""
    result: Array = wins * log_ndtr(d) + losses * log_ndtr(-d)
    return result


def _derivatives(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Derivatives:  # noqa: ARG001
    """Return the derivatives in d; those in t are zero."""
    log_density = LOG_DENSITY_AT_0 - d**2 / 2
    to_win, to_loss = np.exp(log_density - log_ndtr(d)), np.exp(log_density - log_ndtr(-d))
    nothing = np.zeros_like(to_win)
    return Derivatives(
        d=wins * to_win - losses * to_loss,
        t=nothing,
        dd=wins * to_win * (to_win + d) + losses * to_loss * (to_loss - d),
        dt=nothing,
        tt=nothing,
    )


THURSTONE = TieModel(
    TIE_MODELS["half"].counted, _probabilities, _loglik, _derivatives, None, 0.0, is_canonical=False
)  # ties count as half a win each, as pwcmp does


def fit_thurstone(votes: VotesTable) -> Fit | None:
    """Fit the scores of Thurstone's Case V to votes by maximum likelihood, ties as half a win.

    Parameters
    ----------
    votes : VotesTable; every one of its items is fitted

    Returns
    -------
    Fit, in standard deviations of a difference, with its error clustered by participant; None where no finite maximum
    exists, and with more than `MANY_ITEMS`
    """
    counts = count_pairs(votes)
    wins, losses, ties = THURSTONE.counted(counts.wins, counts.losses, counts.ties)
    counts = PairCounts(counts.n_items, counts.first, counts.second, wins, losses, ties)
    if counts.n_items > MANY_ITEMS or ford(counts).status != "ok":
        return None
    design = Design(counts, THURSTONE, has_tie=False)
    maximum = maximise(design, wins[None], losses[None], ties[None])
    if not maximum.converged[0]:
        return None
    fit = Fit(votes.items, "half", "ok", (votes.items,), None, counts, design, maximum.theta[0])
    if not votes.has_participants:
        return fit
    return replace(fit, participant_covariance=participant_covariance(fit, votes), n_participants=votes.n_voters)

"""Fit scores in which everybody has a lapse rate: the share of answers that somebody gave without looking.

A lapse is a vote at random, without preference as often as the panel's. Nobody is left out: a participant's votes count
by how probable it is that they are no lapses. How rates vary over people is estimated with the scores, so that honest
people, of whom no vote looks like a lapse more often than others', are hardly weighted down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.bootstrap import participant_counts
from app.analysis.model.contrasts import critical_value
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.newton import Search, maximise
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.analysis.reading.votes_table import VotesTable

Array = NDArray[np.float64]

RATES = np.array([0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0])  # between which people's lapse rates lie
HONEST = 20.0  # honest people that are assumed beside those who took part
FEWEST_PEOPLE = 5  # fewer tell nothing about each other
MOST_CARELESS = 1 / 3  # of the people; more are camps that the model cannot tell from lapses
MOST_GROUPS = 60  # of participants, that the jackknife leaves out in turn
MOST_ROUNDS, TOLERANCE = 300, 1e-5  # of the EM algorithm; log-odds


@dataclass(frozen=True)
class Lapses:
    """Scores with careless answers weighted down.

    Parameters
    ----------
    scores, errors : float64 (n,), log-odds; the errors by the jackknife over participants, NaN where all agree exactly
    half : float64 (n,), half the width of the 95 % intervals, t(J - 1)
    people : intp (J,), the participants with votes that count, by their place in the table
    rates : float64 (J,), the lapse rate of each of them; mean of what is likely given the votes
    """

    scores: Array
    errors: Array
    half: Array
    people: NDArray[np.intp]
    rates: Array


def fit_lapses(fit: Fit, votes: VotesTable) -> Lapses | str:
    """Fit scores and lapse rates to votes; a sentence why not where they cannot be fitted.

    Parameters
    ----------
    fit : Fit of the same votes without lapses
    votes : VotesTable

    Source
    ------
    Lapse rates as in psychophysics: Wichmann and Hill (2001); distribution of the rates by nonparametric maximum
    likelihood: Laird (1978).
    """
    if fit.status != "ok" or fit.theta is None or fit.design.levels is not None:
        return "the scores have no finite estimate"
    counts = participant_counts(fit, votes).astype(np.float64).reshape(len(votes.participants), 3, -1)
    mine = np.stack(TIE_MODELS[fit.ties].counted(*np.moveaxis(counts, 1, 0)), axis=1)  # (J, 3, C)
    people = np.flatnonzero(mine.any(axis=(1, 2)))
    mine, n_people = mine[people], len(people)
    if n_people < FEWEST_PEOPLE:
        return f"they need {FEWEST_PEOPLE} participants or more"
    n_groups = min(n_people, MOST_GROUPS)
    group = np.arange(n_people) * n_groups // n_people
    kept = np.vstack([np.ones(n_people), np.arange(n_groups)[:, None] != group])  # everybody, then without a group
    theta, posterior = _maximum(fit, mine, kept)
    if not np.isfinite(theta).all():
        return "with them the scores have no finite estimate"
    rates = posterior[0] @ RATES
    if np.mean(rates >= 0.5) > MOST_CARELESS:
        return f"they would take {(rates >= 0.5).sum()} of {n_people} people for careless, whose opinions differ rather"
    n = fit.design.n_effects
    without = theta[1:, :n]
    errors = np.sqrt((n_groups - 1) / n_groups * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    is_agreed = [fit.error(item, by_participant=True) is None for item in range(n)]
    errors = np.where(is_agreed, np.nan, errors)
    return Lapses(theta[0, :n], errors, critical_value(n_groups) * errors, people, rates)


def _maximum(fit: Fit, mine: Array, kept: Array) -> tuple[Array, Array]:
    """Return the parameters (B, P) and what is likely of each participant's rate, (B, J, K), of B sets of participants.

    Parameters
    ----------
    fit : Fit, where to start
    mine : float64 (J, 3, C), votes of each participant
    kept : float64 (B, J), 1 for those who count
    """
    design, model = fit.design, fit.design.model
    n_people, flat = len(mine), mine.reshape(len(mine), -1)
    ties = float(mine[:, 2].sum() / mine.sum()) if design.has_tie else 0.0
    at_random = np.array([(1 - ties) / 2, (1 - ties) / 2, ties])[:, None]
    honest = np.zeros(len(RATES))
    honest[0] = HONEST
    shares = np.full((len(kept), len(RATES)), 1 / len(RATES))
    theta = np.tile(np.asarray(fit.theta), (len(kept), 1))
    posterior = np.zeros((len(kept), n_people, len(RATES)))
    for _ in range(MOST_ROUNDS):
        p = np.moveaxis(model.probabilities(*design.predictors(theta)), 0, 1)  # (B, 3, C)
        looked = (1 - RATES)[:, None, None] * p[:, None]  # (B, K, 3, C)
        mixed = looked + RATES[:, None, None] * at_random
        logliks = flat @ np.log(np.maximum(mixed, 1e-300)).reshape(len(kept), len(RATES), -1).swapaxes(1, 2)
        logliks += np.log(shares)[:, None]
        posterior = np.exp(logliks - logliks.max(axis=2, keepdims=True))
        posterior *= kept[..., None] / posterior.sum(axis=2, keepdims=True)
        shares = posterior.sum(axis=1) + honest + 1e-9
        shares /= shares.sum(axis=1, keepdims=True)
        votes = (posterior.swapaxes(1, 2) @ flat).reshape(looked.shape)
        weighted = (votes * looked / np.maximum(mixed, 1e-300)).sum(axis=1)  # (B, 3, C)
        maximum = maximise(design, *np.moveaxis(weighted, 1, 0), start=theta, search=Search(tolerance=TOLERANCE))
        if not maximum.converged.all():
            return np.full_like(theta, np.nan), posterior
        before, theta = theta, maximum.theta
        if np.abs(theta - before).max() < TOLERANCE:
            break
    return theta, posterior

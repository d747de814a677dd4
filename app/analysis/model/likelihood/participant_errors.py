"""Estimate the errors of a fit with participants, not votes, as the sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.likelihood.counts import PairCounts, outcome_index
from app.analysis.model.likelihood.fit import ALIKE, CERTAIN, Fit
from app.analysis.model.likelihood.newton import Design
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.analysis.reading.votes_table import VotesTable, numbered

Array = NDArray[np.float64]

ROWS_TOGETHER = 1_000_000  # votes looked up at once, which bounds the memory


def participant_covariance(fit: Fit, votes: VotesTable) -> Array | None:
    """Return the covariance of the parameters with participants as the independent units.

    It is the sandwich: inverse information x sum of outer products of the participants' gradients x inverse
    information, times J / (J - 1).

    Returns
    -------
    covariance : float64 (P, P), with a variance of zero where participants agree exactly; None with a single
        participant, without a covariance to start from, or where `is_agreement`

    Source
    ------
    Liang and Zeger (1986).
    """
    if fit.covariance is None:
        return None
    gradients = participant_gradients(fit, votes)
    n = len(gradients)
    if n < 2:
        return None
    influence = gradients @ fit.covariance  # (J, P)
    result: Array = influence.T @ influence * n / (n - 1)
    is_alike = np.diag(result) <= ALIKE * np.diag(fit.covariance)
    return None if is_agreement(is_alike[: fit.design.n_effects], n) else result


def is_agreement(is_alike: NDArray[np.bool_], n_participants: int) -> bool:
    """Do scores say nothing of other people, as none varies between participants, or of two people not all do?

    Parameters
    ----------
    is_alike : bool (n,), do participants agree on a score exactly?
    n_participants : their number
    """
    return bool(is_alike.all() or (n_participants == 2 and is_alike.any()))


def participant_gradients(fit: Fit, votes: VotesTable) -> Array:
    """Return each participant's part of the gradient at the maximum, float64 (J, P), for participants with votes.

    A vote's part depends on its pair and outcome alone, and is looked up.
    """
    design, n = fit.design, fit.counts.n_items
    by_d, by_t = _slopes(fit)
    people, who = numbered(votes.participant, len(votes.participants))
    size = len(people)
    scores, sums_d, sums_t = np.zeros(size * n), np.zeros(size), np.zeros(size)
    for start in range(0, len(votes), ROWS_TOGETHER):
        rows = slice(start, start + ROWS_TOGETHER)
        first, second, outcome = outcome_index(votes.where(rows), is_ordered=design.has_order)
        place, person = (outcome * n + first) * n + second, who[rows]
        slope = by_d[place] * votes.count[rows]
        scores += np.bincount(person * n + first, slope, size * n) - np.bincount(person * n + second, slope, size * n)
        sums_d += np.bincount(person, slope, size)
        sums_t += (
            np.bincount(person, by_t[place] * votes.count[rows], size) if design.has_tie or design.has_order else 0
        )
    columns = [scores.reshape(size, n) if design.levels is None else scores.reshape(size, n) @ design.levels]
    if design.has_order:
        columns.append((sums_d + design.model.order_in_t * sums_t)[:, None])
    if design.has_tie:
        columns.append(sums_t[:, None])
    return np.concatenate(columns, axis=1)


def _slopes(fit: Fit) -> tuple[Array, Array]:
    """Return the slopes in d and t of a vote's log-likelihood, float64 (3 n n,), by outcome, first and second item."""
    assert fit.theta is not None
    n, design = fit.counts.n_items, fit.design
    first, second = (index.ravel() for index in np.indices((n, n)))
    nothing = np.zeros(n * n)
    every = Design(
        PairCounts(n, first, second, nothing, nothing, nothing, design.has_order),
        design.model,
        design.has_tie,
        design.levels,
    )
    d, t = every.predictors(fit.theta[None])
    single = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n * n))  # which outcome, by outcome
    d = np.clip(d, -CERTAIN, CERTAIN)  # of pairs that nobody compared, and that no vote looks up
    slopes = design.model.derivatives(d, t, *TIE_MODELS[fit.ties].counted(*single))
    return np.ravel(slopes.d), np.ravel(np.broadcast_to(slopes.t, slopes.d.shape))

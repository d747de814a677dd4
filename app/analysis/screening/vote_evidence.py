"""Weigh how much likelier somebody's votes are from a coin than from the scores of all others.

Honest people have opinions of their own around those scores; how far opinions differ is told by the panel itself.
Where conditions hardly differ, honest votes look like random ones, and then votes say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.bradley_terry import fit_counts
from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.reading.votes_table import NONE, VotesTable, only_compared

Array = NDArray[np.float64]

FEWEST = 10  # decided votes of a participant, on average; fewer do not tell how far opinions differ
FEWEST_DRAWS = 60  # honest people whose votes a participant's are compared with
SIMULATED = 1000  # careless people, who tell how often honest ones look like them
TOGETHER = 1_000_000  # logits at once
WORK = 40_000_000  # participants times draws times cells, a second
MOST_ITEMS = 60  # above, a person's opinions have more dimensions than draws can follow
MEDIAN = 0.87  # of a chi-square with five degrees of freedom, in units of its mean
NOISE = 0.2  # standard deviation of the logarithm of somebody's own noise
FEW = 8.0  # people, of whom the estimate of how far opinions differ has half its value again as error
MOST_UNKNOWN = 0.16  # up to which the variance of opinions is taken to be a standard error larger than it is found
LEAST_SPREAD = 0.2  # log-odds, of honest opinions, also where the votes show none
LEAST_APART = 0.15  # log-odds; datasets whose scores differ by less are taken together
DISSENTERS, DISSENT = 0.05, 2.0  # share of honest people with opinions that lie so many times farther apart


@dataclass(frozen=True)
class Panel:
    """The decided votes of J participants on cells: pairs, on datasets apart where these differ.

    Parameters
    ----------
    wins, losses : float64 (J, C), for the first and the second item of a cell
    incidence : float64 (C, n), +1 for the first and -1 for the second item
    dataset : intp (C,)
    shown : float64 (C,), +1 where the first item was shown first, -1 where the second, 0 where it is unknown
    """

    wins: Array
    losses: Array
    incidence: Array
    dataset: NDArray[np.intp]
    shown: Array


def panel_of(votes: VotesTable, who: NDArray[np.intp], n_people: int, order_effect: float | None) -> Panel | None:
    """Count the decided votes; None with too few people or votes, or too many items to follow.

    Parameters
    ----------
    votes : VotesTable of N votes
    who : intp (N,), number of each vote's participant
    n_people : J
    order_effect : as in `careless_answers`
    """
    decided = votes.choice != NONE
    if n_people < 3 or votes.count[decided].sum() < FEWEST * n_people or len(votes.items) > 4 * MOST_ITEMS:
        return None
    rows = votes.where(decided)
    compared = only_compared(rows)
    n = len(compared.items)
    if n > MOST_ITEMS:
        return None
    low_first = compared.item_a < compared.item_b
    place = rows.dataset.astype(np.int64) * n * n + compared.pair
    shown = np.zeros(len(rows))
    if order_effect is not None:
        shown = np.where(rows.first_shown < 0, 0.0, np.where((rows.first_shown == 0) == low_first, 1.0, -1.0))
    codes, cell = np.unique(place * 3 + (shown + 1).astype(np.int64), return_inverse=True)
    size = n_people * len(codes)
    unit = who[decided] * len(codes) + cell
    wins, losses = (
        np.bincount(unit, (compared.prefers_lower == side) * rows.count, size).reshape(n_people, -1).astype(np.float64)
        for side in (True, False)
    )
    pair, dataset = codes // 3 % (n * n), codes // 3 // (n * n)
    incidence = np.eye(n)[pair // n] - np.eye(n)[pair % n]
    return Panel(wins, losses, incidence, dataset.astype(np.intp), codes % 3 - 1.0)


def against_scores(
    panel: Panel, order_effect: float, kept: NDArray[np.bool_], rng: np.random.Generator, n_draws: int
) -> tuple[Array, Array] | None:
    """Return the log likelihood ratios of votes, of participants (J,) and of people who vote at random (M,).

    Honest people have opinions of their own around the scores of all others, noise of their own, and may be far from
    the others; careless ones throw a coin.

    Parameters
    ----------
    panel : Panel of J participants
    order_effect : advantage of being shown first, log-odds
    kept : bool (J,), those who tell what honest people do
    rng : Generator
    n_draws : honest people whose votes a participant's are compared with
    """
    n_people, n_cells = panel.wins.shape
    n_draws = int(np.clip(WORK // max(n_people * n_cells, 1), FEWEST_DRAWS, n_draws))
    honest = _honest_scores(panel, order_effect, kept)
    if honest is None:
        return None
    scores, spread, covariance = honest  # (J, D, n), log-odds, (n, n)
    if scores.shape[1] == 1:
        panel = _on_one_dataset(panel)
    n = panel.incidence.shape[1]
    roots = _root(covariance)
    is_far = np.arange(n_draws) % 4 == 0  # more draws than dissenters: their likelihood needs as many
    apart = spread * np.where(is_far, DISSENT, 1.0)[:, None] * rng.standard_normal((n_draws, n))
    opinions = apart + rng.standard_normal((n_draws, n)) @ roots
    shifts = (opinions @ panel.incidence.T).astype(np.float32)
    noise = np.exp(NOISE * rng.standard_normal(n_draws)).astype(np.float32)[:, None]
    shift = order_effect * panel.shown
    centres = (np.einsum("jcn,cn->jc", scores[:, panel.dataset], panel.incidence) + shift).astype(np.float32)
    votes = panel.wins + panel.losses
    size = max(1, TOGETHER // shifts.size)
    of_votes = np.empty((n_people, n_draws))
    for start in range(0, n_people, size):
        rows = slice(start, start + size)
        logits = noise * (centres[rows, None] + shifts)
        of_votes[rows] = _loglik(logits, panel.wins[rows], votes[rows])
    design = votes[rng.integers(0, n_people, SIMULATED)]
    clicks = rng.binomial(design.astype(np.int64), 0.5).astype(np.float64)
    of_clicks = _loglik(noise * (centres.mean(axis=0) + shifts), clicks, design)
    return _coin(votes) - _mixed(of_votes, is_far), _coin(design) - _mixed(of_clicks, is_far)


def _mixed(logliks: Array, is_far: NDArray[np.bool_]) -> Array:
    """Return the log-likelihood of honest people, of whom some dissent, float64 (M,)."""
    near, far = _mean(logliks[:, ~is_far]), _mean(logliks[:, is_far])
    return np.asarray(np.logaddexp(np.log1p(-DISSENTERS) + near, np.log(DISSENTERS) + far))


def _coin(votes: Array) -> Array:
    return np.asarray(-np.log(2) * votes.sum(axis=1))


def _mean(logliks: Array) -> Array:
    """Return the logarithm of the mean likelihood over draws, float64 (M,)."""
    most = logliks.max(axis=1, keepdims=True)
    return np.asarray(most[:, 0] + np.log(np.exp(logliks - most).mean(axis=1)))


def _on_one_dataset(panel: Panel) -> Panel:
    """Return the votes of all datasets together."""
    kinds, cell = np.unique(np.c_[panel.incidence, panel.shown], axis=0, return_inverse=True)
    member = np.eye(len(kinds))[cell.ravel()]
    return Panel(panel.wins @ member, panel.losses @ member, kinds[:, :-1], np.zeros(len(kinds), np.intp), kinds[:, -1])


def _loglik(logits: NDArray[np.float32], wins: Array, votes: Array) -> Array:
    """Return the log-likelihood of each participant's votes (M, C) under each draw, float64 (M, K).

    Parameters
    ----------
    logits : float32 (K, C), or (M, K, C), of the first item of each cell
    """
    near = np.clip(logits, -30, 30)
    lost = np.log(1 + np.exp(near))
    if near.ndim == 2:
        result = wins.astype(np.float32) @ near.T - votes.astype(np.float32) @ lost.T
    else:
        result = (near @ wins.astype(np.float32)[..., None] - lost @ votes.astype(np.float32)[..., None])[..., 0]
    return np.asarray(result, np.float64)


def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _honest_scores(panel: Panel, order_effect: float, kept: NDArray[np.bool_]) -> tuple[Array, float, Array] | None:
    """Return the scores of all others for each participant, how far opinions differ, and the scores' covariance.

    Opinions differ by as much as the participants' gradients vary beyond their own noise (a moment estimate); datasets
    shift the scores by as much as theirs do. Each participant is left out by a Newton step.

    Returns
    -------
    scores : float64 (J, D, n), log-odds; (J, 1, n) where datasets hardly differ
    spread : standard deviation, log-odds
    covariance : float64 (n, n)
    """
    fitted = _scores(panel, kept)
    if fitted is None:
        return None
    n_people, n = len(panel.wins), panel.incidence.shape[1]
    votes = panel.wins + panel.losses
    p = 1 / (1 + np.exp(-(panel.incidence @ fitted + order_effect * panel.shown)))
    residual = panel.wins - votes * p  # (J, C)
    weight = votes * (p * (1 - p))
    outer = (panel.incidence[:, :, None] * panel.incidence[:, None]).reshape(len(p), -1)
    of_people = (weight @ outer).reshape(n_people, n, n)
    gradients = residual @ panel.incidence
    information = of_people[kept].sum(axis=0)
    inverse, rank, n_kept = np.linalg.pinv(information, hermitian=True), n - 1, int(kept.sum())
    excess = _excess if not kept.all() else _typical_excess  # before careless people are left out, by the median
    error = np.sqrt(2 * rank / n_kept) / max(_gain(of_people[kept], inverse), 1e-9)
    spread = np.sqrt(excess(gradients[kept], of_people[kept], inverse, rank) + min(error, MOST_UNKNOWN))
    influence = gradients @ inverse
    covariance = influence[kept].T @ influence[kept] * n_kept / max(n_kept - 1, 1)
    n_datasets = int(panel.dataset.max()) + 1
    member = np.eye(n_datasets)[panel.dataset]  # (C, D)
    by_dataset = np.einsum("jc,cd,cn->jdn", residual, member, panel.incidence, optimize=True)
    of_datasets = np.einsum("c,cd,cx->dx", weight[kept].sum(axis=0), member, outer, optimize=True).reshape(-1, n, n)
    together = by_dataset[kept].sum(axis=0)
    apart = _excess(together, of_datasets, inverse, rank) if n_datasets > 1 else 0.0
    without = kept[:, None] * 1.0
    scores = (fitted - without * influence * n_kept / max(n_kept - 1, 1))[:, None]
    if apart > LEAST_APART**2:
        scores = np.repeat(scores, n_datasets, axis=1)
        shrunk = np.linalg.inv(of_datasets + np.eye(n) / apart)
        scores = scores + np.einsum("dnm,jdm->jdn", shrunk, together - without[:, :, None] * by_dataset)
    spread = max(float(spread), LEAST_SPREAD) * np.sqrt(1 + (FEW / n_kept) ** 2)  # which few people hardly tell
    return scores, spread, covariance


def _excess(gradients: Array, information: Array, inverse: Array, rank: int) -> float:
    """Return the variance of shifts that make gradients (G, n) vary more than their information (G, n, n) says."""
    expected = rank * (1 - 1 / len(gradients))
    observed = float(np.einsum("gi,ij,gj->", gradients, inverse, gradients))
    gain = _gain(information, inverse)
    return max(observed - expected, 0.0) / gain if gain > 0 else 0.0


def _gain(information: Array, inverse: Array) -> float:
    """Return by how much gradients vary more for a unit of their shifts' variance."""
    return float(np.einsum("ij,gjk,gki->", inverse, information, information, optimize=True))


def _typical_excess(gradients: Array, information: Array, inverse: Array, rank: int) -> float:
    """Return `_excess` by the median over gradients, which a few that are unlike the others do not move."""
    observed = float(np.median(np.einsum("gi,ij,gj->g", gradients, inverse, gradients))) / MEDIAN * len(gradients)
    gain = _gain(information, inverse)
    return max(observed - rank * (1 - 1 / len(gradients)), 0.0) / gain if gain > 0 else 0.0


def _scores(panel: Panel, kept: NDArray[np.bool_]) -> Array | None:
    """Fit the decided votes of some participants, float64 (n,), log-odds; None where no vote links the items."""
    n = panel.incidence.shape[1]
    first, second = panel.incidence.argmax(axis=1), panel.incidence.argmin(axis=1)
    wins, losses = (
        np.bincount(first * n + second, part[kept].sum(axis=0), n * n).reshape(n, n).astype(np.float64)
        for part in (panel.wins, panel.losses)
    )
    low, high = np.nonzero(wins + losses)
    counts = PairCounts(n, low, high, wins[low, high], losses[low, high], np.zeros(len(low)))
    try:
        fit = fit_counts(counts, tuple(map(str, range(n))), ties="drop")
    except RuntimeError:  # no estimate converged
        return None
    return fit.scores

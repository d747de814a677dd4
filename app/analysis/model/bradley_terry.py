"""Fit scores with the Bradley-Terry model: maximum likelihood with ties and order effect; standard errors take
participants, not votes, as the sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.likelihood.conjugate_gradients import maximise_many_items
from app.analysis.model.likelihood.counts import PairCounts, count_pairs
from app.analysis.model.likelihood.existence import Existence, ford, recession
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.newton import Design, Search, maximise
from app.analysis.model.likelihood.participant_errors import participant_covariance
from app.analysis.model.likelihood.penalised import maximise_firth
from app.analysis.model.likelihood.ties import TIE_MODELS, WITHOUT_TIES, TieModel
from app.analysis.reading.votes_table import VotesTable

Array = NDArray[np.float64]

MANY_ITEMS = 100  # above, Newton's steps are cheaper by conjugate gradients
LARGEST_FIRTH = 300  # parameters; each step inverts a matrix
RIDGE = 0.1  # penalty where Firth's correction does not apply (Rao-Kupper, many parameters)


def fit_scores(
    votes: VotesTable,
    *,
    ties: str = "davidson",
    order_effect: bool = False,
    levels: Array | None = None,
    penalty: str = "firth",
) -> Fit:
    """Fit scores to votes by maximum likelihood.

    Parameters
    ----------
    votes : VotesTable; every one of its items is fitted, so leave out the others with `only_compared`
    ties : key of `TIE_MODELS`
    order_effect : add the advantage of the item shown first
    levels : float64 (n, q), makes the items' scores `levels @ effects`
    penalty : the estimate where no maximum exists: `firth`, or `ridge`, which also replaces Firth's with Rao and
        Kupper's ties and with very many parameters

    Returns
    -------
    Fit, whose `status` names every way in which a maximum can fail to exist

    Raises
    ------
    RuntimeError
        If the maximum exists and Newton's method did not reach it.

    Source
    ------
    Bradley and Terry (1952); Davidson (1970); Davidson and Beaver (1977); Rao and Kupper (1967).
    """
    fit = fit_pairs(votes, ties=ties, order_effect=order_effect, levels=levels, penalty=penalty)
    if fit.theta is None or not votes.has_participants:
        return fit
    sandwich = None if fit.penalty else participant_covariance(fit, votes)
    return replace(fit, participant_covariance=sandwich, n_participants=votes.n_voters)


def fit_pairs(
    votes: VotesTable,
    *,
    ties: str = "davidson",
    order_effect: bool = False,
    levels: Array | None = None,
    penalty: str = "firth",
) -> Fit:
    """Fit scores as `fit_scores` does, without what is known about participants.

    Parameters
    ----------
    votes, ties, order_effect, levels, penalty : as in `fit_scores`
    """
    counts = _counted(count_pairs(votes, is_ordered=order_effect), TIE_MODELS[ties])
    return fit_counts(counts, votes.items, ties=ties, levels=levels, penalty=penalty)


def fit_counts(
    counts: PairCounts, items: tuple[str, ...], *, ties: str, levels: Array | None = None, penalty: str | None = "firth"
) -> Fit:
    """Fit scores to counts, as `fit_scores` does to votes; without participants.

    Parameters
    ----------
    counts : PairCounts, after `TieModel.counted`
    items : names of the items
    ties : key of `TIE_MODELS`
    levels : float64 (n, q), makes the items' scores `levels @ effects`
    penalty : the estimate where no maximum exists; None: no numbers then
    """
    has_tie = bool(TIE_MODELS[ties].parameter and counts.ties.any())
    design = Design(counts, TIE_MODELS[ties] if has_tie else WITHOUT_TIES, has_tie, levels)
    existence, is_certain = _existence(counts, design)
    fit = Fit(items, ties, existence.status, _named(existence, items), None, counts=counts, design=design)
    if existence.status == "disconnected":
        return fit
    if existence.status == "separated":
        return _penalised(fit, penalty)
    return _maximum(fit, penalty, is_certain=is_certain)


def _counted(counts: PairCounts, model: TieModel) -> PairCounts:
    wins, losses, ties = model.counted(counts.wins, counts.losses, counts.ties)
    seen = wins + losses + ties > 0
    return PairCounts(
        counts.n_items, counts.first[seen], counts.second[seen], wins[seen], losses[seen], ties[seen], counts.is_ordered
    )


def _named(existence: Existence, items: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(items[index] for index in group) for group in existence.groups)


def _existence(counts: PairCounts, design: Design) -> tuple[Existence, bool]:
    """Return the status of the maximum, and whether it was proved."""
    n = counts.n_items
    if not design.n_parameters:
        return Existence("ok", (tuple(range(n)),)), True
    graph = ford(counts)
    if design.levels is None and graph.status == "disconnected":
        return graph, True
    both_ways = (counts.wins > 0) & (counts.losses > 0)
    if design.levels is not None or design.has_order:
        if both_ways.any() and is_identified(design, both_ways):  # what went both ways cannot grow without limit
            return Existence("ok", (tuple(range(n)),)), True
        if not is_identified(design):
            return Existence("disconnected", (tuple(range(n)),)), True
    if design.levels is None and graph.status == "separated":
        return graph, True
    if design.levels is None and not design.has_order and (both_ways.any() or not design.has_tie):
        return graph, True
    tie_effects = design.tie_effects if design.has_tie else None
    is_checked, direction = recession(counts, design.effects, tie_effects, n_scores=design.n_effects)
    if direction is None:
        return Existence("ok", (tuple(range(n)),)), is_checked
    scores = direction[: design.n_effects]
    return Existence("separated", _by_direction(scores if design.levels is None else design.levels @ scores)), True


def is_identified(design: Design, seen: NDArray[np.bool_] | None = None) -> bool:
    """Do the pairs tell the scores (or effects) and the order effect apart?

    Parameters
    ----------
    seen : bool (C,), the pairs that have votes; all by default
    """
    if not design.n_parameters:
        return True
    effects = design.effects if seen is None else design.effects[np.flatnonzero(seen)]
    gram = (effects.T @ effects).toarray()
    n_wanted = design.n_free - design.has_tie
    return bool(np.linalg.matrix_rank(gram, hermitian=True) == n_wanted)


def _by_direction(direction: Array) -> tuple[tuple[int, ...], ...]:
    rounded = np.round(direction, 6)
    return tuple(tuple(np.flatnonzero(rounded == value).tolist()) for value in np.unique(rounded)[::-1])


def _maximum(fit: Fit, penalty: str | None, *, is_certain: bool) -> Fit:
    counts, design = fit.counts, fit.design
    table = counts.wins, counts.losses, counts.ties
    if not design.n_parameters:
        return _described(fit, np.zeros(0), 0)
    if _is_for_gradients(design):
        maximum = maximise_many_items(design, *table)
    else:
        maximum = maximise(design, *(part[None] for part in table))
    if not maximum.converged[0]:
        if not is_certain:
            return _penalised(replace(fit, status="separated"), penalty)
        raise RuntimeError(
            f"the scores of {len(fit.items)} items did not converge in {maximum.iterations} iterations "
            "although a maximum exists"
        )
    return _described(fit, maximum.theta[0], maximum.iterations)


def _is_for_gradients(design: Design) -> bool:
    return design.counts.n_items > MANY_ITEMS and design.levels is None and not design.has_order


def _penalised(fit: Fit, penalty: str | None) -> Fit:
    if penalty is None:
        return fit
    counts, design = fit.counts, fit.design
    if penalty == "firth" and design.model.is_canonical and design.n_parameters <= LARGEST_FIRTH:
        theta, iterations = maximise_firth(design, counts)
        return _described(replace(fit, penalty="firth"), theta, iterations)
    table = counts.wins, counts.losses, counts.ties
    if _is_for_gradients(design):
        maximum = maximise_many_items(design, *table, ridge=RIDGE)
    else:
        maximum = maximise(design, *(part[None] for part in table), search=Search(ridge=RIDGE))
    return _described(replace(fit, penalty=f"ridge {RIDGE}"), maximum.theta[0], maximum.iterations)


def _described(fit: Fit, theta: Array, iterations: int) -> Fit:
    """Add the parameters, shifting scores to sum exactly to zero."""
    n = fit.design.n_effects
    shift = theta[:n].mean() if fit.design.levels is None else 0.0  # effects of factors keep their zero
    return replace(fit, theta=np.r_[theta[:n] - shift, theta[n:]], iterations=iterations)

"""Check before every fit that the likelihood has a unique finite maximum.

Ford's condition: every item must be reachable from every other along "was preferred to at least once"; a tie counts
both ways. With a tie parameter, an order effect or factors, the likelihood can grow without end in more directions; a
linear programme then looks for such a direction.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from graphlib import TopologicalSorter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components

from app.analysis.model.likelihood.counts import PairCounts

Array = NDArray[np.float64]

DENSE_ITEMS = 3000  # for a matrix of who beats whom, 9 MB
GLANCES = 4
LARGEST_PROGRAMME = 200_000  # constraints times parameters; HiGHS takes about a second here


@dataclass(frozen=True)
class Existence:
    """Result of the check for a unique finite maximum.

    Parameters
    ----------
    status : `ok`, `separated` or `disconnected`
    groups : indices of items: one group of all if `ok`; islands without a vote between them if `disconnected`; if
        `separated`, groups in descending order between which all votes, or all but ties, go one way
    """

    status: str
    groups: tuple[tuple[int, ...], ...]


def ford(counts: PairCounts) -> Existence:
    """Check Ford's condition on a table of counts.

    Source
    ------
    Ford (1957), "Solution of a ranking problem from binary comparisons"; ties after Davidson (1970).
    """
    n = counts.n_items
    if _is_strong_at_a_glance(counts):
        return Existence("ok", (tuple(range(n)),))
    beaten, winner = _edges(counts)
    graph = csr_array(coo_array((np.ones(len(winner)), (winner, beaten)), shape=(n, n)))
    n_islands, island = connected_components(graph, directed=True, connection="weak")
    if n_islands > 1:
        return Existence("disconnected", _groups(island, range(n_islands)))
    n_strong, strong = connected_components(graph, directed=True, connection="strong")
    if n_strong == 1:
        return Existence("ok", (tuple(range(n)),))
    return Existence("separated", _groups(strong, _descending(graph, strong, n_strong)))


def _is_strong_at_a_glance(counts: PairCounts) -> bool:
    """Do a few steps along the votes lead from one item to all others and back? False proves nothing."""
    n = counts.n_items
    if n > DENSE_ITEMS or n == 0:
        return False
    beats = np.zeros((n, n), bool)
    beats[counts.first, counts.second] = counts.wins + counts.ties > 0
    beats[counts.second, counts.first] = counts.losses + counts.ties > 0
    return all(_reaches_all(direction) for direction in (beats, beats.T))


def _reaches_all(beats: NDArray[np.bool_]) -> bool:
    reached = beats[0].copy()
    reached[0] = True
    for _ in range(GLANCES):
        if reached.all():
            return True
        reached |= beats[reached].any(axis=0)
    return bool(reached.all())


def _edges(counts: PairCounts) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    forward, backward = counts.wins + counts.ties > 0, counts.losses + counts.ties > 0
    winner = np.r_[counts.first[forward], counts.second[backward]]
    beaten = np.r_[counts.second[forward], counts.first[backward]]
    return beaten, winner


def _groups(label: NDArray[np.int32], order: Iterable[int]) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(int(item) for item in np.flatnonzero(label == group)) for group in order)


def _descending(graph: csr_array, label: NDArray[np.int32], n: int) -> Iterable[int]:
    """Return the strong components in topological order: each comes before the components that it beats."""
    edges = graph.tocoo()
    winner, beaten = label[edges.coords[0]], label[edges.coords[1]]
    between = winner != beaten
    order: TopologicalSorter[int] = TopologicalSorter(dict.fromkeys(range(n), ()))
    for above, below in np.unique(np.stack([winner[between], beaten[between]]), axis=1).T.tolist():
        order.add(below, above)
    return order.static_order()


def recession(
    counts: PairCounts, effects: csr_array, tie_effects: csr_array | None, *, n_scores: int
) -> tuple[bool, Array | None]:
    """Look for a direction in which the likelihood never falls and somewhere rises.

    Parameters
    ----------
    counts : PairCounts of one table
    effects, tie_effects : sparse (C, P), change of d and t of each pair with each parameter; no `tie_effects` for a
        model without ties
    n_scores : number of scores; these first parameters only enter as differences

    Returns
    -------
    is_checked : False if the linear programme would be too large
    direction : float64 (P,); None if there is none, so the maximum exists

    Source
    ------
    Albert and Anderson (1984): a direction separates the data if every observed outcome stays at least as likely as
    all others.
    """
    half, zero = effects * 0.5, effects * 0.0
    utilities = [half, -half] if tie_effects is None else [half, -half, zero + tie_effects]
    outcomes = [counts.wins, counts.losses, counts.ties][: len(utilities)]
    gains: Any = vstack(
        [
            (chosen - other)[np.flatnonzero(seen > 0)]
            for chosen, seen in zip(utilities, outcomes, strict=True)
            for other in utilities
            if other is not chosen
        ]
    ).tocsr()
    if gains.shape[0] * gains.shape[1] > LARGEST_PROGRAMME:
        return False, None
    total = np.asarray(gains.sum(axis=0)).ravel()
    no_loss = np.zeros(gains.shape[0])
    solution: Any = linprog(-total, A_ub=-gains, b_ub=no_loss, bounds=(-1, 1))
    if solution.status != 0:
        raise RuntimeError(f"the linear programme for the existence of a maximum failed: {solution.message}")
    if -solution.fun < 1e-7:
        return True, None
    direction: Array = solution.x
    direction[:n_scores] -= direction[:n_scores].mean() if n_scores else 0.0
    return True, direction

"""Which pairs a study compares, and each participant's order of trials, balanced within and across participants.

Everything follows from the study's seed and the participant's slot (0, 1, 2, … in order of arrival).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.study.trial import Half, Label

ATTEMPTS = 1000  # to find such an order; with all pairs of four or more stimuli about one in ten succeeds
LONGEST_RUN = 2  # trials in a row that may hold the same stimulus; a third would make it a yardstick
FLIPS = 4  # labels exchanged or not, the other stimulus first or not: four participants see each pair in all four ways

# One stream of random numbers per decision, so that changing how one is made leaves the others as they were.
_DATASETS, _LABELS, _PAIRS, _FLIPS = range(4)


@dataclass(frozen=True)
class PlannedPair:
    """An unordered pair of stimuli of one dataset, as it lies in its video.

    Parameters
    ----------
    key : what the caller calls the pair
    dataset : what the caller calls the dataset
    top, bottom : what the caller calls the conditions
    """

    key: int
    dataset: int
    top: int
    bottom: int


@dataclass(frozen=True)
class PlannedTrial:
    """One trial of a participant's order: a pair, the half labelled A, and the label shown first."""

    pair: int
    a_half: Half
    first_shown: Label


def participant_order(pairs: Sequence[PlannedPair], seed: int, slot: int) -> list[PlannedTrial]:
    """The trials of one participant, in order.

    Datasets follow one another in a Williams order: over one block of slots (as many as datasets, twice as many if that
    is odd) each stands at each position, and directly after each other one, equally often. Within a dataset the pairs
    are shuffled. Labels and first looks are balanced for the participant (`balanced_labels`); four slots in a row share
    them up to exchange, so that among the four each pair is seen with either stimulus as A and either first.

    Parameters
    ----------
    pairs : all pairs of the study, the same for every participant
    seed : the study's
    slot : the participant's, from 0
    """
    datasets = list(dict.fromkeys(pair.dataset for pair in pairs))
    swap_labels, swap_first = _flips(seed, slot)
    n_first_a = 0  # how much oftener A was shown first than B, so far
    orders: dict[int, list[PlannedTrial]] = {}
    for dataset in datasets:
        own = [pair for pair in pairs if pair.dataset == dataset]
        labels = balanced_labels(own, _rng(seed, _LABELS, slot // FLIPS, dataset), first_a_so_far=n_first_a)
        n_first_a += sum(1 if trial.first_shown == "a" else -1 for trial in labels)
        by_pair = {trial.pair: _flip(trial, swap_labels=swap_labels, swap_first=swap_first) for trial in labels}
        orders[dataset] = [by_pair[pair.key] for pair in shuffle_pairs(own, _rng(seed, _PAIRS, slot, dataset))]
    return [trial for dataset in _dataset_order(datasets, seed, slot) for trial in orders[dataset]]


def williams_square(n: int) -> list[list[int]]:
    """Rows of a Williams design: n for even n, 2n for odd n.

    Each item stands equally often at each position, and each follows directly on each other one equally often.

    Source
    ------
    Williams 1949; the first row is 0, 1, n-1, 2, n-2, …
    """
    first = [(step + 1) // 2 if step % 2 else (n - step // 2) % n for step in range(n)]
    rows = [[(item + shift) % n for item in first] for shift in range(n)]
    return rows if n % 2 == 0 else rows + [row[::-1] for row in rows]


def shuffle_pairs(pairs: Sequence[PlannedPair], rng: np.random.Generator) -> list[PlannedPair]:
    """A random order in which no stimulus is in more than LONGEST_RUN trials in a row, where such an order exists.

    Draws one pair after another among those allowed, and starts again at a dead end.
    """
    for _ in range(ATTEMPTS):
        order: list[PlannedPair] = []
        left = list(pairs)
        while left:
            tired = _shown_throughout(order[-LONGEST_RUN:]) if len(order) >= LONGEST_RUN else set()
            allowed = [pair for pair in left if not tired & {pair.top, pair.bottom}]
            if not allowed:
                break
            order.append(allowed[rng.integers(len(allowed))])
            left.remove(order[-1])
        else:
            return order
    return [pairs[index] for index in rng.permutation(len(pairs))]


def balanced_labels(
    pairs: Sequence[PlannedPair], rng: np.random.Generator, *, first_a_so_far: int = 0
) -> list[PlannedTrial]:
    """Labels and first looks for one dataset's pairs, balanced for every stimulus.

    Within one participant every stimulus is A as often as B, to one trial; among the trials in which it is A it is
    shown first as often as second, to one trial, and likewise as B; and A is shown first as often as B, to one trial,
    counting the trials so far.

    Parameters
    ----------
    pairs : all pairs of one dataset
    first_a_so_far : trials in earlier datasets with A first, minus those with B first
    """
    as_a = _regular_orientation([(pair.top, pair.bottom) for pair in pairs], rng)
    edges = [(a, pair.bottom if a == pair.top else pair.top) for a, pair in zip(as_a, pairs, strict=True)]
    is_a_first = _alternating_colours(edges, rng, balance=first_a_so_far)
    return [
        PlannedTrial(pair.key, "top" if a == pair.top else "bottom", "a" if first else "b")
        for pair, a, first in zip(pairs, as_a, is_a_first, strict=True)
    ]


def _regular_orientation(edges: Sequence[tuple[int, int]], rng: np.random.Generator) -> list[int]:
    """The node that each edge leaves: walking each trail one way, nodes are left as often as entered, to one edge."""
    leaves = [edge[0] for edge in edges]
    for trail in _trails([tuple(("", node) for node in edge) for edge in edges], rng):
        for edge, start in trail:
            leaves[edge] = start[1]
    return leaves


def _alternating_colours(edges: Sequence[tuple[int, int]], rng: np.random.Generator, *, balance: int) -> list[bool]:
    """Two colours, such that among the edges leaving a node, and among those entering it, both are as
    frequent, to one.

    In the bipartite graph of (leaving, node) and (entering, node) every closed trail is even, so colours alternate
    along it; an open trail starts with the colour that brings the total back towards zero.

    Source
    ------
    The usual proof that a bipartite graph splits evenly (de Werra 1971).
    """
    colours = [False] * len(edges)
    for trail in _trails([(("leaving", tail), ("entering", head)) for tail, head in edges], rng):
        colour = balance < 0 if balance else bool(rng.integers(2))
        for edge, _ in trail:
            colours[edge] = colour
            balance += 1 if colour else -1
            colour = not colour
    return colours


_Node = tuple[str, int]


def _trails(edges: Sequence[tuple[_Node, ...]], rng: np.random.Generator) -> list[list[tuple[int, _Node]]]:
    """Split a graph into edge-disjoint trails: (edge, the node it was entered from) along each.

    Trails from nodes of odd degree end at nodes of odd degree; what is left is closed.
    """
    at: dict[_Node, list[int]] = {}
    for number in rng.permutation(len(edges)):
        for node in edges[number]:
            at.setdefault(node, []).append(int(number))
    odd = [node for node, around in at.items() if len(around) % 2]
    used: set[int] = set()
    trails = [_walk(node, edges, at, used) for node in [*odd, *at]]
    return [trail for trail in trails if trail]


def _walk(
    node: _Node, edges: Sequence[tuple[_Node, ...]], at: dict[_Node, list[int]], used: set[int]
) -> list[tuple[int, _Node]]:
    """Follow unused edges from a node until there is none, marking them as used."""
    trail: list[tuple[int, _Node]] = []
    while True:
        while at[node] and at[node][-1] in used:
            at[node].pop()
        if not at[node]:
            return trail
        edge = at[node].pop()
        used.add(edge)
        trail.append((edge, node))
        node = edges[edge][1] if edges[edge][0] == node else edges[edge][0]


def _dataset_order(datasets: Sequence[int], seed: int, slot: int) -> list[int]:
    rows = williams_square(len(datasets))
    block, row = divmod(slot, len(rows))
    rng = _rng(seed, _DATASETS, block)
    names, turns = rng.permutation(len(datasets)).tolist(), rng.permutation(len(rows)).tolist()
    return [datasets[names[item]] for item in rows[turns[row]]]


def _flips(seed: int, slot: int) -> tuple[bool, bool]:
    block, turn = divmod(slot, FLIPS)
    bits = int(_rng(seed, _FLIPS, block).permutation(FLIPS)[turn])
    return bits % 2 == 1, bits >= 2


def _flip(trial: PlannedTrial, *, swap_labels: bool, swap_first: bool) -> PlannedTrial:
    a_half: Half = trial.a_half if not swap_labels else "bottom" if trial.a_half == "top" else "top"
    first_shown: Label = trial.first_shown if not swap_first else "b" if trial.first_shown == "a" else "a"
    return PlannedTrial(trial.pair, a_half, first_shown)


def _shown_throughout(pairs: Sequence[PlannedPair]) -> set[int]:
    return set.intersection(*({pair.top, pair.bottom} for pair in pairs))


def _rng(seed: int, *path: int) -> np.random.Generator:
    return np.random.default_rng([seed, *path])

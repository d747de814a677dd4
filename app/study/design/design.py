"""Order each participant's trials, balanced within and across participants (Williams design).

Everything follows from the study's seed and the participant's slot (0, 1, 2, … in order of arrival).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.study.trial.trial import IDENTICAL, MAIN, REPEAT, PlannedPair, PlannedTrial, other_half, other_label

ATTEMPTS = 1000  # to find a valid order; with all pairs of four or more stimuli about one in ten succeeds
LONGEST_RUN = 2  # trials in a row that may hold the same stimulus; a third would make it a yardstick
APART = 5  # trials between a pair and its repetition, where the dataset has enough; exchanged, it may come nearer
FLIPS = 4  # labels exchanged or not, the other stimulus first or not: four participants see each pair in all four ways

# One stream of random numbers per decision: a change to one decision leaves the others unchanged.
_DATASETS, _LABELS, _PAIRS, _FLIPS, _REPEATED, _IDENTICAL, _PLACES = range(7)


@dataclass(frozen=True)
class Repetition:
    """What a participant sees besides every pair once.

    Parameters
    ----------
    both_orders : show every pair a second time, with A and B exchanged
    repeated_pairs : pairs of each dataset shown again unchanged, to see whether the choice is the same
    identical_pairs : pairs of each dataset with the same stimulus twice, to check attention
    """

    both_orders: bool = False
    repeated_pairs: int = 0
    identical_pairs: int = 0


ONCE = Repetition()


def participant_order(
    pairs: Sequence[PlannedPair], seed: int, slot: int, repetition: Repetition = ONCE
) -> list[PlannedTrial]:
    """Return a participant's trials in order.

    Datasets follow a Williams design: over a block of slots (as many as datasets, twice as many if that is odd) each
    stands at each position, and directly after each other dataset, equally often. Within a dataset the pairs are
    shuffled. Labels and first looks are balanced for the participant (`balanced_labels`). Four slots in a row share
    them up to exchange, so that the four see each pair with either stimulus as A and either first. Repeated pairs
    and identical stimuli rotate from slot to slot.

    Parameters
    ----------
    pairs : all pairs of the study, the same for every participant, with identical ones where `repetition` asks for them
    seed : the study's
    slot : the participant's, from 0
    repetition : what is shown besides every pair once
    """
    datasets = list(dict.fromkeys(pair.dataset for pair in pairs))
    swap_labels, swap_first = _flips(seed, slot)
    n_first_a = 0  # trials so far with A first, minus trials with B first
    orders: dict[int, list[PlannedTrial]] = {}
    for number, dataset in enumerate(datasets, start=1):  # seeded by place, as keys differ between databases
        dataset_pairs = [pair for pair in pairs if pair.dataset == dataset]
        main = [pair for pair in dataset_pairs if not pair.is_identical]
        labels = balanced_labels(main, _rng(seed, _LABELS, slot // FLIPS, number), first_a_so_far=n_first_a)
        n_first_a += sum(1 if trial.first_shown == "a" else -1 for trial in labels)
        trials = [_flip(trial, swap_labels=swap_labels, swap_first=swap_first) for trial in labels]
        repeated = in_turn(main, repetition.repeated_pairs, _rng(seed, _REPEATED, number), slot)
        alone = [pair for pair in dataset_pairs if pair.is_identical]
        identical = in_turn(alone, repetition.identical_pairs, _rng(seed, _IDENTICAL, number), slot)
        rngs = _rng(seed, _PAIRS, slot, number), _rng(seed, _PLACES, slot, number)
        orders[dataset] = _dataset_trials(
            dataset_pairs, trials, repeated, identical, rngs, both_orders=repetition.both_orders
        )
    return [trial for dataset in _dataset_order(datasets, seed, slot) for trial in orders[dataset]]


def _dataset_trials(
    pairs: Sequence[PlannedPair],
    trials: Sequence[PlannedTrial],
    repeated: Sequence[PlannedPair],
    identical: Sequence[PlannedPair],
    rngs: tuple[np.random.Generator, np.random.Generator],
    *,
    both_orders: bool,
) -> list[PlannedTrial]:
    """Return a dataset's shuffled trials with repetitions; drawn again while a run is too long.

    Parameters
    ----------
    pairs : all of the dataset
    trials : one of each pair of two stimuli
    repeated, identical : the pairs to show again, and the pairs of a stimulus with itself
    rngs : for the order of the pairs, and for the places of the others among them
    """
    shuffling, placing = rngs
    by_key = {pair.key: pair for pair in pairs}
    by_pair = {trial.pair: trial for trial in trials}
    main = [by_key[trial.pair] for trial in trials]
    order: list[PlannedTrial] = []
    for _ in range(ATTEMPTS):
        first = shuffle_pairs(main, shuffling)
        order = [by_pair[pair.key] for pair in first]
        if both_orders:
            order += [by_pair[pair.key].exchanged for pair in shuffle_pairs(main, shuffling, after=first)]
        for pair in repeated:
            order = _with_repeat(order, pair.key, by_key, placing)
        for pair in identical:
            order = _with_identical(order, pair, by_key, placing)
        is_calm = longest_run([by_key[trial.pair].stimuli for trial in order]) <= LONGEST_RUN
        if is_calm and _closest_repeat(order) >= min(APART, len(main) // 3):
            break
    return order


def williams_square(n: int) -> list[list[int]]:
    """Return the rows of a Williams design: n rows for even n, 2n for odd n.

    Each item stands equally often at each position, and each follows directly on each other one equally often.

    Source
    ------
    Williams 1949; the first row is 0, 1, n-1, 2, n-2, …
    """
    first = [(step + 1) // 2 if step % 2 else (n - step // 2) % n for step in range(n)]
    rows = [[(item + shift) % n for item in first] for shift in range(n)]
    return rows if n % 2 == 0 else rows + [row[::-1] for row in rows]


def shuffle_pairs(
    pairs: Sequence[PlannedPair], rng: np.random.Generator, *, after: Sequence[PlannedPair] = ()
) -> list[PlannedPair]:
    """Return a random order with no stimulus in more than LONGEST_RUN trials in a row, where such an order exists.

    It draws pair after pair among those allowed, and starts again at a dead end.

    Parameters
    ----------
    pairs : the pairs to order
    rng : Generator
    after : the pairs shown directly before
    """
    before = list(after[-LONGEST_RUN:])
    for _ in range(ATTEMPTS):
        order = before.copy()
        left = list(pairs)
        while left:
            tired = _shown_throughout(order[-LONGEST_RUN:]) if len(order) >= LONGEST_RUN else frozenset()
            last = order[-1].key if order else None
            allowed = [pair for pair in left if pair.top not in tired and pair.bottom not in tired and pair.key != last]
            if not allowed:
                break
            order.append(allowed[rng.integers(len(allowed))])
            left.remove(order[-1])
        else:
            return order[len(before) :]
        if len(order) == len(before):  # no pair may come first, whatever is drawn
            break
    return [pairs[index] for index in rng.permutation(len(pairs))]


def longest_run(shown: Sequence[frozenset[int]]) -> int:
    """Return the largest number of trials in a row that show the same stimulus."""
    longest, running = 0, dict[int, int]()
    for stimuli in shown:
        running = {stimulus: running.get(stimulus, 0) + 1 for stimulus in stimuli}
        longest = max(longest, *running.values())
    return longest


def balanced_labels(
    pairs: Sequence[PlannedPair], rng: np.random.Generator, *, first_a_so_far: int = 0
) -> list[PlannedTrial]:
    """Assign labels and first looks to a dataset's pairs, balanced for every stimulus.

    For each participant every stimulus is A as often as B, up to one trial. Among the trials in which it is A it is
    shown first as often as second, up to one trial, and likewise as B. A is shown first as often as B, up to one
    trial, counting the trials so far.

    Parameters
    ----------
    pairs : all pairs of a dataset
    rng : Generator
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
    """Orient edges along trails and return the node that each leaves; nodes are left as often as entered, up to one
    edge.
    """
    leaves = [edge[0] for edge in edges]
    for trail in _trails([tuple(("", node) for node in edge) for edge in edges], rng):
        for edge, start in trail:
            leaves[edge] = start[1]
    return leaves


def _alternating_colours(edges: Sequence[tuple[int, int]], rng: np.random.Generator, *, balance: int) -> list[bool]:
    """Give edges two colours: among the edges leaving a node, and among those entering it, both are equally frequent,
    up to one.

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
    """Split a graph into edge-disjoint trails of (edge, node from which it is entered).

    Trails from nodes of odd degree end at nodes of odd degree; the remaining trails are closed.
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
    """Follow unused edges from a node until none is left there, marking them as used."""
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
    a_half = other_half(trial.a_half) if swap_labels else trial.a_half
    return PlannedTrial(trial.pair, a_half, other_label(trial.first_shown) if swap_first else trial.first_shown)


def in_turn(pairs: Sequence[PlannedPair], n: int, rng: np.random.Generator, slot: int) -> list[PlannedPair]:
    """Return the n pairs of this slot; over as many slots as pairs, each pair comes n times.

    Parameters
    ----------
    pairs : to choose from
    n : how many to choose; all where there are fewer
    rng : Generator, the same for every slot
    slot : the participant's, from 0
    """
    turns = rng.permutation(len(pairs))
    return [pairs[turns[(slot * n + step) % len(pairs)]] for step in range(min(n, len(pairs)))]


def _with_repeat(
    order: Sequence[PlannedTrial], pair: int, by_key: Mapping[int, PlannedPair], rng: np.random.Generator
) -> list[PlannedTrial]:
    """Insert a pair's first trial again, far from it; the later of the two is the repetition."""
    index = next(index for index, trial in enumerate(order) if trial.pair == pair)
    free = _free_places(order, by_key[pair], by_key)
    distances = {place: max(index - place, place - index - 1) for place in free}
    far = [place for place in free if distances[place] >= min(APART, max(distances.values()))]
    place = far[rng.integers(len(far))]
    first, second = sorted((index if place > index else index + 1, place))
    longer = [*order[:place], order[index], *order[place:]]
    longer[first], longer[second] = replace(order[index], role=MAIN), replace(order[index], role=REPEAT)
    return longer


def _closest_repeat(order: Sequence[PlannedTrial]) -> int:
    """Return the fewest trials between a pair and its repetition; APART without repetitions."""
    places = {trial.pair: place for place, trial in reversed(list(enumerate(order)))}
    gaps = [place - places[trial.pair] - 1 for place, trial in enumerate(order) if trial.role == REPEAT]
    return min(gaps, default=APART)


def _with_identical(
    order: Sequence[PlannedTrial], pair: PlannedPair, by_key: Mapping[int, PlannedPair], rng: np.random.Generator
) -> list[PlannedTrial]:
    """Insert a stimulus against itself, but not as the first trial: participants first learn what there is to see."""
    free = _free_places(order, pair, by_key)
    later = [place for place in free if place > 0] or free
    place = later[rng.integers(len(later))]
    trial = PlannedTrial(
        pair.key, "top" if rng.integers(2) else "bottom", "a" if rng.integers(2) else "b", role=IDENTICAL
    )
    return [*order[:place], trial, *order[place:]]


def _free_places(order: Sequence[PlannedTrial], pair: PlannedPair, by_key: Mapping[int, PlannedPair]) -> list[int]:
    """Return the places where a pair makes no run too long; all places if there is none."""
    shown = [by_key[trial.pair].stimuli for trial in order]
    every = range(len(order) + 1)
    around = {
        place: [*shown[max(0, place - LONGEST_RUN) : place], pair.stimuli, *shown[place : place + LONGEST_RUN]]
        for place in every
    }
    return [place for place in every if longest_run(around[place]) <= LONGEST_RUN] or list(every)


def _shown_throughout(pairs: Sequence[PlannedPair]) -> frozenset[int]:
    return frozenset.intersection(*(pair.stimuli for pair in pairs))


def _rng(seed: int, *path: int) -> np.random.Generator:
    return np.random.default_rng([seed, *path])

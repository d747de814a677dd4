"""Order the trials of a participant who rates films one by one: at random, datasets mixed.

Everything follows from the study's seed and the participant's slot, as in `app.study.design.design`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from app.study.design.design import APART, ATTEMPTS, Repetition, in_turn, participant_order
from app.study.protocols import RATED, Protocol
from app.study.trial.trial import IDENTICAL, MAIN, REPEAT, PlannedPair, PlannedTrial, Role

_ORDER, _REPEATED = 7, 8  # streams of random numbers besides those of `app.study.design.design`

Showing = tuple[PlannedPair, Role]


def rating_order(pairs: Sequence[PlannedPair], seed: int, slot: int, repetition: Repetition) -> list[PlannedTrial]:
    """Return a participant's trials in order: every film once, no two of a dataset in a row where that is possible.

    The stimulus to rate is in the lower half (B) of its film. Where that film has a reference, it is in the upper half
    (A) and shown first. Repeated films rotate from slot to slot, and come at least `APART` trials after the first time
    where there are enough.

    Parameters
    ----------
    pairs : the films of the study: each stimulus alone (both halves the same), or each below its dataset's reference
    seed : the study's
    slot : the participant's, from 0
    repetition : how many films of each dataset come again, and whether the reference is rated against itself, once in
        each dataset
    """
    main = [pair for pair in pairs if not pair.is_identical] or list(pairs)
    checks = [pair for pair in pairs if pair.is_identical and pair not in main]
    planned: list[Showing] = [(pair, MAIN) for pair in main]
    for number, dataset in enumerate(dict.fromkeys(pair.dataset for pair in pairs), start=1):
        of_dataset = [pair for pair in main if pair.dataset == dataset]
        again = in_turn(of_dataset, repetition.repeated_pairs, np.random.default_rng([seed, _REPEATED, number]), slot)
        planned += [(pair, REPEAT) for pair in again]
        planned += [(pair, IDENTICAL) for pair in checks if pair.dataset == dataset and repetition.identical_pairs]
    rng = np.random.default_rng([seed, _ORDER, slot])
    order: list[Showing] = []
    for _ in range(ATTEMPTS):
        order = _mixed(planned, rng)
        if order[0][1] != IDENTICAL and _fewest_between(order) >= min(APART, len(main) // 3):
            break
    return [PlannedTrial(pair.key, "top", "a", role) for pair, role in _first_is_main(order)]


def trials_in_order(
    protocol: Protocol, pairs: Sequence[PlannedPair], seed: int, slot: int, repetition: Repetition
) -> list[PlannedTrial]:
    """Return a participant's trials in order, by `rating_order` or `participant_order` as the protocol asks.

    Parameters
    ----------
    protocol : the study's
    pairs, seed, slot, repetition : as in those
    """
    in_order = rating_order if protocol in RATED else participant_order
    return in_order(pairs, seed, slot, repetition)


def most_neighbours(datasets: Sequence[int]) -> int:
    """Return how many trials must follow one of the same dataset, in the best order.

    Parameters
    ----------
    datasets : of each trial
    """
    most = max(Counter(datasets).values(), default=0)
    return max(0, 2 * most - len(datasets) - 1)


def _mixed(planned: Sequence[Showing], rng: np.random.Generator) -> list[Showing]:
    """Draw trial after trial from other datasets than the one before.

    A dataset that has more than half of what is left comes next: otherwise its trials would stay for the end.
    """
    left, order = list(planned), list[Showing]()
    while left:
        counts = Counter(pair.dataset for pair, _ in left)
        last = order[-1][0].dataset if order else None
        allowed = [trial for trial in left if trial[0].dataset != last] or left
        urgent = [trial for trial in allowed if 2 * counts[trial[0].dataset] > len(left)] or allowed
        recent = {pair.key for pair, _ in order[-APART:]}
        fresh = [trial for trial in urgent if trial[0].key not in recent] or urgent
        order.append(fresh[rng.integers(len(fresh))])
        left.remove(order[-1])
    return order


def _fewest_between(order: Sequence[Showing]) -> int:
    """Return the fewest trials between two showings of a film; APART where none comes again."""
    places: dict[int, int] = {}
    fewest = APART
    for place, (pair, _) in enumerate(order):
        if pair.key in places:
            fewest = min(fewest, place - places[pair.key] - 1)
        places[pair.key] = place
    return fewest


def _first_is_main(order: Sequence[Showing]) -> list[Showing]:
    """Let the first showing of a film count and the later one be the repetition."""
    shown: set[int] = set()
    renamed: list[Showing] = []
    for pair, role in order:
        renamed.append((pair, role if role == IDENTICAL else REPEAT if pair.key in shown else MAIN))
        shown.add(pair.key)
    return renamed

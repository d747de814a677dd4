"""Find how many circular triads random votes would give on the pairs that a participant compared.

The pairs and the ties stay as they are; the direction of every other vote is thrown by a coin. A triad with one tie is
half a cycle if its two preferences make a chain, because a coin that broke the tie would close the cycle half the time.
Triads with two or three ties are a quarter of a cycle whatever the votes, and tell nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.intp]
Probabilities = NDArray[np.float64]

EXACT_VOTES = 14  # without a tie, up to which all 2^14 directions are enumerated, in 0.5 ms
MOST_SAMPLES, FEWEST_SAMPLES = 1999, 249  # random directions of more votes
TOGETHER = 2_000_000  # triads times samples in memory
WORK = 200_000_000  # triads times samples of a study, about 2 s


class Pattern(NamedTuple):
    """The triads of compared pairs that can tell something.

    Parameters
    ----------
    n_votes : number of pairs that were compared without a tie
    triads : intp (K, 3), the votes on a-b, b-c and a-c of the triads a < b < c without a tie
    chains : intp (M, 2), two votes of the triads with one tie
    are_alike : bool (M,), do the two make a chain if both, or neither, prefer the item that comes first?
    """

    n_votes: int
    triads: Index
    chains: Index
    are_alike: NDArray[np.bool_]


def samples_for(n_triads: int) -> int:
    """Return how many random directions a study with so many triads can afford.

    It is halved while there are too many, so that it stays the same while a study grows a little.
    """
    n_samples = MOST_SAMPLES
    while n_samples > FEWEST_SAMPLES and n_samples * n_triads > WORK:
        n_samples //= 2
    return n_samples


def pattern_of(preferred: NDArray[np.float64]) -> Pattern:
    """Return the triads of a participant's pairs.

    Parameters
    ----------
    preferred : float64 (n, n), as from `preference_matrix`
    """
    n = len(preferred)
    triples = _triples(n)
    places = np.stack([triples[:, [0, 1]], triples[:, [1, 2]], triples[:, [0, 2]]], axis=1)  # (T, 3, 2)
    values = preferred[places[..., 0], places[..., 1]]
    judged = ~np.isnan(values).any(axis=1)
    places, tied = places[judged], values[judged] == 0.5
    strict = np.triu((preferred == 1) | (preferred == 0), 1)
    number = np.zeros((n, n), np.intp)
    number[strict] = np.arange(strict.sum())
    votes = number[places[..., 0], places[..., 1]]  # (T, 3)
    chains, are_alike = [], []
    for tie, others, is_alike in ((0, [1, 2], False), (1, [0, 2], False), (2, [0, 1], True)):
        rows = tied[:, tie] & (tied.sum(axis=1) == 1)
        chains.append(votes[rows][:, others])
        are_alike.append(np.full(int(rows.sum()), is_alike))
    return Pattern(int(strict.sum()), votes[~tied.any(axis=1)], np.concatenate(chains), np.concatenate(are_alike))


@lru_cache(maxsize=8)
def _triples(n: int) -> Index:
    """Return all triples of n items in ascending order, intp (T, 3)."""
    return np.array(list(combinations(range(n), 3)), np.intp).reshape(-1, 3)


def half_cycles(pattern: Pattern, first_wins: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return twice the number of circular triads, a broken tie counting half, int64 (S,).

    Parameters
    ----------
    pattern : Pattern
    first_wins : bool (V, S), does each vote, in each of S ways, prefer the item that comes first?
    """
    result = np.zeros(first_wins.shape[1], np.int64)
    size = max(1, TOGETHER // first_wins.shape[1])
    for start in range(0, len(pattern.triads), size):
        ab, bc, ac = (first_wins[votes] for votes in pattern.triads[start : start + size].T)
        result += 2 * np.count_nonzero((ab == bc) & (bc != ac), axis=0)
    for start in range(0, len(pattern.chains), size):
        first, second = (first_wins[votes] for votes in pattern.chains[start : start + size].T)
        result += np.count_nonzero((first == second) == pattern.are_alike[start : start + size, None], axis=0)
    return result


def random_half_cycles(pattern: Pattern, n_samples: int) -> tuple[NDArray[np.int64], bool]:
    """Return how often random directions give 0, 1, 2, … half cycles, int64 (H,), and whether all were tried.

    Parameters
    ----------
    pattern : Pattern
    n_samples : random directions where there are too many to enumerate; their seed is fixed
    """
    n = pattern.n_votes
    if n <= EXACT_VOTES:
        ways = (np.arange(2**n) >> np.arange(n)[:, None] & 1).astype(bool)
        return np.bincount(half_cycles(pattern, ways)), True
    ways = np.random.default_rng(n).integers(0, 2, (n, n_samples), np.uint8).astype(bool)
    return np.bincount(half_cycles(pattern, ways)), False


def tail(observed: Sequence[int], chances: Sequence[Probabilities]) -> float:
    """Return the probability of as few half cycles in all, of datasets that are independent under random votes.

    Parameters
    ----------
    observed : half cycles on each dataset
    chances : float64 (H,) each, probabilities of 0, 1, 2, … half cycles
    """
    together = np.ones(1)
    for chance in chances:
        together = np.convolve(together, chance)
    return min(1.0, float(together[: sum(observed) + 1].sum()))

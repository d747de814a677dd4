"""Count circular triads: how often a participant's preferences on a dataset contradict each other.

A triad is circular if a is preferred to b, b to c and c to a. Under random votes their number has a known
distribution, which tells whether a participant was more consistent than chance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, product
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from app.analysis.reading.votes_table import VotesTable, bounds_of, numbered, order_of
from app.analysis.screening.triad_chance import half_cycles, pattern_of, random_half_cycles, samples_for, tail

SIGNS = np.array([1, -1, 0])  # of a vote for the first, the second or neither
EXACT_UP_TO = 10  # items; the dynamic programme takes 0.2 s for ten and three times as long per further item
MOST_ITEMS = 60  # 34 220 triples, whose chance is tried out for each participant
MANY_ITEMS, SPARSE = 100, 0.05  # above this many and below this share of n^2 pairs, sparse matrices are faster
PARTS_KEPT = 2**15  # participants times datasets of some studies, about 1 kB each
LARGEST_KEPT = 300  # votes of a part, 10 kB


@dataclass(frozen=True)
class Triads:
    """The circular triads of a participant on a dataset.

    Parameters
    ----------
    n_items : items that this participant compared
    complete : was every pair of them compared? If not, only triples with three votes count
    circular : strict cycles, three preferences without a tie
    circular_expected_ties : expected number of cycles if a coin broke every tie; equals `circular` without ties
    circular_max : largest possible number; None for an incomplete design
    zeta : coefficient of consistence 1 - circular_expected_ties / circular_max
    p_value : probability that random votes on the same pairs, with the ties where they are, have as few expected cycles
        or fewer; None if no triple of the pairs can tell, or with more than 60 items
    circular_by_chance : expected number of cycles under random votes, a quarter of the triples with three votes
    strict_by_chance : expected number of strict cycles under random votes with the ties where they are, a quarter of
        the triples with three preferences
    half_cycles : twice the expected number of cycles of the triples with at most one tie
    chance : probabilities of 0, 1, 2, … of these half cycles under random votes; empty if no triple can tell
    """

    participant: str
    dataset: str
    n_items: int
    complete: bool
    circular: int
    circular_expected_ties: float
    circular_max: int | None
    zeta: float | None
    p_value: float | None
    circular_by_chance: float = 0.0
    strict_by_chance: float = 0.0
    half_cycles: int = 0
    chance: tuple[float, ...] = ()


def triads(votes: VotesTable) -> list[Triads]:
    """Count the circular triads of every participant on every dataset.

    Repeated votes on a pair count as their majority, and as a tie if there is none.
    """
    if not votes.has_participants or not len(votes):
        return []
    rows = []
    key = votes.participant.astype(np.int64) * len(votes.datasets) + votes.dataset
    order = order_of(key, len(votes.participants) * len(votes.datasets))
    bounds = bounds_of(key[order])
    columns = (votes.item_a, votes.item_b, votes.choice, votes.count)
    table = np.stack([column[order].astype(np.int64) for column in columns], axis=1)  # (N, 4)
    n_samples = samples_for((len(bounds) - 1) * comb(len(votes.items), 3))
    for start, end in pairwise(bounds):
        row = order[start]
        who, dataset = votes.participants[votes.participant[row]], votes.datasets[votes.dataset[row]]
        counted = _triads_of_part if end - start <= LARGEST_KEPT else _triads_of_part.__wrapped__
        rows.append(replace(counted(table[start:end].tobytes(), n_samples), participant=who, dataset=dataset))
    return rows


@lru_cache(maxsize=PARTS_KEPT)
def _triads_of_part(votes: bytes, n_samples: int) -> Triads:
    """Count the triads of one participant's votes on one dataset, int64 (M, 4): both items, choice and count.

    They are kept, because most are the same when an analysis is repeated after another vote.
    """
    item_a, item_b, choice, count = np.frombuffer(votes, np.int64).reshape(-1, 4).T
    n_items = len(_compared(item_a, item_b)[0])
    if n_items > MANY_ITEMS and len(choice) < SPARSE * n_items**2:
        return _triads_of_few(item_a, item_b, choice, count)
    return _triads_of(preference_matrix(item_a, item_b, choice, count), n_samples)


def _compared(
    item_a: NDArray[np.int64], item_b: NDArray[np.int64]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return the items that the votes compare, and each vote's first and second among them, intp (M,)."""
    items, place = numbered(both := np.concatenate([item_a, item_b]), int(both.max()) + 1)
    return items, place[: len(item_a)], place[len(item_a) :]


def preference_matrix(
    item_a: NDArray[np.int64], item_b: NDArray[np.int64], choice: NDArray[np.int64], count: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return which item is preferred to which, by majority.

    Parameters
    ----------
    item_a, item_b, choice, count : int64 (M,), columns of a `VotesTable`, all of one participant and dataset

    Returns
    -------
    float64 (n, n), 1 where the row's item is preferred, 0.5 for a tie, 0 where the column's is, NaN without a vote
    """
    items, first, second = _compared(item_a, item_b)
    sign = SIGNS[choice] * count
    n, cell = len(items), first * len(items) + second
    balance, n_votes = (np.bincount(cell, weight, n * n).reshape(n, n) for weight in (sign, count))
    balance, n_votes = balance - balance.T, n_votes + n_votes.T
    return np.where(n_votes > 0, (np.sign(balance) + 1) / 2, np.nan)


def _triads_of(preferred: NDArray[np.float64], n_samples: int) -> Triads:
    n = len(preferred)
    complete = int(np.isnan(preferred).sum()) == n
    expected = expected_circular(preferred)
    maximum = max_circular(n) if complete else None
    observed, chance = chance_of(preferred, n_samples)
    return Triads(
        "",
        "",
        n_items=n,
        complete=complete,
        circular=count_circular(preferred),
        circular_expected_ties=expected,
        circular_max=maximum,
        zeta=1 - expected / maximum if maximum else None,
        p_value=tail([observed], [chance]) if len(chance) else None,
        circular_by_chance=_undirected_triangles(~np.isnan(preferred)) / 4,
        strict_by_chance=_undirected_triangles((preferred == 0) | (preferred == 1)) / 4,
        half_cycles=observed,
        chance=tuple(chance.tolist()),
    )


def chance_of(preferred: NDArray[np.float64], n_samples: int) -> tuple[int, NDArray[np.float64]]:
    """Return a participant's half cycles, and the probabilities of 0, 1, 2, … of them under random votes.

    Exact for complete designs without ties of up to ten items, and for up to `EXACT_VOTES` votes without a tie; else
    from random directions, among which the observed one counts.

    Parameters
    ----------
    preferred : float64 (n, n), as from `preference_matrix`
    n_samples : number of random directions

    Returns
    -------
    half_cycles : int
    chance : float64 (H,); empty if no triple of the pairs can tell, or with more than `MOST_ITEMS`
    """
    n = len(preferred)
    if n > MOST_ITEMS:
        return 0, np.zeros(0)
    pattern = pattern_of(preferred)
    if not len(pattern.triads) + len(pattern.chains):
        return 0, np.zeros(0)
    strict = np.triu(preferred == 1, 1)
    first_wins = strict[np.triu((preferred == 1) | (preferred == 0), 1)]
    observed = int(half_cycles(pattern, first_wins[:, None])[0])
    if n <= EXACT_UP_TO and pattern.n_votes == comb(n, 2):
        chance = np.zeros(2 * max_circular(n) + 1)
        chance[::2] = circular_distribution(n)
        return observed, chance
    counts, is_exact = random_half_cycles(pattern, n_samples)
    if not is_exact:
        counts = np.pad(counts, (0, max(0, observed + 1 - len(counts))))
        counts[observed] += 1
    return observed, counts / counts.sum()


def _undirected_triangles(judged: NDArray[np.bool_]) -> float:
    """Return the number of triples with three votes, of bool (n, n) without a diagonal."""
    return _directed_triangles(judged.astype(np.float64)) / 2


def _triads_of_few(
    item_a: NDArray[np.int64], item_b: NDArray[np.int64], choice: NDArray[np.int64], count: NDArray[np.int64]
) -> Triads:
    """Count only cycles, by sparse matrices, for a participant who compared few of many pairs."""
    items, first, second = _compared(item_a, item_b)
    n, sign = len(items), SIGNS[choice] * count
    sign = np.where(first < second, sign, -sign)
    pairs, pair = np.unique(np.minimum(first, second) * n + np.maximum(first, second), return_inverse=True)
    share = (np.sign(np.bincount(pair, sign)) + 1) / 2
    low, high = pairs // n, pairs % n
    chance = csr_array((np.r_[share, 1 - share], (np.r_[low, high], np.r_[high, low])), shape=(n, n))
    strict = chance.copy()
    strict.data = (strict.data == 1).astype(float)
    return Triads(
        "",
        "",
        n_items=n,
        complete=False,
        circular=round(_sparse_triangles(strict)),
        circular_expected_ties=_sparse_triangles(chance),
        circular_max=None,
        zeta=None,
        p_value=None,
        circular_by_chance=_sparse_triangles(chance + chance.T) / 8,  # each triple is found in both directions
        strict_by_chance=_sparse_triangles(strict + strict.T) / 8,
    )


def _sparse_triangles(weights: csr_array) -> float:
    return float((weights @ weights).multiply(weights.T).sum()) / 3


def count_circular(preferred: NDArray[np.float64]) -> int:
    """Count strict cycles of three; the trace of the cube counts each three times.

    Parameters
    ----------
    preferred : float64 (n, n), as from `preference_matrix`
    """
    return round(_directed_triangles((preferred == 1).astype(np.float64)))


def expected_circular(preferred: NDArray[np.float64]) -> float:
    """Return the expected number of cycles if ties are broken at random, over the triples with three votes.

    Ties in a triple are broken independently, so the probability of a cycle is the product of three preferences. For
    a complete design this equals T_half - t/4 with T_half Kendall's count from half points and t the number of ties.

    Parameters
    ----------
    preferred : float64 (n, n), as from `preference_matrix`
    """
    chance = np.nan_to_num(preferred, nan=0.0)
    return _directed_triangles(chance)


def _directed_triangles(weights: NDArray[np.float64]) -> float:
    """Return the sum over cycles of three of the products of their weights: a third of the trace of the cube."""
    return float(np.sum((weights @ weights) * weights.T)) / 3


def max_circular(n: int) -> int:
    """Return the largest possible number of circular triads of n items.

    Source
    ------
    Kendall and Babington Smith (1940), section 5.
    """
    return (n**3 - (n if n % 2 else 4 * n)) // 24


def circular_from_wins(wins: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """Return the numbers of circular triads, int64 (…), from numbers of wins: T = n(n-1)(2n-1)/12 - sum of squares /
    2.

    Parameters
    ----------
    wins : int64 (…, n)
    n : number of items

    Source
    ------
    Kendall and Babington Smith (1940), equation 3.
    """
    result: NDArray[np.int64] = (n * (n - 1) * (2 * n - 1) // 6 - np.sum(wins**2, axis=-1)) // 2
    return result


def circular_distribution(n: int) -> NDArray[np.float64]:
    """Return the probabilities of 0, 1, 2, … circular triads for random votes on n <= 10 items, float64 (Tmax + 1,)."""
    counts = tournament_counts(n)
    return np.array([count / 2 ** comb(n, 2) for count in counts])


@lru_cache(maxsize=16)
def tournament_counts(n: int) -> tuple[int, ...]:
    """Count the tournaments of n items, of all 2^(n(n-1)/2), that have 0, 1, 2, … circular triads.

    A tournament grows by one item at a time; only the multiset of win counts is kept.
    """
    states: Counter[tuple[int, ...]] = Counter({(0,): 1})
    for n_before in range(1, n):
        grown: Counter[tuple[int, ...]] = Counter()
        for wins, ways in states.items():
            for after, factor in _grow(wins, n_before):
                grown[after] += ways * factor
        states = grown
    result = [0] * (max_circular(n) + 1)
    for wins, ways in states.items():
        result[int(circular_from_wins(np.array(wins), n))] += ways
    return tuple(result)


def _grow(wins: tuple[int, ...], n_before: int) -> list[tuple[tuple[int, ...], int]]:
    """Return every multiset of win counts that a further item can lead to, with the number of ways."""
    groups = sorted(Counter(wins).items())
    results = []
    for losers in product(*(range(size + 1) for _, size in groups)):  # how many of each group lose to the new item
        factor, after = 1, [sum(losers)]
        for (score, size), lost in zip(groups, losers, strict=True):
            factor *= comb(size, lost)
            after += [score] * lost + [score + 1] * (size - lost)
        results.append((tuple(sorted(after)), factor))
    assert len(results[0][0]) == n_before + 1
    return results


def by_participant(rows: Sequence[Triads]) -> dict[str, list[Triads]]:
    """Return each participant's triads on all datasets."""
    parts: dict[str, list[Triads]] = {}
    for row in rows:
        parts.setdefault(row.participant, []).append(row)
    return parts


def smallest_p_value(rows: Sequence[Triads]) -> float:
    """Return `pooled_p_value` with the fewest possible contradictions; with few triads it is far above 0.

    Without ties, a dataset of 3 items gives 0.75, of 4 items 0.375, of 5 items 0.117, of 6 items 0.022; datasets
    multiply.
    """
    return float(np.prod([next(filter(None, row.chance)) for row in rows if row.chance]))


def pooled_p_value(rows: Sequence[Triads]) -> float | None:
    """Return the probability that random votes give a participant as few expected cycles over all datasets.

    Returns
    -------
    float, or None if no dataset has triples that can tell
    """
    telling = [row for row in rows if row.chance]
    if not telling:
        return None
    return tail([row.half_cycles for row in telling], [np.array(row.chance) for row in telling])

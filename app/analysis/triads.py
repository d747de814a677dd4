"""Count circular triads: how often a participant's preferences on a dataset contradict each other.

A triad is circular if a is preferred to b, b to c and c to a. Under random votes their number has a known
distribution, which tells whether a participant was more consistent than chance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.stats import chi2

from app.analysis.votes_table import NONE, A, VotesTable

EXACT_UP_TO = 10  # items; the dynamic programme takes 0.2 s for ten and three times as long per further item
MANY_ITEMS, SPARSE = 100, 0.05  # above this many and below this share of n^2 pairs, sparse matrices are faster
MAX_BROKEN_TIES = 15  # 2^15 ways of breaking them: every pair of six items


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
    p_value : probability that random votes have as few cycles or fewer, averaged over the ways of breaking the ties
    broken : share of the ways of breaking the ties that give 0, 1, 2, … cycles; empty if the design is incomplete, or
        has too many ties
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
    broken: tuple[float, ...] = ()


def triads(votes: VotesTable) -> list[Triads]:
    """Count the circular triads of every participant on every dataset.

    Repeated votes on a pair count as their majority, and as a tie if there is none.
    """
    if not votes.has_participants:
        return []
    rows = []
    key = votes.participant.astype(np.int64) * len(votes.datasets) + votes.dataset
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order])) + 1
    for part in np.split(order, starts) if len(order) else ():
        participant = votes.participants[votes.participant[part[0]]]
        dataset = votes.datasets[votes.dataset[part[0]]]
        n_items = len(np.unique(np.r_[votes.item_a[part], votes.item_b[part]]))
        if n_items > MANY_ITEMS and len(part) < SPARSE * n_items**2:
            rows.append(_triads_of_few(participant, dataset, votes.where(part)))
        else:
            rows.append(_triads_of(participant, dataset, preference_matrix(votes, part)))
    return rows


def preference_matrix(votes: VotesTable, rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return which item is preferred to which, by majority.

    Parameters
    ----------
    rows : int (M,), rows of the table, all of one participant and dataset

    Returns
    -------
    float64 (n, n), 1 where the row's item is preferred, 0.5 for a tie, 0 where the column's is, NaN without a vote
    """
    items, index = np.unique(np.r_[votes.item_a[rows], votes.item_b[rows]], return_inverse=True)
    first, second = index[: len(rows)], index[len(rows) :]
    sign = np.where(votes.choice[rows] == A, 1, np.where(votes.choice[rows] == NONE, 0, -1)) * votes.count[rows]
    balance = np.zeros((len(items), len(items)))
    n_votes = np.zeros_like(balance)
    np.add.at(balance, (first, second), sign)
    np.add.at(n_votes, (first, second), votes.count[rows])
    balance, n_votes = balance - balance.T, n_votes + n_votes.T
    return np.where(n_votes > 0, (np.sign(balance) + 1) / 2, np.nan)


def _triads_of(participant: str, dataset: str, preferred: NDArray[np.float64]) -> Triads:
    n = len(preferred)
    complete = int(np.isnan(preferred).sum()) == n
    circular = count_circular(preferred)
    expected = expected_circular(preferred)
    maximum = max_circular(n) if complete else None
    broken = broken_ties(preferred) if complete else None
    return Triads(
        participant,
        dataset,
        n_items=n,
        complete=complete,
        circular=circular,
        circular_expected_ties=expected,
        circular_max=maximum,
        zeta=1 - expected / maximum if maximum else None,
        p_value=None if broken is None else p_value(n, broken),
        broken=() if broken is None else tuple(broken.tolist()),
    )


def _triads_of_few(participant: str, dataset: str, votes: VotesTable) -> Triads:
    """Count only cycles, by sparse matrices, for a participant who compared few of many pairs."""
    items, index = np.unique(np.r_[votes.item_a, votes.item_b], return_inverse=True)
    n = len(items)
    first, second = index[: len(votes)], index[len(votes) :]
    sign = np.where(votes.choice == A, 1, np.where(votes.choice == NONE, 0, -1)) * votes.count
    sign = np.where(first < second, sign, -sign)
    pairs, pair = np.unique(np.minimum(first, second) * n + np.maximum(first, second), return_inverse=True)
    share = (np.sign(np.bincount(pair, sign)) + 1) / 2
    low, high = pairs // n, pairs % n
    chance = csr_array((np.r_[share, 1 - share], (np.r_[low, high], np.r_[high, low])), shape=(n, n))
    strict = chance.copy()
    strict.data = (strict.data == 1).astype(float)
    return Triads(
        participant,
        dataset,
        n_items=n,
        complete=False,
        circular=round(_sparse_triangles(strict)),
        circular_expected_ties=_sparse_triangles(chance),
        circular_max=None,
        zeta=None,
        p_value=None,
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


def p_value(n: int, broken: NDArray[np.float64]) -> float:
    """Return P(T <= observed) under random votes, averaged over the ways of breaking ties.

    Exact up to ten items, by the chi-square approximation beyond.

    Parameters
    ----------
    broken : float64 (T + 1,), as from `broken_ties`
    """
    different = np.flatnonzero(broken)
    return float(sum(broken[circular] * cumulative_probability(n, int(circular)) for circular in different))


def broken_ties(preferred: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the share of the ways of breaking the ties of a complete design that give 0, 1, 2, … circular triads.

    Parameters
    ----------
    preferred : float64 (n, n), as from `preference_matrix`

    Returns
    -------
    float64 (Tmax + 1,), or None for fewer than three items, and with too many ties to break them in all ways
    """
    n = len(preferred)
    ties = np.argwhere(np.triu(preferred == 0.5))
    if n < 3 or len(ties) > MAX_BROKEN_TIES:
        return None
    counts = _broken_counts(preferred, ties)
    return np.bincount(counts, minlength=max_circular(n) + 1) / len(counts)


def _broken_counts(preferred: NDArray[np.float64], ties: NDArray[np.intp]) -> NDArray[np.int64]:
    """Return the number of circular triads for every way of breaking the ties, int64 (2^t,), from the win counts."""
    n = len(preferred)
    wins = np.nansum(preferred == 1, axis=1)
    ways = np.arange(2 ** len(ties))[:, None] >> np.arange(len(ties)) & 1  # (2^t, t)
    points = np.tile(wins, (len(ways), 1))
    for column, (first, second) in enumerate(ties):
        points[:, first] += ways[:, column]
        points[:, second] += 1 - ways[:, column]
    return circular_from_wins(points, n)


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


def cumulative_probability(n: int, circular: int) -> float:
    """Return P(T <= circular) for random votes on n items.

    Source
    ------
    Kendall and Babington Smith (1940): exact by enumeration, else chi-square with a correction of one half.
    """
    if n <= EXACT_UP_TO:
        return float(np.sum(circular_distribution(n)[: circular + 1]))
    return approximate_probability(n, circular)


def approximate_probability(n: int, circular: int) -> float:
    """Return P(T <= circular) for random votes on n > 4 items by the chi-square approximation."""
    df = n * (n - 1) * (n - 2) / (n - 4) ** 2
    return float(chi2.sf(8 / (n - 4) * (comb(n, 3) / 4 - circular - 0.5) + df, df))


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


def smallest_p_value(rows: Sequence[Triads]) -> float:
    """Return `pooled_p_value` without any contradiction; with few triads it is far above 0.

    A dataset of 3 items gives 0.75, of 4 items 0.375, of 5 items 0.117, of 6 items 0.022; datasets multiply.
    """
    return float(np.prod([circular_distribution(row.n_items)[0] for row in rows]))


def pooled_p_value(rows: Sequence[Triads]) -> float | None:
    """Return P(sum of T <= observed sum) of a participant over datasets, by convolving the exact distributions.

    Returns
    -------
    float, or None if a row is incomplete, has too many ties to break, or has more than ten items
    """
    if not rows or any(not row.broken or row.n_items > EXACT_UP_TO for row in rows):
        return None
    random = observed = np.ones(1)
    for row in rows:
        random = np.convolve(random, circular_distribution(row.n_items))
        observed = np.convolve(observed, np.array(row.broken))
    return float(np.sum(observed * np.cumsum(random)))

"""Count votes per pair of items, the sufficient statistics of every fit; afterwards a fit costs the same for a hundred
votes as for millions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.votes_table import VotesTable

Array = NDArray[np.float64]
Index = NDArray[np.intp]

FEW_CODES, CODES_PER_VOTE = 10_000, 4  # possible (outcome, first, second) to count into a table; more are sorted


@dataclass(frozen=True)
class PairCounts:
    """Votes per pair of items.

    Parameters
    ----------
    first, second : int (C,), the two items of each pair; each unordered pair appears once, unless `is_ordered`
    wins, losses, ties : float64 (C,) or (B, C), votes for the first, for the second, and for neither; B tables of votes
        on the same pairs
    is_ordered : was `first` shown first? A pair can then appear in both orders
    """

    n_items: int
    first: Index
    second: Index
    wins: Array
    losses: Array
    ties: Array
    is_ordered: bool = False

    @property
    def totals(self) -> Array:
        """Number of votes on each pair, float64 (…, C)."""
        return self.wins + self.losses + self.ties


def outcome_index(votes: VotesTable, *, is_ordered: bool) -> tuple[Index, Index, Index]:
    """Return first item, second item and outcome (0 first, 1 second, 2 neither) of each row, each intp (N,).

    With `is_ordered`, the first item is the item shown first (`item_a` where that was not recorded).
    """
    first, second = votes.item_a.astype(np.intp), votes.item_b.astype(np.intp)
    outcome = votes.choice.astype(np.intp)
    return exchanged(votes.first_shown == 1, first, second, outcome) if is_ordered else (first, second, outcome)


def exchanged(rows: NDArray[np.bool_], first: Index, second: Index, outcome: Index) -> tuple[Index, Index, Index]:
    """Exchange the two items of some rows, and turn the outcome.

    Parameters
    ----------
    rows : bool (N,), which
    first, second, outcome : intp (N,) each, as `outcome_index` returns them
    """
    turned = np.where(rows & (outcome < 2), 1 - outcome, outcome)
    return np.where(rows, second, first), np.where(rows, first, second), turned


def count_pairs(votes: VotesTable, *, is_ordered: bool = False) -> PairCounts:
    """Count the votes of each pair.

    Parameters
    ----------
    is_ordered : count the two orders of showing separately, as an order effect needs
    """
    n = len(votes.items)
    if 3 * n * n <= max(FEW_CODES, CODES_PER_VOTE * len(votes)):
        table = _count_dense(votes, n, is_ordered=is_ordered)
        if not is_ordered:
            table = _fold(table)
        first, second = np.nonzero(table.any(axis=0))
        wins, losses, ties = table[:, first, second]
        return PairCounts(n, first, second, wins, losses, ties, is_ordered)
    return _count_sparse(votes, n, is_ordered=is_ordered)


def _count_dense(votes: VotesTable, n: int, *, is_ordered: bool) -> Array:
    """Return how often each outcome happened to (first, second), float64 (3, n, n)."""
    if is_ordered:
        first, second, outcome = outcome_index(votes, is_ordered=True)
        code = (outcome * n + first) * n + second
    else:
        code = votes.choice * np.int32(n * n)
        code += votes.item_a * np.int32(n)
        code += votes.item_b
    return (
        np.bincount(code, None if is_single(votes.count) else votes.count, minlength=3 * n * n)
        .reshape(3, n, n)
        .astype(np.float64)
    )


def is_single(count: NDArray[np.int64]) -> bool:
    """Does every row of `count`, int64 (N,), stand for one vote? A broadcast scalar is not read through."""
    seen = count[:1] if count.strides == (0,) else count
    return bool(seen.size and seen.min() == seen.max() == 1)


def _fold(table: Array) -> Array:
    """Add the pairs (second, first) to (first, second) and keep the upper triangle."""
    folded = np.stack([table[0] + table[1].T, table[1] + table[0].T, table[2] + table[2].T])
    return np.triu(folded, 1)


def _count_sparse(votes: VotesTable, n: int, *, is_ordered: bool) -> PairCounts:
    first, second, outcome = outcome_index(votes, is_ordered=is_ordered)
    if not is_ordered:
        first, second, outcome = exchanged(first > second, first, second, outcome)
    pairs, pair = np.unique(first * n + second, return_inverse=True)
    table = np.bincount(outcome * len(pairs) + pair, votes.count, minlength=3 * len(pairs)).reshape(3, -1)
    return PairCounts(n, pairs // n, pairs % n, table[0], table[1], table[2], is_ordered)

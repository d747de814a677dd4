"""Compare conditions that votes separate, where the difference of their scores has no finite estimate.

Conditions of one group are compared by the scores of that group alone. Two conditions of different groups have an exact
sign test over participants, and an interval that is open on one side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import binomtest

from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.contrasts import BY_SCORES, MOST_ITEMS, NEVER_COMPARED, Contrast, contrasts, holm
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.settings import LEVEL
from app.analysis.reading.votes_table import NONE, VotesTable, only_compared

Counts = NDArray[np.int64]

IN_THE_GROUP = "difference of scores in the group"
SIGN_TEST = {True: "sign test over participants", False: "sign test over votes"}  # are participants known?
FARTHEST = 50.0  # log-odds, between which limits are searched


class SignCounts(NamedTuple):
    """Who prefers which of two items, of each pair of items: int64 (n, n), for the row's item against the column's.

    Parameters
    ----------
    units : participants with more votes for the row's item than for the column's; votes where participants are unknown
    votes : votes for the row's item
    judged : bool (n, n), was the pair compared at all?
    """

    units: Counts
    votes: Counts
    judged: NDArray[np.bool_]


def group_fits(fit: Fit, votes: VotesTable) -> list[Fit]:
    """Return the fits of the groups that votes set apart, each to the votes within the group.

    In the limit in which the groups move apart, the likelihood of all votes has the same maximum within a group, but
    for a tie parameter that the groups would share.

    Parameters
    ----------
    fit : Fit with status `separated`
    votes : VotesTable, the votes it was fitted to

    Returns
    -------
    list of Fit, of groups with two items or more whose scores have a maximum
    """
    alone = [fit_scores(within, ties=fit.ties) for within in votes_within_groups(fit, votes)]
    return [each for each in alone if each.status == "ok"]


def votes_within_groups(fit: Fit, votes: VotesTable) -> list[VotesTable]:
    """Return the votes within each of a fit's groups that has two items or more, with its items alone.

    Parameters
    ----------
    fit : Fit with status `separated` or `disconnected`
    votes : VotesTable, the votes it was fitted to
    """
    group_of = {item: number for number, group in enumerate(fit.groups) for item in group}
    group = np.array([group_of[item] for item in votes.items])
    parts = [
        votes.where((group[votes.item_a] == number) & (group[votes.item_b] == number))
        for number in range(len(fit.groups))
    ]
    return [only_compared(part) for part in parts if len(part)]


def separated_contrasts(fit: Fit, votes: VotesTable, groups: Sequence[Fit]) -> list[Contrast]:
    """Compare every pair of items; empty with one participant, who says nothing about others, or with too many items.

    Parameters
    ----------
    fit : Fit with status `separated`; its penalised scores give the differences between groups
    votes : VotesTable, the votes it was fitted to
    groups : as from `group_fits`

    Returns
    -------
    list of Contrast, corrected by Holm's method for all pairs that have a test; a pair of different groups that was
    never compared has none, and a p-value of 1
    """
    if fit.n_participants == 1 or len(fit.items) > MOST_ITEMS:
        return []
    within = {(row.item_a, row.item_b): row for group in groups for row in contrasts(group)}
    signs = sign_counts(votes)
    rows = [
        _in_group(within[pair]) if pair in within else _by_signs(fit, signs, *places) for pair, places in _pairs(fit)
    ]
    tested = [number for number, row in enumerate(rows) if row.method != NEVER_COMPARED]
    corrected = holm(np.array([rows[number].p_value for number in tested]))
    for number, p_holm in zip(tested, corrected.tolist(), strict=True):
        rows[number] = replace(rows[number], p_holm=p_holm)
    return rows


def _in_group(row: Contrast) -> Contrast:
    return replace(row, method=IN_THE_GROUP) if row.method == BY_SCORES else row


def _pairs(fit: Fit) -> Iterator[tuple[tuple[str, str], tuple[int, int]]]:
    """Yield the names and places of all pairs of items."""
    for a, b in zip(*np.triu_indices(len(fit.items), 1), strict=True):
        yield (fit.items[a], fit.items[b]), (int(a), int(b))


def sign_counts(votes: VotesTable) -> SignCounts:
    """Count who prefers which of two items. Votes without preference do not count."""
    n, pair = len(votes.items), votes.pair
    sign = np.where(votes.choice == NONE, 0, np.where(votes.prefers_lower, 1, -1))
    by_vote = _both_ways(pair, sign, votes.count, n)
    judged = np.zeros((n, n), bool)
    judged[votes.item_a, votes.item_b] = judged[votes.item_b, votes.item_a] = True
    if not votes.has_participants:
        return SignCounts(by_vote, by_vote, judged)
    units, unit = np.unique(votes.participant.astype(np.int64) * n * n + pair, return_inverse=True)
    majority = np.sign(np.bincount(unit, sign * votes.count)).astype(np.int64)
    return SignCounts(_both_ways(units % (n * n), majority, np.ones_like(units), n), by_vote, judged)


def _both_ways(pair: Counts, sign: Counts, count: Counts, n: int) -> Counts:
    """Return how often the row's item is preferred to the column's, int64 (n, n), of pairs low * n + high."""
    first, second = (np.bincount(pair, (sign == side) * count, n * n).reshape(n, n) for side in (1, -1))
    return (first + second.T).astype(np.int64)


def _by_signs(fit: Fit, signs: SignCounts, a: int, b: int) -> Contrast:
    """Compare two items by an exact sign test; the difference is that of the penalised scores."""
    assert fit.scores is not None
    difference = float(fit.scores[a] - fit.scores[b])
    for_a, for_b = int(signs.units[a, b]), int(signs.units[b, a])
    p_value = float(binomtest(for_a, for_a + for_b).pvalue) if for_a + for_b else 1.0
    low = _limit(fit, for_a) if for_a and not signs.votes[b, a] else None
    high = -_limit(fit, for_b) if for_b and not signs.votes[a, b] else None
    method = SIGN_TEST[fit.n_participants is not None] if signs.judged[a, b] else NEVER_COMPARED
    return Contrast(fit.items[a], fit.items[b], difference, None, p_value, 1.0, low, high, method)


def _limit(fit: Fit, n_units: int) -> float:
    """Return the lower 95 % limit of a difference, log-odds, if all of `n_units` always prefer the first item.

    Somebody drawn at random prefers it in a share q of decided votes. All votes of all units go its way with a
    probability of at most q^n, however alike the votes of a person are, so q is at least 0.05^(1/n).

    Source
    ------
    Clopper and Pearson (1934), for n successes of n.
    """
    share = (1 - LEVEL) ** (1 / n_units)
    limit: float = brentq(lambda d: float(fit.preference(np.array([d]))[0]) - share, -FARTHEST, FARTHEST)
    return limit

"""Measure agreement between participants (Kendall's u), transitivity of preferences, and agreement between datasets
(rank correlations, Kendall's W).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, rankdata

from app.analysis.model.likelihood.counts import PairCounts, count_pairs
from app.analysis.reading.votes_table import ALL, VotesTable, numbered, only_compared
from app.analysis.screening.correlation import defined, kendall, pearson, spearman

BETWEEN_DATASETS = {"pearson": pearson, "spearman": spearman, "kendall": kendall}
MOST_ORDERS, FEWEST_ORDERS = 999, 199  # of items' names, tried at random
WORK = 10_000_000  # numbers permuted, about 0.3 s
TOGETHER = 500_000  # of them in memory
ROUNDING = 1e-9
LARGEST_TRANSITIVITY = 60  # items; 34 220 triples


@dataclass(frozen=True)
class Agreement:
    """Kendall's u with its test; all None where the design does not allow it."""

    u: float | None
    u_min: float | None
    chi2: float | None
    df: float | None
    p_value: float | None
    votes_per_pair: int | None


NO_AGREEMENT = Agreement(None, None, None, None, None, None)


def agreement(counts: PairCounts) -> Agreement:
    """Return Kendall's coefficient of agreement.

    Parameters
    ----------
    counts : PairCounts, every pair judged by the same number of participants, without ties; else all fields are None

    Source
    ------
    Kendall and Babington Smith (1940), sections 13 to 17: u = 2 Sigma / (C(m,2) C(n,2)) - 1 with Sigma the number of
    pairs of participants who agree on a pair of items; the chi-square approximation has a continuity correction of one.
    """
    n_pairs, totals = comb(counts.n_items, 2), counts.totals
    if (
        len(counts.first) < n_pairs
        or n_pairs == 0
        or counts.ties.any()
        or totals.min() != totals.max()
        or totals[0] < 2
    ):
        return NO_AGREEMENT
    m = int(totals[0])
    agreeing = float(np.sum(counts.wins * (counts.wins - 1) + counts.losses * (counts.losses - 1)) / 2)
    u = 2 * agreeing / (comb(m, 2) * n_pairs) - 1
    minimum = -1 / (m - 1) if m % 2 == 0 else -1 / m
    if m == 2:
        return Agreement(u, minimum, None, None, None, m)
    x2 = 4 / (m - 2) * (agreeing - 1 - n_pairs * comb(m, 2) * (m - 3) / (m - 2) / 2)
    df = n_pairs * m * (m - 1) / (m - 2) ** 2
    return Agreement(u, minimum, x2, df, float(chi2.sf(x2, df)), m)


def transitivity(counts: PairCounts) -> dict[str, int] | None:
    """Count the violations of weak, moderate and strong stochastic transitivity over triples of items.

    For P(a over b) >= 1/2 and P(b over c) >= 1/2, P(a over c) should be at least 1/2 (weak), the smaller (moderate)
    or the larger (strong) of the two. A tie counts half for each.

    Returns
    -------
    dict, `weak`, `moderate`, `strong` and `n_triples`; None for too many items

    Source
    ------
    Suppes, Krantz, Luce and Tversky (1989), chapter 17.
    """
    n = counts.n_items
    if n > LARGEST_TRANSITIVITY:
        return None
    share = np.full((n, n), np.nan)
    share[counts.first, counts.second] = (counts.wins + counts.ties / 2) / counts.totals
    share[counts.second, counts.first] = (counts.losses + counts.ties / 2) / counts.totals
    violations = {"weak": 0, "moderate": 0, "strong": 0, "n_triples": 0}
    for triple in combinations(range(n), 3):
        broken = _broken(share, triple)
        if broken is not None:
            violations["n_triples"] += 1
            for name, is_broken in zip(("weak", "moderate", "strong"), broken, strict=True):
                violations[name] += is_broken
    return violations


def _broken(share: NDArray[np.float64], triple: tuple[int, ...]) -> tuple[bool, bool, bool] | None:
    """Return which kinds some order of the triple violates whose premise it meets; None if a pair was not compared."""
    x, y, z = triple
    if np.isnan(share[x, y] + share[y, z] + share[x, z]):
        return None
    orders = [(x, y, z), (x, z, y), (y, x, z), (y, z, x), (z, x, y), (z, y, x)]
    weak = moderate = strong = False
    for a, b, c in orders:
        first, second, across = share[a, b], share[b, c], share[a, c]
        if first >= 0.5 and second >= 0.5:
            weak |= bool(across < 0.5)
            moderate |= bool(across < min(first, second))
            strong |= bool(across < max(first, second))
    return weak, moderate, strong


def _has_repeats(votes: VotesTable) -> bool:
    """Did a participant judge a pair more than once? Kendall's u would then count them as agreeing with themselves."""
    if not votes.has_participants:
        return False
    key = np.sort(votes.participant.astype(np.int64) * len(votes.items) ** 2 + votes.pair)
    return bool((key[1:] == key[:-1]).any() or (votes.count > 1).any())


def agreement_rows(votes: VotesTable) -> list[dict[str, Any]]:
    """Return agreement and transitivity of each named dataset; of all votes where datasets have no names."""
    names = [(name, votes.where(votes.dataset == index)) for index, name in enumerate(votes.datasets) if name]
    rows = []
    for name, part in names or [(ALL, votes)]:
        if len(part):
            counts = count_pairs(only_compared(part))
            kendall_u = NO_AGREEMENT if _has_repeats(part) else agreement(counts)
            rows.append({"dataset": name, **asdict(kendall_u), "transitivity": transitivity(counts)})
    return rows


def dataset_agreement_rows(scores: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Correlate the scores of every two datasets over the items they share.

    Parameters
    ----------
    scores : mapping, dataset -> item -> score

    Returns
    -------
    list of dict, `dataset_a, dataset_b, n_items, pearson, spearman, kendall`; a correlation is None for fewer than
    three shared items, or where the scores of a dataset do not differ
    """
    rows = []
    for first, second in combinations(scores, 2):
        shared = [item for item in scores[first] if item in scores[second]]
        values, others = (np.array([scores[dataset][item] for item in shared]) for dataset in (first, second))
        rows.append(
            {"dataset_a": first, "dataset_b": second, "n_items": len(shared)}
            | {name: defined(correlation, values, others) for name, correlation in BETWEEN_DATASETS.items()}
        )
    return rows


def concordance(scores: Mapping[str, Mapping[str, float]], votes: VotesTable) -> dict[str, Any] | None:
    """Return Kendall's coefficient of concordance W between the datasets' orders of the items, with its test.

    Parameters
    ----------
    scores : mapping, dataset -> item -> score
    votes : VotesTable, the votes that the scores are made of

    Returns
    -------
    dict, `n_datasets, n_items, w, chi2, df, p_value`; W is 1 if all datasets order the items alike and 0 if all mean
    ranks are equal. None unless at least two datasets have scores of the same items, three or more.

    Source
    ------
    Kendall and Babington Smith (1939), with their correction for tied ranks; chi2 = m (n - 1) W. Its distribution with
    n - 1 degrees of freedom takes datasets as independent, which they are not where the same people judge all of
    them; `p_value` is that of `concordance_p_value`.
    """
    items = list(next(iter(scores.values()), {}))
    if (
        len(scores) < 2
        or len(items) < 3
        or any(set(dataset_scores) != set(items) for dataset_scores in scores.values())
    ):
        return None
    m, n = len(scores), len(items)
    ranks = np.array([rankdata([dataset_scores[item] for item in items]) for dataset_scores in scores.values()])
    w = float(kendall_w(ranks))
    if np.isnan(w):
        return None
    p_value = concordance_p_value(votes, list(scores))
    return {"n_datasets": m, "n_items": n, "w": w, "chi2": m * (n - 1) * w, "df": n - 1, "p_value": p_value}


def kendall_w(ranks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return W, float64 (…), of the ranks of n items on m datasets, float64 (…, m, n); NaN if all are tied."""
    m, n = ranks.shape[-2:]
    spread = np.sum((ranks.sum(axis=-2) - m * (n + 1) / 2) ** 2, axis=-1)
    # The variance of a dataset's ranks falls short of (n^2 - 1) / 12 by the ties' sum of (t^3 - t) / (12 n).
    most = m * n * np.sum(np.var(ranks, axis=-1), axis=-1)
    return np.asarray(np.where(most > 0, spread / np.where(most > 0, most, 1), np.nan))


def concordance_p_value(votes: VotesTable, datasets: Sequence[str]) -> float | None:
    """Return how often datasets agree as much if no participant's preferences go with the items.

    The names of the items are permuted for each participant, the same way on all datasets. So whatever a person
    prefers on all of them stays together. The statistic is W of the ranks of the items' shares of won votes.

    Parameters
    ----------
    votes : VotesTable
    datasets : names of those to compare

    Returns
    -------
    float; None where participants are unknown, or fewer than two
    """
    shares = _shares(votes, datasets)
    if not votes.has_participants or len(shares) < 2:
        return None
    n_orders = int(np.clip(WORK // shares.size, FEWEST_ORDERS, MOST_ORDERS))
    rng = np.random.default_rng(len(shares))
    observed = float(_concordance_of(shares.sum(axis=0)))
    n_people, n_items = shares.shape[:2]
    as_much, people = 1, np.arange(n_people)[:, None]
    size = max(1, TOGETHER // shares.size)
    for start in range(0, n_orders, size):
        orders = np.argsort(rng.random((min(size, n_orders - start), n_people, n_items)), axis=-1)
        renamed = shares[people, orders].sum(axis=1)
        as_much += int(np.count_nonzero(_concordance_of(renamed) >= observed - ROUNDING))
    return as_much / (n_orders + 1)


def _shares(votes: VotesTable, datasets: Sequence[str]) -> NDArray[np.float64]:
    """Return each participant's points and votes of every item, float64 (J, n, 2, D); a tie is half a point."""
    place = np.array([list(datasets).index(name) if name in datasets else -1 for name in votes.datasets])
    kept = votes.where(place[votes.dataset] >= 0)
    present, who = numbered(kept.participant, len(kept.participants))
    n_people, n_datasets, n = len(present), len(datasets), len(votes.items)
    unit = (who * n_datasets + place[kept.dataset]) * n
    points = np.array([1.0, 0.0, 0.5])[kept.choice] * kept.count
    sides = ((kept.item_a, points), (kept.item_b, kept.count - points))
    size = n_people * n_datasets * n
    won = sum(np.bincount(unit + item, weight, size) for item, weight in sides)
    cast = sum(np.bincount(unit + item, kept.count, size) for item, _ in sides)
    result = np.stack([won, cast]).reshape(2, n_people, n_datasets, n).transpose(1, 3, 0, 2)
    return np.ascontiguousarray(result[:, result[:, :, 1].any(axis=(0, 2))])


def _concordance_of(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return W, float64 (…), of everybody's points and votes, float64 (…, n, 2, D); 0 if all items are alike."""
    points, n_votes = np.moveaxis(sums, (-2, -3), (0, -1))  # each (…, D, n)
    return np.nan_to_num(kendall_w(rankdata(points / np.maximum(n_votes, 1), axis=-1)))

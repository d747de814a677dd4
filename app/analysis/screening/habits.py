"""Weigh what somebody's habits say for carelessness: attention checks, the share of ties, speed, sides and orders.

How much tie rates and times vary among honest people, and how often these pass the checks, is told by the panel itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln

from app.analysis.model.showing_order import MOST_CONFOUNDED, confounded_share
from app.analysis.reading.votes_table import NONE, A, VotesTable
from app.analysis.screening.vote_evidence import SIMULATED

Array = NDArray[np.float64]
Weighed = tuple[Array, Array, list[str]] | None  # ratios of participants and of careless people, and words

OUTSIDE = 0.1  # share of honest people of whom the panel's rates and times tell nothing
UNUSUAL = 0.3  # share of careless people whose tie rate is any
RANDOM_NONE = (1.0, 2.0)  # beta distribution of "no preference" of a careless person on identical films
RANDOM_SAME = (8.0, 12.0)  # of the same answer again: with 40, 40 and 20 % of the answers it comes in 36 %
PASSES, PASSES_VOTES = 0.95, 10.0  # of checks, before anything is known of a panel, and the weight of that
CHECKS_SPREAD = 30.0  # votes; honest people's rates vary as a beta distribution of this size does
FASTER, FAST_SPREAD, LEAST_TIME_SPREAD = 1.0, 0.7, 0.25  # of log times: careless ones are e times faster


def _beta_binomial(k: Array, n: Array, a: Array | float, b: Array | float) -> Array:
    """Return the log-probability of an ordered run of n answers with k of one kind, whose rate is beta distributed."""
    return np.asarray(betaln(k + a, n - k + b) - betaln(a, b))


def of_checks(
    names: Sequence[str], checks: Mapping[str, Mapping[str, Any]], kept: NDArray[np.bool_], rng: np.random.Generator
) -> Weighed:
    """Weigh the answers on identical and on repeated pairs against those of all others.

    Parameters
    ----------
    names : of the J participants
    checks : participant -> row of `check_rows`
    kept : bool (J,), those who tell what honest people do
    rng : Generator
    """
    if not checks:
        return None
    nothing = {"n_identical": 0, "n_identical_none": 0, "n_repeated": 0, "n_repeated_same": 0}
    rows = [checks.get(name, nothing) for name in names]
    total, random, said = np.zeros(len(names)), np.zeros(SIMULATED), [""] * len(names)
    kinds = (
        ("n_identical", "n_identical_none", RANDOM_NONE, "identical pairs told apart"),
        ("n_repeated", "n_repeated_same", RANDOM_SAME, "repeated pairs answered otherwise"),
    )
    for asked, passed, careless, words in kinds:
        n, k = (np.array([float(row[name]) for row in rows]) for name in (asked, passed))
        if not n.any():
            continue
        others_n, others_k = ((kept * part).sum() - kept * part for part in (n, k))
        rate = (others_k + PASSES * PASSES_VOTES) / (others_n + PASSES_VOTES)
        a, b = rate * CHECKS_SPREAD, (1 - rate) * CHECKS_SPREAD
        total += _beta_binomial(k, n, *careless) - _beta_binomial(k, n, a, b)
        design = rng.integers(0, len(names), SIMULATED)
        drawn = rng.binomial(n[design].astype(int), rng.beta(*careless, SIMULATED)).astype(float)
        random += _beta_binomial(drawn, n[design], *careless) - _beta_binomial(drawn, n[design], a[design], b[design])
        for row in np.flatnonzero(k < n):
            failed = f"{int(n[row] - k[row])} of {int(n[row])} {words}"
            said[row] = f"{said[row]}, {failed}" if said[row] else failed
    return total, random, said


def of_ties(
    votes: VotesTable, who: NDArray[np.intp], n_people: int, kept: NDArray[np.bool_], rng: np.random.Generator
) -> Weighed:
    """Weigh how often somebody has no preference against the rates of the panel, which vary.

    Parameters
    ----------
    votes, who, n_people : as in `panel_of`; who is intp (N,)
    kept : bool (J,), those who tell what honest people do
    rng : Generator
    """
    n = np.bincount(who, votes.count, n_people).astype(np.float64)
    k = np.bincount(who, votes.count * (votes.choice == NONE), n_people).astype(np.float64)
    if not k.any() or n_people < 5:
        return None
    rates, size = (k / n)[kept], n[kept].mean()
    mean = float((k[kept].sum() + 0.5) / (n[kept].sum() + 1))
    surplus = float(rates.var(ddof=1)) - mean * (1 - mean) / size
    strength = float(np.clip(mean * (1 - mean) / max(surplus, 1e-6) - 1, 2.0, 50.0))
    a, b = mean * strength, (1 - mean) * strength

    def ratio(k: Array, n: Array) -> Array:
        usual, any_rate = _beta_binomial(k, n, a, b), _beta_binomial(k, n, 1, 1)
        careless = np.logaddexp(np.log(1 - UNUSUAL) + usual, np.log(UNUSUAL) + any_rate)
        honest = np.logaddexp(np.log(1 - OUTSIDE) + usual, np.log(OUTSIDE) + any_rate)
        return np.asarray(careless - honest)

    design = n[rng.integers(0, n_people, SIMULATED)]
    rate = np.where(rng.random(SIMULATED) < UNUSUAL, rng.random(SIMULATED), rng.beta(a, b, SIMULATED))
    drawn = rng.binomial(design.astype(int), rate).astype(float)
    said = [f"{int(tied)} of {int(cast)} votes without preference" for tied, cast in zip(k, n, strict=True)]
    return ratio(k, n), ratio(drawn, design), said


def of_speed(
    votes: VotesTable, who: NDArray[np.intp], n_people: int, kept: NDArray[np.bool_], rng: np.random.Generator
) -> Weighed:
    """Weigh how fast somebody answers against the median of the panel, on logarithms.

    Parameters
    ----------
    votes, who, n_people : as in `panel_of`; who is intp (N,)
    kept : bool (J,), those who tell what honest people do
    rng : Generator
    """
    known = votes.response_ms > 0
    if n_people < 5 or not known.any():
        return None
    order = np.argsort(who[known], kind="stable")
    ends = np.cumsum(np.bincount(who[known], minlength=n_people))
    logs = np.split(np.log(votes.response_ms[known])[order], ends[:-1])  # of each person
    medians = np.array([np.median(times) if len(times) else np.nan for times in logs])
    there = kept & ~np.isnan(medians)
    if there.sum() < 5:
        return None
    centre = float(np.median(medians[there]))
    spread = max(1.4826 * float(np.median(np.abs(medians[there] - centre))), LEAST_TIME_SPREAD)

    def ratio(value: Array) -> Array:
        careless = -0.5 * ((value - centre + FASTER) / FAST_SPREAD) ** 2 - np.log(FAST_SPREAD)
        honest = -0.5 * ((value - centre) / spread) ** 2 - np.log(spread)
        honest = np.logaddexp(np.log(1 - OUTSIDE) + honest, np.log(OUTSIDE) + np.logaddexp(careless, honest))
        return np.where(value < centre, careless - honest, 0.0)

    drawn = centre - FASTER + FAST_SPREAD * rng.standard_normal(SIMULATED)
    said = [
        "" if np.isnan(value) else f"half of the answers took less than {np.exp(value) / 1000:.1f} s"
        for value in medians
    ]
    return np.where(np.isnan(medians), 0.0, ratio(np.nan_to_num(medians))), ratio(drawn), said


def of_sides(
    votes: VotesTable, who: NDArray[np.intp], n_people: int, by_coin: Array | None
) -> tuple[int, Array, list[str]] | None:
    """Return how many kinds of places a careless person could click, and the ratio of the best to a coin.

    A place is a side, or what was shown first; it counts where every condition was there as often as elsewhere.

    Parameters
    ----------
    votes, who, n_people : as in `panel_of`; who is intp (N,)
    by_coin : float64 (J,), log likelihood ratios of the votes, which a side's replaces; None: nothing is known
    """
    if by_coin is None:
        return None
    decided = votes.choice != NONE
    kinds: list[tuple[str, NDArray[np.bool_], NDArray[np.bool_]]] = []
    sides = np.zeros(len(votes), np.int8)
    for name, first, chosen in (
        ("one side (item_a)", sides, votes.choice == A),
        ("what was shown first", votes.first_shown, votes.choice == votes.first_shown),
    ):
        known = decided & (first >= 0)
        if known.any():
            placed = votes.where(known)
            swapped = VotesTable(**{**vars(placed), "first_shown": first[known]})
            if confounded_share(swapped) < MOST_CONFOUNDED / 5:
                kinds.append((name, known, chosen))
    if not kinds:
        return None
    best, said = np.full(n_people, -np.inf), [""] * n_people
    for name, known, chosen in kinds:
        n = np.bincount(who[known], votes.count[known], n_people).astype(np.float64)
        k = np.bincount(who[known], (votes.count * chosen)[known], n_people).astype(np.float64)
        ratio = _beta_binomial(k, n, 1, 1) + n * np.log(2)
        for row in np.flatnonzero(ratio > best):
            best[row], said[row] = ratio[row], f"{int(k[row])} of {int(n[row])} decided votes for {name}"
    return len(kinds), best, said

"""Weigh how much likelier a participant's answers are from somebody who answers carelessly than from somebody who
answers as the others do, with opinions and noise of their own.

Evidence comes from attention checks, from votes against the scores of all others, from sides and orders, from the share
of ties, and from speed. What an honest participant does is told by the panel itself: how far opinions differ, how much
tie rates and times vary, how often the others pass the checks. Where conditions hardly differ, honest votes look like
random ones, and then votes say nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln

from app.analysis.model.bradley_terry import fit_counts
from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.model.showing_order import MOST_CONFOUNDED, confounded_share
from app.analysis.reading.votes_table import NONE, A, VotesTable, numbered, only_compared

Array = NDArray[np.float64]

FALSE_ALARMS = 0.05  # expected in a whole study of honest people, below which somebody is named
FEWEST_PEOPLE = 5  # fewer tell nothing about what the others do
DRAWS, QUICK, FEWEST_DRAWS = 600, 150, 60  # honest people whose votes a participant's are compared with
SIMULATED = 1000  # careless people, who tell how often honest ones look like them
TOGETHER = 1_000_000  # logits at once
WORK = 40_000_000  # participants times draws times cells, a second
MOST_ITEMS = 60  # above, a person's opinions have more dimensions than draws can follow
TRIMMED = (0.0, 1.0, 2.0, 2.0)  # log likelihood ratios, by round, above which somebody does not tell what honest do
MEDIAN = 0.87  # of a chi-square with five degrees of freedom, in units of its mean
NOISE = 0.2  # standard deviation of the logarithm of somebody's own noise
FEW = 8.0  # people, of whom the estimate of how far opinions differ has half its value again as error
LEAST_SPREAD = 0.2  # log-odds, of honest opinions, also where the votes show none
LEAST_APART = 0.15  # log-odds; datasets whose scores differ by less are taken together
DISSENTERS, DISSENT = 0.05, 2.0  # share of honest people with opinions that lie so many times farther apart
OUTSIDE = 0.1  # share of honest people of whom the panel's rates and times tell nothing
UNUSUAL = 0.3  # share of careless people whose tie rate is any
RANDOM_NONE = (1.0, 2.0)  # beta distribution of "no preference" of a careless person on identical films
RANDOM_SAME = (8.0, 12.0)  # of the same answer again: with 40, 40 and 20 % of the answers it comes in 36 %
PASSES, PASSES_VOTES = 0.95, 10.0  # of checks, before anything is known of a panel, and the weight of that
CHECKS_SPREAD = 30.0  # votes; honest people's rates vary as a beta distribution of this size does
FASTER, FAST_SPREAD, LEAST_TIME_SPREAD = 1.0, 0.7, 0.25  # of log times: careless ones are e times faster


@dataclass(frozen=True)
class Careless:
    """What speaks for carelessness of a participant.

    Parameters
    ----------
    log_ratio : natural logarithm of the likelihood ratio, careless to honest
    parts : that of each kind of evidence: votes, checks, ties, sides, speed
    false_alarms : honest people of this study, out of all, expected to look as careless
    words : the evidence, the strongest first
    """

    log_ratio: float
    parts: Mapping[str, float]
    false_alarms: float
    words: tuple[str, ...]

    @property
    def is_named(self) -> bool:
        """Is it to be said of this participant?"""
        return self.log_ratio > 0 and self.false_alarms < FALSE_ALARMS

    def as_dict(self) -> dict[str, Any]:
        """Return it as it stands in analysis.json."""
        return {
            "log_likelihood_ratio": self.log_ratio,
            "evidence": dict(self.parts),
            "false_alarms": self.false_alarms,
            "words": list(self.words),
        }


@dataclass(frozen=True)
class _Panel:
    """The decided votes of J participants on cells: pairs, on datasets apart where these differ.

    Parameters
    ----------
    wins, losses : float64 (J, C), for the first and the second item of a cell
    incidence : float64 (C, n), +1 for the first and -1 for the second item
    dataset : intp (C,)
    shown : float64 (C,), +1 where the first item was shown first, -1 where the second, 0 where it is unknown
    """

    wins: Array
    losses: Array
    incidence: Array
    dataset: NDArray[np.intp]
    shown: Array


def careless_answers(
    votes: VotesTable, checks: Sequence[Mapping[str, Any]], order_effect: float | None = None
) -> dict[str, Careless]:
    """Return what speaks for carelessness of each participant.

    Parameters
    ----------
    votes : VotesTable, the votes analysed
    checks : rows of `check_rows`
    order_effect : advantage of being shown first that the whole panel shows, log-odds; None where it shows none
    """
    if not votes.has_participants or not len(votes):
        return {}
    people, who = numbered(votes.participant, len(votes.participants))
    if len(people) < FEWEST_PEOPLE:
        return {}
    names = [votes.participants[index] for index in people]
    kept = np.ones(len(people), bool)
    by_name = {row["participant"]: row for row in checks}
    rng = np.random.default_rng(len(votes))
    panel = _panel(votes, who, len(people), order_effect)
    for limit in TRIMMED:
        total = _weighed(votes, who, names, by_name, panel, order_effect or 0.0, kept, rng, QUICK).total
        trimmed = total <= limit
        if (trimmed == kept).all() or trimmed.sum() < max(FEWEST_PEOPLE, len(people) / 2):
            break
        kept = trimmed
    evidence = _weighed(votes, who, names, by_name, panel, order_effect or 0.0, kept, rng, DRAWS)
    of_few = 1 + (FEW / len(people)) ** 2  # what honest people do is itself uncertain; eight err twice as often
    alarms = np.minimum(of_few * len(people) * evidence.chance, len(people))
    return {
        name: Careless(
            float(evidence.total[row]),
            {kind: float(values[row]) for kind, values in evidence.parts.items()},
            float(alarms[row]),
            _words(evidence, row),
        )
        for row, name in enumerate(names)
    }


@dataclass(frozen=True)
class _Evidence:
    """Log likelihood ratios of J participants, and the chance that an honest one reaches them.

    Parameters
    ----------
    parts : kind -> float64 (J,)
    total : float64 (J,)
    chance : float64 (J,)
    said : kind -> the evidence of each participant in words
    """

    parts: dict[str, Array]
    total: Array
    chance: Array
    said: dict[str, list[str]] = field(default_factory=dict)


def _weighed(
    votes: VotesTable,
    who: NDArray[np.intp],
    names: Sequence[str],
    checks: Mapping[str, Mapping[str, Any]],
    panel: _Panel | None,
    order_effect: float,
    kept: NDArray[np.bool_],
    rng: np.random.Generator,
    n_draws: int,
) -> _Evidence:
    """Weigh the evidence, with what the participants that are kept tell about honest ones."""
    n_people = len(names)
    random = np.zeros((SIMULATED,))
    parts: dict[str, Array] = {}
    said: dict[str, list[str]] = {}
    for kind, weighed in (
        ("checks", _checks(names, checks, kept, rng)),
        ("ties", _ties(votes, who, n_people, kept, rng)),
        ("speed", _speed(votes, who, n_people, kept, rng)),
    ):
        if weighed is not None:
            parts[kind], simulated, said[kind] = weighed
            random += simulated
    if panel is not None:
        seen = _against_scores(panel, order_effect, kept, rng, n_draws)
        if seen is not None:
            parts["votes"], simulated = seen
            random += simulated
            said["votes"] = [
                f"the votes are {_times(ratio)} likelier from a coin than from the scores of the others"
                for ratio in parts["votes"]
            ]
    total = np.sum(list(parts.values()), axis=0) if parts else np.zeros(n_people)
    chance = _honest_chance(total, random)
    sides = _sides(votes, who, n_people, parts.get("votes"))
    if sides is not None:
        place, by_side, said["sides"] = sides
        together = total + by_side
        better = together > total
        chance = np.minimum(2 * np.minimum(chance, np.exp(-np.maximum(together, 0.0)) * place), 1.0)
        parts["sides"] = np.where(better, by_side, 0.0)
        total = np.where(better, together, total)
    return _Evidence(parts, total, chance, said)


def _honest_chance(total: Array, random: Array) -> Array:
    """Return the chance that honest people reach a log likelihood ratio, float64 (J,).

    It is the mean, over careless people, of the inverse likelihood ratio of those who reach it; never more than the
    inverse of the ratio itself.
    """
    order = np.sort(random)
    beyond = np.cumsum(np.exp(-order[::-1]))[::-1]  # of the k-th and all larger
    place = np.searchsorted(order, total)
    chance = np.where(place < len(order), beyond[np.minimum(place, len(order) - 1)], 0.0) / len(order)
    bound = np.exp(-np.maximum(total, 0.0))
    return np.minimum(np.maximum(chance, bound / len(order)), bound)


def _panel(votes: VotesTable, who: NDArray[np.intp], n_people: int, order_effect: float | None) -> _Panel | None:
    """Count the decided votes; None with too few people or too many items to follow."""
    decided = votes.choice != NONE
    if n_people < 3 or not decided.any() or len(votes.items) > 4 * MOST_ITEMS:
        return None
    rows = votes.where(decided)
    compared = only_compared(rows)
    n = len(compared.items)
    if n > MOST_ITEMS:
        return None
    low_first = compared.item_a < compared.item_b
    place = rows.dataset.astype(np.int64) * n * n + compared.pair
    shown = np.zeros(len(rows))
    if order_effect is not None:
        shown = np.where(rows.first_shown < 0, 0.0, np.where((rows.first_shown == 0) == low_first, 1.0, -1.0))
    codes, cell = np.unique(place * 3 + (shown + 1).astype(np.int64), return_inverse=True)
    size = n_people * len(codes)
    unit = who[decided] * len(codes) + cell
    wins, losses = (
        np.bincount(unit, (compared.prefers_lower == side) * rows.count, size).reshape(n_people, -1).astype(np.float64)
        for side in (True, False)
    )
    pair, dataset = codes // 3 % (n * n), codes // 3 // (n * n)
    incidence = np.eye(n)[pair // n] - np.eye(n)[pair % n]
    return _Panel(wins, losses, incidence, dataset.astype(np.intp), codes % 3 - 1.0)


def _against_scores(
    panel: _Panel, order_effect: float, kept: NDArray[np.bool_], rng: np.random.Generator, n_draws: int
) -> tuple[Array, Array] | None:
    """Return the log likelihood ratios of votes, of participants (J,) and of people who vote at random (M,).

    Honest people have opinions of their own around the scores of all others, noise of their own, and may be far from
    the others; careless ones throw a coin.
    """
    n_people, n_cells = panel.wins.shape
    n_draws = int(np.clip(WORK // max(n_people * n_cells, 1), FEWEST_DRAWS, n_draws))
    honest = _honest_scores(panel, order_effect, kept)
    if honest is None:
        return None
    scores, spread, covariance = honest  # (J, D, n), log-odds, (n, n)
    if scores.shape[1] == 1:
        panel = _on_one_dataset(panel)
    n = panel.incidence.shape[1]
    roots = _root(covariance)
    far = np.where(rng.random(n_draws) < DISSENTERS, DISSENT, 1.0)
    opinions = spread * far[:, None] * rng.standard_normal((n_draws, n)) + rng.standard_normal((n_draws, n)) @ roots
    shifts = (opinions @ panel.incidence.T).astype(np.float32)
    noise = np.exp(NOISE * rng.standard_normal(n_draws)).astype(np.float32)[:, None]
    shift = order_effect * panel.shown
    centres = (np.einsum("jcn,cn->jc", scores[:, panel.dataset], panel.incidence) + shift).astype(np.float32)
    votes = panel.wins + panel.losses
    size = max(1, TOGETHER // shifts.size)
    of_votes = np.empty((n_people, n_draws))
    for start in range(0, n_people, size):
        rows = slice(start, start + size)
        logits = noise * (centres[rows, None] + shifts)
        of_votes[rows] = _loglik(logits, panel.wins[rows], votes[rows])
    design = votes[rng.integers(0, n_people, SIMULATED)]
    clicks = rng.binomial(design.astype(np.int64), 0.5).astype(np.float64)
    of_clicks = _loglik(noise * (centres.mean(axis=0) + shifts), clicks, design)
    return _coin(votes) - _mean(of_votes), _coin(design) - _mean(of_clicks)


def _coin(votes: Array) -> Array:
    return np.asarray(-np.log(2) * votes.sum(axis=1))


def _mean(logliks: Array) -> Array:
    """Return the logarithm of the mean likelihood over draws, float64 (M,)."""
    most = logliks.max(axis=1, keepdims=True)
    return np.asarray(most[:, 0] + np.log(np.exp(logliks - most).mean(axis=1)))


def _on_one_dataset(panel: _Panel) -> _Panel:
    """Return the votes of all datasets together."""
    kinds, cell = np.unique(np.c_[panel.incidence, panel.shown], axis=0, return_inverse=True)
    member = np.eye(len(kinds))[cell.ravel()]
    return _Panel(
        panel.wins @ member, panel.losses @ member, kinds[:, :-1], np.zeros(len(kinds), np.intp), kinds[:, -1]
    )


def _loglik(logits: NDArray[np.float32], wins: Array, votes: Array) -> Array:
    """Return the log-likelihood of each participant's votes (M, C) under each draw, float64 (M, K).

    Parameters
    ----------
    logits : float32 (K, C), or (M, K, C), of the first item of each cell
    """
    near = np.clip(logits, -30, 30)
    lost = np.log(1 + np.exp(near))
    if near.ndim == 2:
        result = wins.astype(np.float32) @ near.T - votes.astype(np.float32) @ lost.T
    else:
        result = (near @ wins.astype(np.float32)[..., None] - lost @ votes.astype(np.float32)[..., None])[..., 0]
    return np.asarray(result, np.float64)


def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _honest_scores(panel: _Panel, order_effect: float, kept: NDArray[np.bool_]) -> tuple[Array, float, Array] | None:
    """Return the scores of all others for each participant, how far opinions differ, and the scores' covariance.

    Opinions differ by as much as the participants' gradients vary beyond their own noise (a moment estimate); datasets
    shift the scores by as much as theirs do. Each participant is left out by a Newton step.

    Returns
    -------
    scores : float64 (J, D, n), log-odds; (J, 1, n) where datasets hardly differ
    spread : standard deviation, log-odds
    covariance : float64 (n, n)
    """
    fitted = _scores(panel, kept)
    if fitted is None:
        return None
    n_people, n = len(panel.wins), panel.incidence.shape[1]
    votes = panel.wins + panel.losses
    p = 1 / (1 + np.exp(-(panel.incidence @ fitted + order_effect * panel.shown)))
    residual = panel.wins - votes * p  # (J, C)
    weight = votes * (p * (1 - p))
    outer = (panel.incidence[:, :, None] * panel.incidence[:, None]).reshape(len(p), -1)
    of_people = (weight @ outer).reshape(n_people, n, n)
    gradients = residual @ panel.incidence
    information = of_people[kept].sum(axis=0)
    inverse, rank, n_kept = np.linalg.pinv(information, hermitian=True), n - 1, int(kept.sum())
    excess = _excess if not kept.all() else _typical_excess  # before careless people are left out, by the median
    spread = np.sqrt(excess(gradients[kept], of_people[kept], inverse, rank))
    influence = gradients @ inverse
    covariance = influence[kept].T @ influence[kept] * n_kept / max(n_kept - 1, 1)
    n_datasets = int(panel.dataset.max()) + 1
    member = np.eye(n_datasets)[panel.dataset]  # (C, D)
    by_dataset = np.einsum("jc,cd,cn->jdn", residual, member, panel.incidence, optimize=True)
    of_datasets = np.einsum("c,cd,cx->dx", weight[kept].sum(axis=0), member, outer, optimize=True).reshape(-1, n, n)
    together = by_dataset[kept].sum(axis=0)
    apart = _excess(together, of_datasets, inverse, rank) if n_datasets > 1 else 0.0
    without = kept[:, None] * 1.0
    scores = (fitted - without * influence * n_kept / max(n_kept - 1, 1))[:, None]
    if apart > LEAST_APART**2:
        scores = np.repeat(scores, n_datasets, axis=1)
        shrunk = np.linalg.inv(of_datasets + np.eye(n) / apart)
        scores = scores + np.einsum("dnm,jdm->jdn", shrunk, together - without[:, :, None] * by_dataset)
    spread = max(float(spread), LEAST_SPREAD) * np.sqrt(1 + (FEW / n_kept) ** 2)  # which few people hardly tell
    return scores, spread, covariance


def _excess(gradients: Array, information: Array, inverse: Array, rank: int) -> float:
    """Return the variance of shifts that make gradients (G, n) vary more than their information (G, n, n) says."""
    expected = rank * (1 - 1 / len(gradients))
    observed = float(np.einsum("gi,ij,gj->", gradients, inverse, gradients))
    gain = float(np.einsum("ij,gjk,gki->", inverse, information, information, optimize=True))
    return max(observed - expected, 0.0) / gain if gain > 0 else 0.0


def _typical_excess(gradients: Array, information: Array, inverse: Array, rank: int) -> float:
    """Return `_excess` by the median over gradients, which a few that are unlike the others do not move."""
    observed = float(np.median(np.einsum("gi,ij,gj->g", gradients, inverse, gradients))) / MEDIAN * len(gradients)
    gain = float(np.einsum("ij,gjk,gki->", inverse, information, information, optimize=True))
    return max(observed - rank * (1 - 1 / len(gradients)), 0.0) / gain if gain > 0 else 0.0


def _scores(panel: _Panel, kept: NDArray[np.bool_]) -> Array | None:
    """Fit the decided votes of some participants, float64 (n,), log-odds; None where no vote links the items."""
    n = panel.incidence.shape[1]
    first, second = panel.incidence.argmax(axis=1), panel.incidence.argmin(axis=1)
    wins, losses = (
        np.bincount(first * n + second, part[kept].sum(axis=0), n * n).reshape(n, n).astype(np.float64)
        for part in (panel.wins, panel.losses)
    )
    low, high = np.nonzero(wins + losses)
    counts = PairCounts(n, low, high, wins[low, high], losses[low, high], np.zeros(len(low)))
    try:
        fit = fit_counts(counts, tuple(map(str, range(n))), ties="drop")
    except RuntimeError:  # no estimate converged
        return None
    return fit.scores


Found = tuple[Array, Array, list[str]] | None


def _beta_binomial(k: Array, n: Array, a: Array | float, b: Array | float) -> Array:
    """Return the log-probability of an ordered run of n answers with k of one kind, whose rate is beta distributed."""
    return np.asarray(betaln(k + a, n - k + b) - betaln(a, b))


def _checks(
    names: Sequence[str], checks: Mapping[str, Mapping[str, Any]], kept: NDArray[np.bool_], rng: np.random.Generator
) -> Found:
    """Weigh the answers on identical and on repeated pairs against those of all others."""
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


def _ties(
    votes: VotesTable, who: NDArray[np.intp], n_people: int, kept: NDArray[np.bool_], rng: np.random.Generator
) -> Found:
    """Weigh how often somebody has no preference against the rates of the panel, which vary."""
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


def _speed(
    votes: VotesTable, who: NDArray[np.intp], n_people: int, kept: NDArray[np.bool_], rng: np.random.Generator
) -> Found:
    """Weigh how fast somebody answers against the median of the panel, on logarithms."""
    known = votes.response_ms > 0
    if n_people < 5 or not known.any():
        return None
    logs = np.log(np.where(known, votes.response_ms, 1.0))
    medians = np.array(
        [
            np.median(logs[known & (who == person)]) if (known & (who == person)).any() else np.nan
            for person in range(n_people)
        ]
    )
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


def _sides(
    votes: VotesTable, who: NDArray[np.intp], n_people: int, by_coin: Array | None
) -> tuple[int, Array, list[str]] | None:
    """Return how many kinds of places a careless person could click, and the ratio of the best to a coin.

    A place is a side, or what was shown first; it counts where every condition was there as often as elsewhere.
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


def _times(log_ratio: float) -> str:
    """Return a likelihood ratio in words."""
    return "a million times or more" if log_ratio > np.log(1e6) else f"{np.exp(log_ratio):.0f} times"


def _words(evidence: _Evidence, row: int) -> tuple[str, ...]:
    """Return the evidence for carelessness in words, the strongest first."""
    strongest = sorted(evidence.parts, key=lambda kind: -evidence.parts[kind][row])
    speaking = [kind for kind in strongest if evidence.parts[kind][row] > np.log(2)]
    return tuple(evidence.said[kind][row] for kind in speaking if evidence.said[kind][row])

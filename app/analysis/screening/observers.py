"""Screen participants: flag what is unusual about their votes.

Flags are rare among honest people: careless answers, by a likelihood ratio, and facts, such as answers faster than
looking. Remarks say what else is unusual; among honest people, too, somebody nearly always has some. Neither excludes
anybody.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit
from scipy.stats import norm

from app.analysis.model.bootstrap import RUNAWAY, participant_counts
from app.analysis.model.bradley_terry import MANY_ITEMS, fit_pairs
from app.analysis.model.contrasts import holm
from app.analysis.model.likelihood.counts import PairCounts, outcome_index
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.newton import Design, Search, maximise
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.analysis.reading.phrases import part
from app.analysis.reading.votes_table import NONE, A, B, VotesTable, only_compared, order_of
from app.analysis.screening.careless import Careless, careless_answers
from app.analysis.screening.triads import Triads, by_participant, pooled_p_value, smallest_p_value

Array = NDArray[np.float64]

TELLING = 0.05  # p-value that triads without contradiction must reach before contradictions are flagged
CHANCE = 0.5  # pooled p-value of the triads above which votes contradict each other as often as random ones
BIASED = 0.05  # corrected p-value below which a side or order bias is flagged
EXACT_VOTES = 500  # up to which a bias is tested exactly; the normal approximation flags four votes for one side
FENCE = 1.5  # Tukey's fence in interquartile ranges, as pwcmp uses it for likelihood outliers
FEWEST_FOR_FENCES = 5  # participants; quartiles of fewer mean nothing
FEWEST_VOTES = 10  # votes before rates and times are compared; a tie rate then has a standard error of 0.13
MOST_REFITS = 20_000  # participants times items up to which each participant is left out in turn
CARELESS = "answers carelessly"
NOT_SMOOTH = "films not shown smoothly in {}"
FASTEST_MS = 500.0  # nobody judges two videos in less than half a second


def observer_rows(
    votes: VotesTable,
    screened: Sequence[Triads],
    *,
    ties: str,
    checks: Sequence[Mapping[str, Any]] = (),
    order_effect: float | None = None,
) -> list[dict[str, Any]]:
    """Return a row per participant, with numbers, flags and remarks.

    Parameters
    ----------
    votes : VotesTable, the votes analysed
    screened : the circular triads of the same votes
    ties : key of `TIE_MODELS`, for the likelihood of each participant's votes under the others' scores
    checks : rows of `check_rows`
    order_effect : advantage of being shown first that the whole panel shows, log-odds
    """
    if not votes.has_participants or not len(votes):
        return []
    votes = votes.where(order_of(votes.participant, len(votes.participants)))
    votes_by_participant = votes.by_participant()
    p_a = _preferred_by_all(votes, ties)
    bounds = np.cumsum([len(part) for part in votes_by_participant.values()])
    triads = by_participant(screened)
    rows = [
        _measures(votes.participants[index], part, p_a[end - len(part) : end], triads, order_effect or 0.0)
        for (index, part), end in zip(votes_by_participant.items(), bounds.tolist(), strict=True)
    ]
    for row, value in zip(rows, _left_out_likelihoods(votes, votes_by_participant, ties), strict=True):
        row["loglik_per_vote_left_out"] = value
    _flag(rows, careless_answers(votes, checks, order_effect))
    _remark(rows)
    return rows


def _preferred_by_all(votes: VotesTable, ties: str) -> Array:
    """Return P(row's `item_a` is preferred), given a preference and everybody's scores, float64 (N,)."""
    p_a = np.full(len(votes), 0.5)
    for dataset in range(len(votes.datasets)):
        rows = votes.dataset == dataset
        compared = only_compared(votes.where(rows))
        fit = _fit_without_participants(compared, ties) if rows.any() else None
        if fit is not None and fit.scores is not None:
            p_a[rows] = fit.preference(fit.scores[compared.item_a] - fit.scores[compared.item_b])
    return p_a


def _fit_without_participants(votes: VotesTable, ties: str) -> Fit | None:
    """Fit scores without clustered errors; None where even a penalised estimate does not converge."""
    try:
        return fit_pairs(votes, ties=ties)
    except RuntimeError:  # no estimate converged
        return None


def _measures(
    participant: str, votes: VotesTable, p_a: Array, by_name: dict[str, list[Triads]], order_effect: float
) -> dict[str, Any]:
    triads = by_name.get(participant, [])
    n = votes.n_votes
    decided = votes.choice <= B
    has_order = decided & (votes.first_shown >= 0)
    p_first = expit(logit(np.where(votes.first_shown == 1, 1 - p_a, p_a)) + order_effect)
    side = _bias(votes.choice[decided] == A, p_a[decided], votes.count[decided])
    order = _bias((votes.choice == votes.first_shown)[has_order], p_first[has_order], votes.count[has_order])
    consistent, repeated = _repeats(votes)
    return {
        "participant": participant,
        "flags": [],
        "remarks": ["no more consistent than chance"] if _is_like_chance(triads) else [],
        "n_votes": n,
        "one_side_unseen": n_without(votes, votes.both_seen),
        "not_smooth": n_without(votes, votes.shown_smoothly),
        "tie_rate": int(votes.count[votes.choice == NONE].sum()) / n if n else None,
        "side_a_rate": side[0],
        "side_a_expected": side[1],
        "side_a_p_value": side[2],
        "first_shown_rate": order[0],
        "first_shown_expected": order[1],
        "first_shown_p_value": order[2],
        "repeated_pairs": repeated,
        "repeats_consistent": consistent,
        "median_response_ms": _quantile(votes.response_ms, 0.5),
        "fastest_decile_ms": _quantile(votes.response_ms, 0.1),
        "median_press_to_picture_ms": _quantile(votes.press_to_picture_ms, 0.5),
        "circular": sum(triad.circular for triad in triads),
        "circular_p_value": pooled_p_value(triads),
    }


def n_without(votes: VotesTable, fact: NDArray[np.int8]) -> int | None:
    """Count the votes of which a fact does not hold; None where no record says it.

    Parameters
    ----------
    votes : VotesTable
    fact : int8 (N,), one for each row: 1, 0, or -1 where it is not recorded
    """
    return int(votes.count[fact == 0].sum()) if (fact >= 0).any() else None


def _is_like_chance(triads: Sequence[Triads]) -> bool:
    """Do the triads contradict each other as often as random votes, with enough triads to tell?

    Enough are all 15 pairs of six items on one dataset, 20 pairs of five items on two, 24 of four items on four, or
    33 of three items on eleven.
    """
    p_value = pooled_p_value(triads)
    return p_value is not None and p_value > CHANCE and smallest_p_value(triads) <= TELLING


def _bias(
    chosen: NDArray[np.bool_], chance: Array, count: NDArray[np.int64]
) -> tuple[float | None, float | None, float | None]:
    """Return how often one side was chosen, how often everybody's scores predict it, and the p-value of the
    difference.

    Without the scores, a design that always puts the better item on the same side would look like a bias.
    """
    n = int(count.sum())
    if not n:
        return None, None, None
    observed, expected = int(np.sum(count * chosen)), float(np.sum(count * chance))
    return observed / n, expected / n, _two_sided(observed, chance, count)


def _two_sided(observed: int, chance: Array, count: NDArray[np.int64]) -> float:
    """Return the p-value of a number of successes, each with its own chance: twice the smaller tail, at most 1."""
    if count.sum() > EXACT_VOTES:
        deviation = float(np.sqrt(count @ (chance * (1 - chance))))
        return float(2 * norm.sf(abs(observed - count @ chance) / deviation))
    distribution = np.ones(1)
    for p in np.repeat(chance, count):
        distribution = np.convolve(distribution, (1 - p, p))
    return min(1.0, 2 * float(min(distribution[: observed + 1].sum(), distribution[observed:].sum())))


def _quantile(values: Array, share: float) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.quantile(known, share)) if len(known) else None


def _repeats(votes: VotesTable) -> tuple[int, int]:
    """Count the pairs judged the same way every time, and the pairs judged more than once."""
    turned = np.where(votes.choice == NONE, 2, votes.prefers_lower)
    key = votes.dataset.astype(np.int64) * len(votes.items) ** 2 + votes.pair
    _, pair, times = np.unique(key, return_inverse=True, return_counts=True)
    kinds = np.zeros((len(times), 3), bool)
    kinds[pair, turned.astype(int)] = True
    repeated = times > 1
    return int((kinds.sum(axis=1)[repeated] == 1).sum()), int(repeated.sum())


def _left_out_likelihoods(votes: VotesTable, parts: dict[int, VotesTable], ties: str) -> list[float | None]:
    """Return each participant's mean log-likelihood per vote under the scores of all others.

    Each dataset is fitted alone; the penalised estimate replaces a maximum that does not exist.
    """
    if len(parts) < 2 or len(parts) * len(votes.items) > MOST_REFITS:
        return [None] * len(parts)
    places = {index: place for place, index in enumerate(parts)}
    logliks, n_votes = np.zeros(len(places)), np.zeros(len(places))
    for dataset in range(len(votes.datasets)):
        part = votes.where(votes.dataset == dataset)
        if not len(part):  # of practice alone
            continue
        together = _left_out_together(part, places, ties)
        for index, mine in part.by_participant().items():
            place = places[index]
            if together is not None and together.is_there[place]:
                logliks[place] += together.loglik[place]
                n_votes[place] += together.n_votes[place]
            elif len(others := part.where(part.participant != index)):
                loglik, n = _loglik_under(others, mine, ties)
                logliks[place] += loglik
                n_votes[place] += n
    return [float(loglik / n) if n else None for loglik, n in zip(logliks, n_votes, strict=True)]


@dataclass(frozen=True)
class _LeftOut:
    """Log-likelihoods of J participants' votes under the scores of all others, each float64 or bool (J,).

    `is_there` where the others' votes have a maximum of the same form as everybody's.
    """

    loglik: Array
    n_votes: Array
    is_there: NDArray[np.bool_]


def _left_out_together(votes: VotesTable, places: Mapping[int, int], ties: str) -> _LeftOut | None:
    """Leave out each participant of a dataset in turn, and fit the votes of all the others in one batch.

    Parameters
    ----------
    votes : VotesTable, of one dataset
    places : index of a participant -> place in the result
    ties : as in `observer_rows`

    Returns
    -------
    _LeftOut, or None if not even everybody's votes have a maximum
    """
    compared = only_compared(votes)
    fit = _fit_without_participants(compared, ties)
    if fit is None or fit.theta is None or fit.status != "ok" or len(fit.items) > MANY_ITEMS:
        return None
    mine = participant_counts(fit, compared)[list(places)].astype(np.float64).reshape(len(places), 3, -1)  # (J, 3, C)
    others = TIE_MODELS[ties].counted(*np.moveaxis(mine.sum(axis=0) - mine, 1, 0))
    has_all = (others[0] + others[1] + others[2] > 0).all(axis=1) & (others[2].any(axis=1) | (not fit.design.has_tie))
    is_there = np.zeros(len(places), bool)
    loglik = np.zeros(len(places))
    wins, losses, tied = (mine[:, index] for index in range(3))
    if not fit.design.has_tie:
        tied = np.zeros_like(tied)
    if has_all.any():
        table = [part[has_all] for part in others]
        maximum = maximise(fit.design, *table, start=fit.theta, search=Search(runaway=RUNAWAY))
        d, t = fit.design.predictors(maximum.theta)
        is_there[has_all] = maximum.converged
        loglik[has_all] = fit.design.model.loglik(d, t, wins[has_all], losses[has_all], tied[has_all]).sum(axis=1)
    return _LeftOut(loglik, (wins + losses + tied).sum(axis=1), is_there)


def _loglik_under(others: VotesTable, mine: VotesTable, ties: str) -> tuple[float, int]:
    """Return the log-likelihood of `mine` under the scores of `others`, and the number of votes it covers."""
    compared = only_compared(others)
    fit = _fit_without_participants(compared, ties)
    if fit is None or fit.theta is None:
        return 0.0, 0
    there = np.array([item in set(compared.items) for item in mine.items])
    kept = mine.where(there[mine.item_a] & there[mine.item_b] & (fit.design.has_tie | (mine.choice != NONE)))
    place = np.cumsum(there) - 1
    first, second, outcome = outcome_index(kept, is_ordered=False)
    parts = [(outcome == index) * kept.count.astype(float) for index in range(3)]
    rows = PairCounts(fit.counts.n_items, place[first], place[second], parts[0], parts[1], parts[2])
    return _loglik(fit, rows), kept.n_votes


def _loglik(fit: Fit, rows: PairCounts) -> float:
    assert fit.theta is not None
    d, t = Design(rows, fit.design.model, fit.design.has_tie).predictors(fit.theta[None])
    return float(fit.design.model.loglik(d, t, rows.wins[None], rows.losses[None], rows.ties[None]).sum())


def _flag(rows: list[dict[str, Any]], careless: Mapping[str, Careless]) -> None:
    """Flag careless answers and facts."""
    for row in rows:
        verdict = careless.get(row["participant"])
        row["careless"] = None if verdict is None else verdict.as_dict()
        row["careless_log_ratio"] = None if verdict is None else verdict.log_ratio
        row["careless_false_alarms"] = None if verdict is None else verdict.false_alarms
        row["careless_evidence"] = [] if verdict is None else list(verdict.words)
        if verdict is not None and verdict.is_named:
            row["flags"].append(CARELESS)
        if _is_known(row, "fastest_decile_ms") and row["fastest_decile_ms"] < FASTEST_MS:
            row["flags"].append("answers faster than looking")
        if row["one_side_unseen"]:
            row["flags"].append(f"only one side seen in {part(row['one_side_unseen'], row['n_votes'], 'vote')}")
        if row["not_smooth"]:
            row["flags"].append(NOT_SMOOTH.format(part(row["not_smooth"], row["n_votes"], "vote")))


def _remark(rows: list[dict[str, Any]]) -> None:
    """Remark on what is unusual, which among many honest people some always are."""
    for name, remark in (
        ("side_a_p_value", "prefers one side"),
        ("first_shown_p_value", "prefers by order of showing"),
    ):
        _remark_small(rows, name, remark)
    _remark_outside(rows, "loglik_per_vote_left_out", low="disagrees with the others", high=None)
    _remark_outside(rows, "tie_rate", low=None, high="unusually many ties")
    _remark_outside(rows, "median_response_ms", low="unusually fast", high="unusually slow")


def _remark_small(rows: list[dict[str, Any]], name: str, remark: str) -> None:
    """Remark on p-values that are small after correction for the number of participants."""
    known = [row for row in rows if row[name] is not None]
    if known:
        for row, corrected in zip(known, holm(np.array([row[name] for row in known])), strict=True):
            if corrected < BIASED:
                row["remarks"].append(remark)


def _remark_outside(rows: list[dict[str, Any]], name: str, *, low: str | None, high: str | None) -> None:
    """Remark on values beyond Tukey's fences, one and a half interquartile ranges outside the quartiles."""
    known = [row for row in rows if _is_known(row, name)]
    if len(known) < FEWEST_FOR_FENCES:
        return
    first, third = np.quantile([row[name] for row in known], [0.25, 0.75])
    reach = FENCE * (third - first)
    for row in known:
        if low is not None and row[name] < first - reach:
            row["remarks"].append(low)
        if high is not None and row[name] > third + reach:
            row["remarks"].append(high)


def _is_known(row: dict[str, Any], name: str) -> bool:
    """Does the participant have a value from at least `FEWEST_VOTES` votes?"""
    return row[name] is not None and row["n_votes"] >= FEWEST_VOTES

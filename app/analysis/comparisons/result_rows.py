"""Turn a fit, its contrasts, effects and triads into the rows of analysis.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.analysis.comparisons.comparison import Comparison
from app.analysis.comparisons.groups import GroupComparison
from app.analysis.model.bootstrap import Bootstrap
from app.analysis.model.bradley_terry import fit_pairs, fit_scores
from app.analysis.model.contrasts import Contrast, half_widths, has_few_participants, letters, or_none, scores_of
from app.analysis.model.distance_prior import fit_with_prior
from app.analysis.model.likelihood.counts import count_pairs
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.analysis.model.quasi_variances import quasi_errors
from app.analysis.model.ranks import best_probabilities, rank_intervals
from app.analysis.model.scales import LOG_ODDS_PER_JOD, equivalence_columns, preference_columns
from app.analysis.model.separation import votes_within_groups
from app.analysis.model.settings import AnalysisSettings
from app.analysis.model.thurstone import JOD, fit_thurstone
from app.analysis.reading.votes_table import ALL, NONE, VotesTable
from app.analysis.screening.triads import Triads, by_participant, pooled_p_value

Array = NDArray[np.float64]

WITHIN_GROUP = "relative to the mean of its group"  # added to the method where votes are separated
PERCENTILES = "participant bootstrap"
WIDER_INTERVAL = "wider of t on participant errors and normal on information"  # where participants are few


def score_rows(
    comparison: Comparison, jod_prior: str = "none", corrected: Sequence[Contrast] | None = None
) -> Iterator[dict[str, Any]]:
    """Return a row per item with its score, errors, interval and votes.

    Parameters
    ----------
    comparison : Comparison
    jod_prior : as in the settings
    corrected : contrasts of all pairs that the letters follow; by default those of this comparison and dataset alone
    """
    fit, n = comparison.fit, len(comparison.fit.items)
    wins, losses, ties = _outcomes(comparison.votes)
    compared = comparison.contrasts if corrected is None else corrected
    shown, ranks = _letters(fit, compared), rank_intervals(fit.items, compared)
    best, quasi = _alone(fit)
    limits, without_limit = score_intervals(comparison), unlimited(comparison.fit)
    thurstone = _thurstone_columns(comparison, jod_prior)
    scores = [None] * n if fit.scores is None else fit.scores.tolist()
    to_mean = preference_columns(
        fit, "preference_to_mean", [(score, row.low, row.high) for score, row in zip(scores, limits, strict=True)]
    )
    for index, (item, interval) in enumerate(zip(fit.items, limits, strict=True)):
        score = scores[index]
        yield {
            "comparison": comparison.comparison,
            "dataset": comparison.dataset,
            "item": item,
            "score": score,
            "se": fit.error(index),
            "se_participant": fit.error(index, by_participant=True),
            "ci_low": interval.low,
            "ci_high": interval.high,
            "ci_method": interval.method,
            "jod": _as_jod(score),
            "win_probability": None if fit.scores is None or n < 2 else _win_probability(fit, index),
            "n_votes": wins[index] + losses[index] + ties[index],
            "wins": wins[index],
            "losses": losses[index],
            "ties": ties[index],
            "status": fit.status,
            "penalty": fit.penalty,
            "letters": shown.get(item),
            "no_limit": without_limit.get(item),
            "p_best": best[index],
            "rank_low": ranks.get(item, (None, None))[0],
            "rank_high": ranks.get(item, (None, None))[1],
            "quasi_se": quasi[index],
            "jod_low": _as_jod(interval.low),
            "jod_high": _as_jod(interval.high),
            **to_mean[index],
            **thurstone[index],
        }


def _as_jod(score: float | None) -> float | None:
    return None if score is None else score / LOG_ODDS_PER_JOD


def _thurstone_columns(comparison: Comparison, jod_prior: str) -> list[dict[str, float | None]]:
    """Return each item's JOD by Thurstone's Case V with its interval; none beside an order effect."""
    nothing: dict[str, float | None] = dict.fromkeys(("jod_thurstone", "jod_thurstone_low", "jod_thurstone_high"))
    scores, low, high = _thurstone(comparison, jod_prior)
    if scores is None:
        return [nothing for _ in comparison.fit.items]
    columns = [or_none(np.full(len(scores), np.nan) if part is None else part / JOD) for part in (scores, low, high)]
    return [dict(zip(nothing, row, strict=True)) for row in zip(*columns, strict=True)]


def _thurstone(comparison: Comparison, jod_prior: str) -> tuple[Array | None, Array | None, Array | None]:
    """Return scores and limits by Thurstone's Case V, each float64 (n,), standard deviations; None: there are none."""
    if comparison.fit.design.has_order:
        return None, None, None
    if jod_prior == "pwcmp":
        return fit_with_prior(comparison.votes) or (None, None, None)
    fit = fit_thurstone(comparison.votes) if comparison.fit.status == "ok" else None
    return (None, None, None) if fit is None else (fit.scores, *intervals(fit, None)[:2])


def group_rows(comparison: GroupComparison, jod_prior: str) -> Iterator[dict[str, Any]]:
    """Return the scores of each group, as `score_rows`."""
    for group, part in comparison.groups.items():
        fitted = Comparison(comparison.grouping, comparison.dataset, part.votes, part.fit, None)
        for row in score_rows(fitted, jod_prior):
            named = {"grouping": row.pop("comparison"), "group": group, "n_participants": part.fit.n_participants}
            yield named | row


def _letters(fit: Fit, compared: Sequence[Contrast]) -> dict[str, str]:
    if not compared or fit.scores is None:
        return {}
    return letters([fit.items[index] for index in np.argsort(-fit.scores)], compared)


def _alone(fit: Fit) -> tuple[list[float | None], list[float | None]]:
    """Return each item's probability to be the best, and its quasi standard error; None where there is none."""
    unknown: list[float | None] = [None] * len(fit.items)
    if fit.status != "ok" or fit.scores is None or fit.covariance is None:
        return unknown, unknown
    best, quasi = best_probabilities(scores_of(fit)), quasi_errors(scores_of(fit))
    errors = unknown if quasi is None else or_none(quasi[0])
    return unknown if best is None else best.tolist(), errors


def unlimited(fit: Fit) -> dict[str, str]:
    """Return the items whose scores the votes set no limit `above` or `below`: all decided votes between their group
    and others go one way.
    """
    if fit.status != "separated":
        return {}
    group = {item: number for number, items in enumerate(fit.groups) for item in items}
    of_item = np.array([group[item] for item in fit.items])
    first, second = of_item[fit.counts.first], of_item[fit.counts.second]
    won, lost = (fit.counts.wins > 0) & (first != second), (fit.counts.losses > 0) & (first != second)
    winners, losers = {*first[won], *second[lost]}, {*second[won], *first[lost]}
    return {item: "above" for item in fit.items if group[item] in winners - losers} | {
        item: "below" for item in fit.items if group[item] in losers - winners
    }


class Interval(NamedTuple):
    """Limits of a score's 95 % interval, log-odds, and how it was found; all None where there is none."""

    low: float | None
    high: float | None
    method: str | None


def score_intervals(comparison: Comparison) -> list[Interval]:
    """Return each score's interval. Of separated votes it is relative to the mean score of the item's group."""
    low, high, method = intervals(comparison.fit, comparison.bootstrap)
    if low is not None and high is not None:
        return _limits(low, high, method)
    known = {item: interval for group in comparison.groups for item, interval in _in_group(comparison.fit, group)}
    return [known.get(item, Interval(None, None, None)) for item in comparison.fit.items]


def _limits(low: Array, high: Array, method: str | None) -> list[Interval]:
    ends = zip(or_none(low), or_none(high), strict=True)
    return [Interval(lower, upper, None if lower is None else method) for lower, upper in ends]


def _in_group(fit: Fit, group: Fit) -> Iterator[tuple[str, Interval]]:
    """Yield the intervals of a group's scores around the mean of their penalised scores."""
    low, high, method = intervals(group, None)
    if low is None or high is None or fit.scores is None:
        return
    mean = float(np.mean([fit.scores[fit.items.index(item)] for item in group.items]))
    yield from zip(group.items, _limits(low + mean, high + mean, f"{method}, {WITHIN_GROUP}"), strict=True)


def intervals(fit: Fit, bootstrap: Bootstrap | None) -> tuple[Array | None, Array | None, str | None]:
    """Return the limits of the scores' 95 % intervals, each float64 (n,), log-odds, and the method.

    The method is expanded percentiles of the participant bootstrap if there are enough replicates and participants;
    else t(J - 1) on the errors clustered by participant, but with few participants no narrower than the normal
    distribution on the errors of the votes; else, where participants are unknown, the normal distribution on the errors
    from the information. There is no interval without a maximum, and none where participants are known but their
    variation is not: a single participant, or all voting alike; on a single score, its limits are NaN.
    """
    if fit.status != "ok" or fit.scores is None or fit.covariance is None:
        return None, None, None
    is_few, n_people, half = has_few_participants(fit), fit.n_participants or 0, half_widths(scores_of(fit))
    if half is None:
        return None, None, None
    if bootstrap is not None and not is_few and bootstrap.has_percentiles(n_people):
        low, high = np.where(np.isnan(half), np.nan, bootstrap.interval(n_people))
        return low, high, PERCENTILES
    by_participants = WIDER_INTERVAL if is_few else "t on participant errors"
    method = "normal on information" if fit.n_participants is None else by_participants
    return fit.scores - half, fit.scores + half, method


def _win_probability(fit: Fit, index: int) -> float:
    """Return the probability that the item is preferred to another item taken at random, given a preference."""
    assert fit.scores is not None
    return float(np.mean(fit.preference(fit.scores[index] - np.delete(fit.scores, index))))


def _outcomes(votes: VotesTable) -> tuple[list[int], list[int], list[int]]:
    """Count wins, losses and ties of each item."""
    counts = count_pairs(votes)

    def by_item(in_first: Array, in_second: Array) -> list[int]:
        n = counts.n_items
        sums = np.bincount(counts.first, in_first, n) + np.bincount(counts.second, in_second, n)
        return [int(total) for total in sums]

    wins, losses, ties = counts.wins, counts.losses, counts.ties
    return by_item(wins, losses), by_item(losses, wins), by_item(ties, ties)


def contrast_rows(
    comparison: Comparison, margin_jod: float | None = None, corrected: Sequence[Contrast] | None = None
) -> Iterator[dict[str, Any]]:
    """Return a row per pair of items with the difference of their scores, and the test of equivalence within a margin.

    Parameters
    ----------
    comparison : Comparison
    margin_jod : JOD; None: no test of equivalence
    corrected : as in `score_rows`
    """
    rows = comparison.contrasts
    preferences = preference_columns(
        comparison.fit, "preference", [(row.difference, row.ci_low, row.ci_high) for row in rows]
    )
    fits = comparison.groups or [comparison.fit]  # separated conditions are compared within their group
    equivalences = equivalence_columns(fits, rows, margin_jod)
    where = {"comparison": comparison.comparison, "dataset": comparison.dataset}
    together = [row.p_holm for row in (rows if corrected is None else corrected)]
    for row, p_together, *scales in zip(rows, together, preferences, equivalences, strict=True):
        yield where | vars(row) | {"p_holm_together": p_together} | scales[0] | scales[1]


def islands(comparison: Comparison, penalty: str) -> list[Comparison]:
    """Return the comparisons within each group of conditions, if no vote links the groups; else none."""
    fit = comparison.fit
    if fit.status != "disconnected" or len(fit.groups) < 2:
        return []
    return [
        Comparison(
            comparison.comparison, comparison.dataset, part, fit_scores(part, ties=fit.ties, penalty=penalty), None
        )
        for part in votes_within_groups(fit, comparison.votes)
    ]


def island_rows(
    comparison: Comparison, settings: AnalysisSettings
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return scores and contrasts within each group of conditions that no vote links to the others.

    Parameters
    ----------
    comparison : Comparison
    settings : penalty, prior and margin
    """
    scores, contrasts = list[dict[str, Any]](), list[dict[str, Any]]()
    for number, part in enumerate(islands(comparison, settings.penalty), 1):
        scores += [{"group": number, **row} for row in score_rows(part, settings.jod_prior)]
        contrasts += [{"group": number, **row} for row in contrast_rows(part, settings.equivalence_margin)]
    return scores, contrasts


def tie_model_rows(comparison: Comparison, penalty: str) -> Iterator[dict[str, Any]]:
    """Return the log-likelihoods of all ways of treating ties; only Davidson's and Rao and Kupper's compare."""
    if comparison.comparison != ALL or not (comparison.votes.choice == NONE).any():
        return
    for ties, model in TIE_MODELS.items():
        fit = (
            comparison.fit
            if ties == comparison.fit.ties
            else fit_pairs(comparison.votes, ties=ties, order_effect=comparison.fit.design.has_order, penalty=penalty)
        )
        yield {
            "dataset": comparison.dataset,
            "ties": ties,
            "parameter": model.parameter,
            "value": fit.tie_parameter,
            "loglik": fit.loglik,
            "deviance": fit.deviance,
            "df": fit.df,
            "status": fit.status,
        }


def model_row(comparison: Comparison) -> dict[str, Any]:
    """Return the tie parameter, order effect and goodness of fit of a model."""
    fit = comparison.fit
    parameter = TIE_MODELS[fit.ties].parameter
    row: dict[str, Any] = {"comparison": comparison.comparison, "dataset": comparison.dataset, "ties": fit.ties}
    if parameter:
        has_error = fit.design.has_tie and fit.tie_parameter is not None
        row[parameter] = fit.tie_parameter
        row[f"{parameter}_se"] = fit.error(-1) if has_error else None
        row[f"{parameter}_se_participant"] = fit.error(-1, by_participant=True) if has_error else None
    known = quasi_errors(scores_of(fit)) if fit.status == "ok" and fit.covariance is not None else None
    order = fit.design.n_effects
    has_order = fit.design.has_order and fit.theta is not None
    return row | {
        "order_effect": fit.order_effect,
        "order_left_out": comparison.order_left_out,
        "order_se": fit.error(order) if has_order else None,
        "order_se_participant": fit.error(order, by_participant=True) if has_order else None,
        "loglik": fit.loglik,
        "deviance": fit.deviance,
        "pearson_x2": fit.pearson_x2,
        "df": fit.df,
        "p_value": fit.p_value,
        "converged": fit.status == "ok",
        "iterations": fit.iterations,
        "status": fit.status,
        "groups": [list(group) for group in fit.groups],
        "penalty": fit.penalty,
        "n_votes": comparison.votes.n_votes,
        "n_participants": fit.n_participants,
        "quasi_error": None if known is None else known[1],
        "few_participants": has_few_participants(fit),
        "bootstrap_replicates": None if comparison.bootstrap is None else len(comparison.bootstrap.scores),
        "bootstrap_without_maximum": None if comparison.bootstrap is None else comparison.bootstrap.n_without_maximum,
    }


def pair_rows(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Return observed and expected votes on every pair, for the preference matrix and the residuals."""
    fit = comparison.fit
    nothing: list[list[float | None]] = [[None] * 3] * len(fit.counts.first)
    expected = nothing if fit.expected is None else fit.expected.T.tolist()
    columns = fit.counts.first, fit.counts.second, fit.counts.wins, fit.counts.losses, fit.counts.ties
    for first, second, wins, losses, ties, (as_win, as_loss, as_tie) in zip(*columns, expected, strict=True):
        yield {
            "comparison": comparison.comparison,
            "dataset": comparison.dataset,
            "item_a": fit.items[first],
            "item_b": fit.items[second],
            "a": float(wins),
            "b": float(losses),
            "none": float(ties),
            "expected_a": as_win,
            "expected_b": as_loss,
            "expected_none": as_tie,
        }


def triads_row(row: Triads) -> dict[str, Any]:
    """Return the circular triads of a participant on a dataset."""
    return {name: value for name, value in vars(row).items() if name not in ("half_cycles", "chance")}


def pooled_triads(rows: list[Triads]) -> list[dict[str, Any]]:
    """Return each participant's circular triads over all datasets."""
    return [
        {
            "participant": participant,
            "n_datasets": len(by_dataset),
            "circular": sum(row.circular for row in by_dataset),
            "circular_expected_ties": sum(row.circular_expected_ties for row in by_dataset),
            "circular_by_chance": sum(row.circular_by_chance for row in by_dataset),
            "strict_by_chance": sum(row.strict_by_chance for row in by_dataset),
            "p_value": pooled_p_value(by_dataset),
        }
        for participant, by_dataset in by_participant(rows).items()
    ]

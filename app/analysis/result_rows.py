"""Turn a fit, its contrasts, effects and triads into the rows of analysis.json."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from app.analysis.bootstrap import Bootstrap
from app.analysis.bradley_terry import Fit, fit_scores
from app.analysis.comparison import ALL, Comparison
from app.analysis.contrasts import contrasts, letters
from app.analysis.factors import Effect
from app.analysis.groups import GroupComparison
from app.analysis.settings import LEVEL, AnalysisSettings
from app.analysis.ties import TIE_MODELS
from app.analysis.triads import Triads, pooled_p_value
from app.analysis.votes_table import NONE, A, B, VotesTable

Array = NDArray[np.float64]

# One just-objectionable difference: preferred by 75 %, Perez-Ortiz and Mantiuk (2017).
LOG_ODDS_PER_JOD = float(np.log(3))


def score_rows(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Return a row per item with its score, errors, interval and votes."""
    fit, n = comparison.fit, len(comparison.fit.items)
    wins, losses, ties = _outcomes(comparison.votes)
    low, high, method = intervals(fit, comparison.bootstrap)
    shown = _letters(fit)
    for index, item in enumerate(fit.items):
        score = None if fit.scores is None else float(fit.scores[index])
        yield {
            "comparison": comparison.comparison,
            "dataset": comparison.dataset,
            "item": item,
            "score": score,
            "se": fit.error(index),
            "se_participant": fit.error(index, by_participant=True),
            "ci_low": None if low is None else float(low[index]),
            "ci_high": None if high is None else float(high[index]),
            "ci_method": method,
            "jod": None if score is None else score / LOG_ODDS_PER_JOD,
            "win_probability": None if fit.scores is None or n < 2 else _win_probability(fit, index),
            "n_votes": wins[index] + losses[index] + ties[index],
            "wins": wins[index],
            "losses": losses[index],
            "ties": ties[index],
            "status": fit.status,
            "penalty": fit.penalty,
            "letters": shown.get(item),
        }


def group_rows(comparison: GroupComparison) -> Iterator[dict[str, Any]]:
    """Return the scores of each group, as `score_rows`."""
    for group, part in comparison.groups.items():
        for row in score_rows(Comparison(comparison.grouping, comparison.dataset, part.votes, part.fit, None)):
            named = {"grouping": row.pop("comparison"), "group": group, "n_participants": part.fit.n_participants}
            yield named | row


def _letters(fit: Fit) -> dict[str, str]:
    differences = contrasts(fit)
    if not differences or fit.scores is None:
        return {}
    best_first = [fit.items[index] for index in np.argsort(-fit.scores)]
    return letters(best_first, differences)


def intervals(fit: Fit, bootstrap: Bootstrap | None) -> tuple[Array | None, Array | None, str | None]:
    """Return the limits of the scores' 95 % intervals, each float64 (n,), log-odds, and the method.

    The method is percentiles of the participant bootstrap if there are enough replicates; else t(J - 1) on the
    errors clustered by participant; else, where participants are unknown, the normal distribution on the errors from
    the information. There is no interval where participants are known but their variation is not: a single
    participant, all voting alike, or no maximum.
    """
    if fit.scores is None or fit.covariance is None:
        return None, None, None
    if bootstrap is not None and bootstrap.has_percentiles(LEVEL):
        low, high = bootstrap.interval(LEVEL)
        return low, high, "participant bootstrap"
    n = len(fit.items)
    if fit.n_participants is not None:
        if fit.participant_covariance is None:
            return None, None, None
        half = student.ppf((1 + LEVEL) / 2, fit.n_participants - 1) * np.sqrt(np.diag(fit.participant_covariance)[:n])
        return fit.scores - half, fit.scores + half, "t on participant errors"
    half = norm.ppf((1 + LEVEL) / 2) * np.sqrt(np.diag(fit.covariance)[:n])
    return fit.scores - half, fit.scores + half, "normal on information"


def _win_probability(fit: Fit, index: int) -> float:
    """Return the probability that the item is preferred to another item taken at random, given a preference."""
    assert fit.scores is not None
    return float(np.mean(fit.preference(fit.scores[index] - np.delete(fit.scores, index))))


def _outcomes(votes: VotesTable) -> tuple[list[int], list[int], list[int]]:
    """Count wins, losses and ties of each item."""
    n = len(votes.items)
    winner = np.where(votes.choice == A, votes.item_a, votes.item_b)
    loser = np.where(votes.choice == A, votes.item_b, votes.item_a)
    decided = votes.choice <= B
    tied = ~decided
    wins = np.bincount(winner[decided], votes.count[decided], n)
    losses = np.bincount(loser[decided], votes.count[decided], n)
    ties = np.bincount(votes.item_a[tied], votes.count[tied], n) + np.bincount(votes.item_b[tied], votes.count[tied], n)
    return wins.astype(int).tolist(), losses.astype(int).tolist(), ties.astype(int).tolist()


def contrast_rows(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Return a row per pair of items with the difference of their scores."""
    for contrast in contrasts(comparison.fit):
        yield {"comparison": comparison.comparison, "dataset": comparison.dataset} | asdict(contrast)


def tie_model_rows(comparison: Comparison, settings: AnalysisSettings) -> Iterator[dict[str, Any]]:
    """Return the log-likelihoods of all ways of treating ties; only Davidson's and Rao and Kupper's compare."""
    if comparison.comparison != ALL or not (comparison.votes.choice == NONE).any():
        return
    for ties, model in TIE_MODELS.items():
        fit = (
            comparison.fit
            if ties == comparison.fit.ties
            else fit_scores(comparison.votes, ties=ties, order_effect=settings.order_effect)
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
    order = fit.design.n_effects
    has_order = fit.design.has_order and fit.theta is not None
    return row | {
        "order_effect": fit.order_effect,
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
        "bootstrap_replicates": None if comparison.bootstrap is None else len(comparison.bootstrap.scores),
        "bootstrap_without_maximum": None if comparison.bootstrap is None else comparison.bootstrap.n_without_maximum,
    }


def effect_row(effect: Effect) -> dict[str, Any]:
    """Return a level's effect with its 95 % interval."""
    if effect.n_participants is None:
        half = float(norm.ppf((1 + LEVEL) / 2)) * effect.se
    elif effect.se_participant is not None:
        half = float(student.ppf((1 + LEVEL) / 2, effect.n_participants - 1)) * effect.se_participant
    else:
        return asdict(effect) | {"ci_low": None, "ci_high": None}
    return asdict(effect) | {"ci_low": effect.effect - half, "ci_high": effect.effect + half}


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
    shown = asdict(row)
    del shown["broken"]
    return shown


def pooled_triads(rows: list[Triads]) -> list[dict[str, Any]]:
    """Return each participant's circular triads over all datasets."""
    by_participant: dict[str, list[Triads]] = {}
    for row in rows:
        by_participant.setdefault(row.participant, []).append(row)
    return [
        {
            "participant": participant,
            "n_datasets": len(by_dataset),
            "circular": sum(row.circular for row in by_dataset),
            "circular_expected_ties": sum(row.circular_expected_ties for row in by_dataset),
            "p_value": pooled_p_value(by_dataset),
        }
        for participant, by_dataset in by_participant.items()
    ]

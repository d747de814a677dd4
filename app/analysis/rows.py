"""The rows of analysis.json: a fit, its contrasts and the triads as names and numbers."""

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

LOG_ODDS_PER_JOD = float(
    np.log(3)
)  # one just-objectionable difference: preferred by 75 %, Perez-Ortiz and Mantiuk (2017)


def score_rows(one: Comparison) -> Iterator[dict[str, Any]]:
    fit, n = one.fit, len(one.fit.items)
    wins, losses, ties = _outcomes(one.votes)
    low, high, method = intervals(fit, one.bootstrap)
    shown = _letters(fit)
    for index, item in enumerate(fit.items):
        score = None if fit.scores is None else float(fit.scores[index])
        yield {
            "comparison": one.comparison,
            "dataset": one.dataset,
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


def group_rows(found: GroupComparison) -> Iterator[dict[str, Any]]:
    """Each group's scores, as `score_rows`."""
    for group, part in found.groups.items():
        for row in score_rows(Comparison(found.grouping, found.dataset, part.votes, part.fit, None)):
            named = {"grouping": row.pop("comparison"), "group": group, "n_participants": part.fit.n_participants}
            yield named | row


def _letters(fit: Fit) -> dict[str, str]:
    found = contrasts(fit)
    if not found or fit.scores is None:
        return {}
    best_first = [fit.items[index] for index in np.argsort(-fit.scores)]
    return letters(best_first, found)


def intervals(fit: Fit, bootstrap: Bootstrap | None) -> tuple[Array | None, Array | None, str | None]:
    """Return the limits of the scores' 95 % intervals and how they were made.

    Percentiles of the participant bootstrap if it has them; else t(J - 1) on the errors clustered by participant;
    else, where participants are unknown, the normal distribution on the errors from the information. Where they are
    known and nothing is known of how they differ (one of them, all alike, no maximum), there is no interval.
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
    """Return the probability that the item is preferred to another one taken at random, ties apart."""
    assert fit.scores is not None
    return float(np.mean(fit.preference(fit.scores[index] - np.delete(fit.scores, index))))


def _outcomes(votes: VotesTable) -> tuple[list[int], list[int], list[int]]:
    """Return wins, losses and ties of each item."""
    n = len(votes.items)
    winner = np.where(votes.choice == A, votes.item_a, votes.item_b)
    loser = np.where(votes.choice == A, votes.item_b, votes.item_a)
    decided = votes.choice <= B
    tied = ~decided
    wins = np.bincount(winner[decided], votes.count[decided], n)
    losses = np.bincount(loser[decided], votes.count[decided], n)
    ties = np.bincount(votes.item_a[tied], votes.count[tied], n) + np.bincount(votes.item_b[tied], votes.count[tied], n)
    return wins.astype(int).tolist(), losses.astype(int).tolist(), ties.astype(int).tolist()


def contrast_rows(one: Comparison) -> Iterator[dict[str, Any]]:
    for contrast in contrasts(one.fit):
        yield {"comparison": one.comparison, "dataset": one.dataset} | asdict(contrast)


def tie_model_rows(one: Comparison, settings: AnalysisSettings) -> Iterator[dict[str, Any]]:
    """The log-likelihoods of all ways of treating ties, side by side; only Davidson's and Rao and Kupper's compare."""
    if one.comparison != ALL or not (one.votes.choice == NONE).any():
        return
    for ties, model in TIE_MODELS.items():
        fit = one.fit if ties == one.fit.ties else fit_scores(one.votes, ties=ties, order_effect=settings.order_effect)
        yield {
            "dataset": one.dataset,
            "ties": ties,
            "parameter": model.parameter,
            "value": fit.tie_parameter,
            "loglik": fit.loglik,
            "deviance": fit.deviance,
            "df": fit.df,
            "status": fit.status,
        }


def model_row(one: Comparison) -> dict[str, Any]:
    fit = one.fit
    parameter = TIE_MODELS[fit.ties].parameter
    row: dict[str, Any] = {"comparison": one.comparison, "dataset": one.dataset, "ties": fit.ties}
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
        "n_votes": one.votes.n_votes,
        "n_participants": fit.n_participants,
        "bootstrap_replicates": None if one.bootstrap is None else len(one.bootstrap.scores),
        "bootstrap_without_maximum": None if one.bootstrap is None else one.bootstrap.n_without_maximum,
    }


def effect_row(effect: Effect) -> dict[str, Any]:
    if effect.n_participants is None:
        half = float(norm.ppf((1 + LEVEL) / 2)) * effect.se
    elif effect.se_participant is not None:
        half = float(student.ppf((1 + LEVEL) / 2, effect.n_participants - 1)) * effect.se_participant
    else:
        return asdict(effect) | {"ci_low": None, "ci_high": None}
    return asdict(effect) | {"ci_low": effect.effect - half, "ci_high": effect.effect + half}


def pair_rows(one: Comparison) -> Iterator[dict[str, Any]]:
    """Observed and expected votes on every pair, for the preference matrix and the residuals."""
    fit = one.fit
    nothing: list[list[float | None]] = [[None] * 3] * len(fit.counts.first)
    expected = nothing if fit.expected is None else fit.expected.T.tolist()
    columns = fit.counts.first, fit.counts.second, fit.counts.wins, fit.counts.losses, fit.counts.ties
    for first, second, wins, losses, ties, (as_win, as_loss, as_tie) in zip(*columns, expected, strict=True):
        yield {
            "comparison": one.comparison,
            "dataset": one.dataset,
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
    named = asdict(row)
    return {
        "participant": named["participant"],
        "dataset": named["dataset"],
        "n_items": named["n_items"],
        "complete": named["complete"],
        "circular": named["circular"],
        "circular_expected_ties": named["expected_ties"],
        "circular_max": named["maximum"],
        "zeta": named["zeta"],
        "p_value": named["p_value"],
    }


def pooled_triads(rows: list[Triads]) -> list[dict[str, Any]]:
    by_participant: dict[str, list[Triads]] = {}
    for row in rows:
        by_participant.setdefault(row.participant, []).append(row)
    return [
        {
            "participant": participant,
            "n_datasets": len(own),
            "circular": sum(row.circular for row in own),
            "circular_expected_ties": sum(row.expected_ties for row in own),
            "p_value": pooled_p_value(own),
        }
        for participant, own in by_participant.items()
    ]

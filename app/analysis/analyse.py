"""Run the whole analysis of a votes table: the object that becomes analysis.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from app.analysis.comparisons.comparison import (
    Comparison,
    compare,
    dataset_names,
    in_order,
    tested_order,
    votes_on_dataset,
)
from app.analysis.comparisons.datasets_sample import factor_rows, interaction_rows, pair_p_values
from app.analysis.comparisons.factor_fits import factor_fits, left_out, rows_of_tests, without_results
from app.analysis.comparisons.groups import GroupComparison, check_groups, compare_groups
from app.analysis.comparisons.lapse_rows import lapse_tables
from app.analysis.comparisons.random_effect_rows import random_effect_tables
from app.analysis.comparisons.result_rows import (
    contrast_rows,
    group_rows,
    island_rows,
    model_row,
    pair_rows,
    pooled_triads,
    score_rows,
    tie_model_rows,
    triads_row,
)
from app.analysis.findings.votes import vote_findings
from app.analysis.model.contrasts import Contrast, corrected_together, scores_of, simultaneous_factor
from app.analysis.model.settings import AnalysisSettings
from app.analysis.objective.against_scores import compared_scores, measure_tables
from app.analysis.objective.points import ScoreSet
from app.analysis.objective.scores import score_sets
from app.analysis.rates.rows import rate_differences, rate_rows
from app.analysis.reading.read_votes import Rows, votes_from_rows
from app.analysis.reading.votes_table import ALL, MAIN, WITHDRAWN, VotesError, VotesTable
from app.analysis.screening.agreement import agreement_rows, concordance, dataset_agreement_rows
from app.analysis.screening.attention_checks import check_rows
from app.analysis.screening.disagreement import disagreement
from app.analysis.screening.observers import observer_rows
from app.analysis.screening.triads import triads
from app.analysis.warnings import MOST_PAIRS, measure_warnings, warnings_of


def analyse(votes: VotesTable | Rows | pd.DataFrame, settings: AnalysisSettings | None = None) -> dict[str, Any]:
    """Analyse votes: screen participants, fit scores, test factors, groups and datasets, measure agreement.

    Parameters
    ----------
    votes : a votes table, or what `votes_from_rows` makes one of: a pandas table, or rows with named values
    settings : how to analyse

    Returns
    -------
    dict, the content of analysis.json; only lists, dictionaries, text, numbers and None

    Raises
    ------
    VotesError
        If a dataset or factor has the name of all of them together.
    """
    settings = settings or AnalysisSettings()
    if not isinstance(votes, VotesTable):
        votes = votes_from_rows(votes)
    _check_names(votes, settings)
    votes = _with_exclusions(in_order(votes), settings)
    used = votes.used()
    check_groups(votes, settings.groups)
    settings, order = tested_order(used, settings)
    compared = list(compare(used, settings))
    screened, checks = triads(used), check_rows(votes)
    effects, tests, additive = factor_fits(used, settings, compared)
    groups = group_comparisons(used, settings)
    tests += [group.test for group in groups if group.test is not None]
    by_dataset = _scores_by_dataset(compared)
    random_effects, why_no_random_effects = random_effect_tables(compared, settings.random_effects)
    lapses, why_no_lapses = lapse_tables(compared if settings.lapses else ())
    measured = measure_tables(_measured_scores(used, settings, compared), settings)
    analysis: dict[str, Any] = {
        "schema_version": 1,
        "settings": settings.as_dict(),
        "votes": _tally(votes, used),
        "scores": _score_rows(compared, settings),
        "scores_with_excluded": _scores_with_excluded(votes, used, settings),
        "models": [model_row(comparison) for comparison in compared],
        "tie_models": [row for comparison in compared for row in tie_model_rows(comparison, settings.penalty)],
        "contrasts": _contrast_rows(compared, settings),
        **_island_tables(compared, settings),
        "effects": effects,
        "tests": rows_of_tests(tests),
        "datasets_as_sample": [*factor_rows(additive, settings.factors), *interaction_rows(compared, additive)],
        "groups": [row for group in groups for row in group_rows(group, settings.jod_prior)],
        "triads": [triads_row(row) for row in screened],
        "triads_pooled": pooled_triads(screened),
        **random_effects,
        **lapses,
        **measured,
        "rates": [],
        "rate_differences": rate_differences(compared, settings.as_dict()),
        "agreement": agreement_rows(used),
        "disagreement": disagreement(used, by_order=settings.order_effect),
        "dataset_agreement": dataset_agreement_rows(by_dataset),
        "dataset_concordance": concordance(by_dataset, used),
        "order": order,
        "observers": observer_rows(
            used, screened, ties=settings.ties, checks=checks, order_effect=_order_effect(compared)
        ),
        "checks": checks,
        "pairs": [
            row
            for comparison in compared
            if len(comparison.fit.counts.first) <= MOST_PAIRS
            for row in pair_rows(comparison)
        ],
        "warnings": [
            *warnings_of(votes, used, compared),
            *measure_warnings(measured["measures"]),
            *left_out(used, settings),
            *without_results(used, settings, compared, effects),
            *why_no_random_effects,
            *why_no_lapses,
        ],
    }
    analysis["rates"] = rate_rows(compared_scores(analysis), analysis["settings"])
    return analysis | {"findings": vote_findings(analysis)}


def scored(votes: VotesTable, settings: AnalysisSettings | None = None) -> list[dict[str, Any]]:
    """Fit the scores alone: the rows `scores` of `analyse`, in a tenth of its time.

    Raises
    ------
    VotesError
        As `analyse`.
    """
    settings = settings or AnalysisSettings()
    _check_names(votes, settings)
    used = used_votes(in_order(votes), settings)
    settings, _ = tested_order(used, settings)
    return _score_rows(list(compare(used, settings)), settings)


def _score_rows(compared: Sequence[Comparison], settings: AnalysisSettings) -> list[dict[str, Any]]:
    """Return the scores of all comparisons; letters of single datasets follow a correction over all of them."""
    together = _corrected(compared)
    return [
        row
        for each in compared
        for row in score_rows(each, settings.jod_prior, together[each.comparison, each.dataset])
    ]


def _corrected(compared: Sequence[Comparison]) -> dict[tuple[str, str], Sequence[Contrast]]:
    """Return the contrasts by comparison and dataset, those of single datasets corrected over all of these."""
    contrasts = {(each.comparison, each.dataset): each.contrasts for each in compared}
    return corrected_together(contrasts, lambda place: place[0] if place[1] != ALL else None)


def _check_names(votes: VotesTable, settings: AnalysisSettings) -> None:
    """Raise if a dataset or factor has the name that stands for all of them together."""
    for kind, names in (("dataset", votes.datasets), ("factor", settings.factors)):
        if ALL in names:
            raise VotesError(f"a {kind} is called {ALL!r}, which stands for all of them together: rename it")


def group_comparisons(votes: VotesTable, settings: AnalysisSettings) -> list[GroupComparison]:
    """Compare the groups of each grouping, on each dataset and on all together."""
    if not settings.groups:
        return []
    parts = [(dataset, votes_on_dataset(votes, dataset)) for dataset in dataset_names(votes, settings)]
    return [
        comparison for dataset, part in parts if len(part) for comparison in compare_groups(part, dataset, settings)
    ]


def _island_tables(compared: Sequence[Comparison], settings: AnalysisSettings) -> dict[str, list[dict[str, Any]]]:
    """Return scores and contrasts within groups of conditions that no vote links."""
    parts = [island_rows(comparison, settings) for comparison in compared]
    return {
        "island_scores": [row for scores, _ in parts for row in scores],
        "island_contrasts": [row for _, contrasts in parts for row in contrasts],
    }


def _contrast_rows(compared: Sequence[Comparison], settings: AnalysisSettings) -> list[dict[str, Any]]:
    """Return all contrasts; those over all datasets also with the p-values for datasets like these."""
    sampled, together = pair_p_values(compared), _corrected(compared)
    rows = []
    for comparison in compared:
        is_whole = comparison.comparison == comparison.dataset == ALL
        wider = _simultaneous(comparison) if is_whole else None
        corrected = together[comparison.comparison, comparison.dataset]
        for row in contrast_rows(comparison, settings.equivalence_margin, corrected):
            known = sampled.get((row["item_a"], row["item_b"])) if is_whole else None
            p_value, p_holm = known or (None, None)
            rows.append(row | _wider(row, wider) | {"p_datasets": p_value, "p_datasets_holm": p_holm})
    return rows


def _simultaneous(comparison: Comparison) -> float | None:
    """Return how much wider simultaneous intervals of all pairs are than single ones; None without finite ones."""
    fit = comparison.fit
    has_errors = fit.status == "ok" and fit.covariance is not None and comparison.contrasts
    return simultaneous_factor(scores_of(fit)) if has_errors else None


def _wider(row: Mapping[str, Any], factor: float | None) -> dict[str, float | None]:
    """Return the limits of a difference's interval that holds together with those of all other pairs."""
    if factor is None or row["ci_low"] is None or row["ci_high"] is None:
        return {"ci_simultaneous_low": None, "ci_simultaneous_high": None}
    half = factor * (row["ci_high"] - row["ci_low"]) / 2
    return {
        "ci_simultaneous_low": row["difference"] - half,
        "ci_simultaneous_high": row["difference"] + half,
    }


def _order_effect(compared: Sequence[Comparison]) -> float | None:
    """Return how much being shown first helps over all datasets, log-odds; None without such an effect."""
    return next((row.fit.order_effect for row in compared if row.comparison == row.dataset == ALL), None)


def _scores_by_dataset(compared: Sequence[Comparison]) -> dict[str, dict[str, float]]:
    """Return dataset -> item -> score for every single dataset that has scores."""
    return {
        comparison.dataset: dict(zip(comparison.fit.items, scores.tolist(), strict=True))
        for comparison in compared
        if comparison.comparison == ALL
        and comparison.dataset != ALL
        and (scores := comparison.fit.ranked_scores) is not None
    }


def _measured_scores(
    votes: VotesTable, settings: AnalysisSettings, compared: Sequence[Comparison]
) -> dict[str, ScoreSet]:
    """Return the scores to compare measures with: those of single datasets, even if the others are not reported."""
    if not settings.measures:
        return {}
    if votes.has_datasets and not settings.by_dataset:
        compared = list(compare(votes, replace(settings, by_dataset=True, bootstrap=0, analysed_factors=())))
    return score_sets(compared)


def _scores_with_excluded(votes: VotesTable, used: VotesTable, settings: AnalysisSettings) -> list[dict[str, Any]]:
    """Return the scores without the experimenter's exclusions; empty if nobody was excluded."""
    if not votes.excluded.any():
        return []
    everybody = replace(votes, excluded=votes.excluded & (votes.reason == WITHDRAWN)).used()
    if len(everybody) == len(used):
        return []
    return _score_rows(list(compare(everybody, replace(settings, bootstrap=0))), settings)


def used_votes(votes: VotesTable, settings: AnalysisSettings) -> VotesTable:
    """Return the votes to score: without practice, attention checks and exclusions.

    Raises
    ------
    ValueError
        If a participant to exclude did not vote.
    """
    return _with_exclusions(votes, settings).used()


def _with_exclusions(votes: VotesTable, settings: AnalysisSettings) -> VotesTable:
    """Return all votes; those of participants to exclude are marked so."""
    unknown = set(settings.exclude).difference(votes.participants)
    if unknown:
        raise ValueError(
            f"the participant to exclude, {sorted(unknown)[0]!r}, is not among the {len(votes.participants)} who voted"
        )
    if not settings.exclude:
        return votes
    excluded = np.isin(np.array(votes.participants, object), list(settings.exclude))[votes.participant]
    return replace(votes, excluded=votes.excluded | excluded)


def _tally(votes: VotesTable, used: VotesTable) -> dict[str, Any]:
    """Count the votes read and how they were used; the parts add up to the total."""
    practice = int(votes.count[votes.practice].sum())
    checks = int(votes.count[(votes.role != MAIN) & ~votes.practice & ~votes.excluded].sum())
    total, analysed = votes.n_votes, used.n_votes
    return {
        "rows": len(votes),
        "votes": total,
        "practice": practice,
        "checks": checks,
        "excluded": total - practice - checks - analysed,
        "analysed": analysed,
        "participants": used.n_voters if votes.has_participants else None,
        "datasets": list(votes.datasets) if votes.has_datasets else [],
        "items": list(votes.items),
        "ties": int(used.count[used.choice == 2].sum()),
    }

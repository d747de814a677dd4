"""Fit factors on each dataset and on all: effects of their levels, and every test between models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from app.analysis.comparisons.comparison import Comparison, dataset_names, votes_on_dataset
from app.analysis.comparisons.factors import (
    ModelTest,
    coding,
    effects_of,
    fit_additive,
    items_without_levels,
    model_tests,
    order_test,
    votes_with_levels,
)
from app.analysis.comparisons.homogeneity import Part, parts_differ
from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.contrasts import holm
from app.analysis.model.settings import AnalysisSettings
from app.analysis.reading.phrases import listed
from app.analysis.reading.votes_table import ALL, VotesTable, only_compared


def factor_results(
    votes: VotesTable, settings: AnalysisSettings, compared: Sequence[Comparison]
) -> tuple[list[dict[str, Any]], list[ModelTest]]:
    """Return the additive model's effects, and all likelihood-ratio tests between models.

    Parameters
    ----------
    votes : VotesTable, the votes to score
    settings : the factors, and how to fit
    compared : the fits of the items' scores to the same votes
    """
    return factor_fits(votes, settings, compared)[:2]


def factor_fits(
    votes: VotesTable, settings: AnalysisSettings, compared: Sequence[Comparison]
) -> tuple[list[dict[str, Any]], list[ModelTest], dict[str, Part]]:
    """Return what `factor_results` does, and the additive model's fit on each dataset and on all.

    Parameters
    ----------
    votes, settings, compared : as in `factor_results`
    """
    tests: list[ModelTest | None] = []
    additive: dict[str, Part] = {}
    with_levels = votes_with_levels(votes, settings.factors)
    ordered = {c.dataset for c in compared if c.comparison == ALL and c.fit.design.has_order}
    for dataset in dataset_names(votes, settings) if settings.factors else ():
        part = only_compared(votes_on_dataset(with_levels, dataset))
        has_order = dataset in ordered
        fit = fit_additive(part, settings.factors, ties=settings.ties, order_effect=has_order)
        if fit is not None and fit.status == "ok":
            additive[dataset] = Part(part, fit)
            if has_order:
                without = fit_additive(part, settings.factors, ties=settings.ties, order_effect=False)
                tests.append(None if without is None else order_test(fit, without, "additive", dataset))
            tests += model_tests(fit, part, settings.factors, dataset)
    for comparison in compared:
        if comparison.fit.design.has_order:
            without = fit_scores(comparison.votes, ties=settings.ties)
            tests.append(order_test(comparison.fit, without, comparison.comparison, comparison.dataset))
    for model in dict.fromkeys(comparison.comparison for comparison in compared):
        parts = {
            comparison.dataset: Part(comparison.votes, comparison.fit)
            for comparison in compared
            if comparison.comparison == model
        }
        tests.append(_datasets_test(model, parts))
    tests.append(_datasets_test("additive", additive))
    effects = effects_of({dataset: part.fit for dataset, part in additive.items()}, settings.factors)
    n_datasets = len(np.unique(additive[ALL].votes.dataset)) if ALL in additive else 0
    rows = [asdict(effect) | {"scope": _scope(effect.dataset, n_datasets)} for effect in effects]
    return rows, [test for test in tests if test is not None], additive


def _scope(dataset: str, n_datasets: int) -> str:
    """Say what an effect's interval holds for, besides other people."""
    if dataset != ALL:
        return f"dataset {dataset}"
    return f"these {n_datasets} datasets" if n_datasets > 1 else "these votes' datasets"


def left_out(votes: VotesTable, settings: AnalysisSettings) -> list[str]:
    """Name the items that the analysis by factor leaves out, those that lack the same factors together."""
    items_by_lacking: dict[str, list[str]] = {}
    for item, factors in items_without_levels(votes.items, settings.factors).items():
        items_by_lacking.setdefault(" or ".join(factors), []).append(item)
    return [
        f"{items[0]} has no level of {factors}: the analysis by factor leaves it out"
        if len(items) == 1
        else f"{', '.join(items)} have no level of {factors}: the analysis by factor leaves them out"
        for factors, items in items_by_lacking.items()
    ]


def without_results(
    votes: VotesTable, settings: AnalysisSettings, compared: Sequence[Comparison], effects: Sequence[Mapping[str, Any]]
) -> Iterator[str]:
    """Say which factors have a single level, which of several no scores over all datasets, and why none has effects.

    Parameters
    ----------
    votes, settings, compared : as in `factor_results`
    effects : rows of effects
    """
    part = only_compared(votes_with_levels(votes, settings.factors))
    factors = [factor for factor, _ in coding(settings.factors, part.items)[1]]
    for name in settings.comparisons:
        levels = {settings.factors[name][item] for item in part.items if name in settings.factors}
        if len(levels) == 1:
            yield f"all conditions have the same {name}, {levels.pop()}: nothing can be said about it"
    unscored = [factor for factor in factors if factor in settings.comparisons]
    unscored = [factor for factor in unscored if factor not in {comparison.comparison for comparison in compared}]
    if unscored:
        yield f"no vote is on conditions that differ in {' or '.join(unscored)} alone: no scores by it"
    fit = None
    if factors and not any(row["dataset"] == ALL for row in effects):
        fit = fit_additive(part, settings.factors, ties=settings.ties, order_effect=False)
    if fit is not None and fit.status != "ok":
        why = "the votes cannot tell them apart" if fit.status == "disconnected" else "they have no finite estimate"
        yield f"{listed(factors)}: no effects, because {why}"


def _datasets_test(model: str, parts: Mapping[str, Part]) -> ModelTest | None:
    if ALL not in parts:
        return None
    single = [part for dataset, part in parts.items() if dataset != ALL]
    return parts_differ("datasets differ", model, ALL, parts[ALL].fit, single)


def rows_of_tests(tests: Sequence[ModelTest]) -> list[dict[str, Any]]:
    """Return the tests with Holm's correction over each family: tests of one kind, on single datasets or on all
    votes. The models that contain the order effect ask the same question, so each of them is a family of its own.
    """
    families: dict[tuple[str, str, bool], list[ModelTest]] = {}
    for test in tests:
        kind = test.name.split()[0]
        families.setdefault((kind, test.model if kind == "order" else "", test.dataset == ALL), []).append(test)
    rows = []
    for family in families.values():
        p_values = [test.p_value if test.p_participant is None else test.p_participant for test in family]
        for test, corrected in zip(family, holm(np.array(p_values)).tolist(), strict=True):
            rows.append(asdict(test) | {"p_holm": corrected})
    return rows

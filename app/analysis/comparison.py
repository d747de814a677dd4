"""Select the votes of each comparison (all items, or one factor) and dataset, and fit the scores of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.analysis.bootstrap import Bootstrap, bootstrap_scores, participant_weights
from app.analysis.bradley_terry import Fit, fit_scores, only_compared
from app.analysis.factors import votes_on_factor, votes_with_levels
from app.analysis.settings import AnalysisSettings
from app.analysis.votes_table import VotesTable

Array = NDArray[np.float64]

ALL = "all"


@dataclass(frozen=True)
class Comparison:
    """A model fitted to the votes of a comparison (`all`, or a factor) on a dataset (or `all`)."""

    comparison: str
    dataset: str
    votes: VotesTable
    fit: Fit
    bootstrap: Bootstrap | None


def compare(votes: VotesTable, settings: AnalysisSettings) -> Iterator[Comparison]:
    """Fit every comparison on every dataset; bootstrap replicates draw the same participants in all of them."""
    weights = None
    if settings.bootstrap and votes.has_participants and len(votes):
        rng = np.random.default_rng(settings.seed)
        present, who = np.unique(votes.participant, return_inverse=True)
        names = tuple(votes.participants[index] for index in present)
        votes = replace(votes, participants=names, participant=who.astype(np.int32))
        weights = participant_weights(len(present), settings.bootstrap, rng)
    with_levels = votes_with_levels(votes, settings.factors)
    for comparison in (ALL, *settings.comparisons):
        chosen = votes if comparison == ALL else votes_on_factor(with_levels, settings.factors, comparison)
        for dataset in dataset_names(votes, settings):
            part = of_dataset(chosen, dataset)
            if len(part):
                yield _compare(comparison, dataset, only_compared(part), settings, weights)


def _compare(
    comparison: str, dataset: str, votes: VotesTable, settings: AnalysisSettings, weights: Array | None
) -> Comparison:
    fit = fit_by(settings, votes)
    has_sample = weights is not None and fit.status == "ok" and (fit.n_participants or 0) > 1
    bootstrap = bootstrap_scores(fit, votes, weights) if has_sample and weights is not None else None
    return Comparison(comparison, dataset, votes, fit, bootstrap)


def fit_by(settings: AnalysisSettings, votes: VotesTable) -> Fit:
    """Fit the items' scores with the ties, order effect and penalty of the settings."""
    return fit_scores(votes, ties=settings.ties, order_effect=settings.order_effect, penalty=settings.penalty)


def of_dataset(votes: VotesTable, dataset: str) -> VotesTable:
    """Return the votes on a dataset, or all votes."""
    return votes if dataset == ALL else votes.where(votes.dataset == votes.datasets.index(dataset))


def dataset_names(votes: VotesTable, settings: AnalysisSettings) -> tuple[str, ...]:
    """Return the datasets to analyse, then `all`."""
    return (*(votes.datasets if settings.by_dataset and votes.has_datasets else ()), ALL)

"""Select the votes of each comparison (all items, or one factor) and dataset, and fit the scores of each."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from app.analysis.comparisons.factors import votes_on_factor, votes_with_levels, wald_p_value
from app.analysis.model.bootstrap import Bootstrap, bootstrap_scores, participant_weights
from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.contrasts import Contrast, contrasts
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.separation import group_fits, separated_contrasts
from app.analysis.model.settings import AnalysisSettings
from app.analysis.model.showing_order import why_no_order_effect
from app.analysis.reading.votes_table import ALL, VotesTable, only_compared

Array = NDArray[np.float64]

MOST_ITEMS_OF_A_TEST = 300  # with an order effect; each step inverts a matrix
ORDER_LEVEL = 0.01  # below, the order effect belongs in every model; at 5 % chance would add it to every 20th study
PARTS = re.compile(r"\d+|\D+")


@dataclass(frozen=True)
class Comparison:
    """A model fitted to the votes of a comparison (`all`, or a factor) on a dataset (or `all`).

    Parameters
    ----------
    order_left_out : why the order effect that was asked for is not estimated
    """

    comparison: str
    dataset: str
    votes: VotesTable
    fit: Fit
    bootstrap: Bootstrap | None
    order_left_out: str | None = None

    @cached_property
    def groups(self) -> list[Fit]:
        """Fits of the groups that separated votes set apart; none where all scores have a maximum."""
        return group_fits(self.fit, self.votes) if self.fit.status == "separated" else []

    @cached_property
    def contrasts(self) -> list[Contrast]:
        """Differences of all pairs of items with their tests."""
        if self.fit.status == "separated":
            return separated_contrasts(self.fit, self.votes, self.groups)
        return contrasts(self.fit)


def natural_order(names: Iterable[str]) -> list[str]:
    """Return names in alphabetical order, with the numbers in them as numbers: box 2 before box 10."""

    def key(name: str) -> tuple[list[tuple[bool, str]], str]:
        parts = [
            (not part.isdigit(), part.zfill(20) if part.isdigit() else part.casefold()) for part in PARTS.findall(name)
        ]
        return parts, name

    return sorted(names, key=key)


def in_order(votes: VotesTable) -> VotesTable:
    """Return the votes with their datasets in natural order, in which every result names them."""
    names = natural_order(votes.datasets)
    if tuple(names) == votes.datasets:
        return votes
    places = np.array([names.index(name) for name in votes.datasets], np.int32)
    return replace(votes, datasets=tuple(names), dataset=places[votes.dataset])


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
            part = votes_on_dataset(chosen, dataset)
            if len(part):
                yield _compare(comparison, dataset, only_compared(part), settings, weights)


def _compare(
    comparison: str, dataset: str, votes: VotesTable, settings: AnalysisSettings, weights: Array | None
) -> Comparison:
    fit, order_left_out = fit_by(settings, votes)
    has_sample = weights is not None and fit.status == "ok" and (fit.n_participants or 0) > 1
    bootstrap = bootstrap_scores(fit, votes, weights) if has_sample and weights is not None else None
    return Comparison(comparison, dataset, votes, fit, bootstrap, order_left_out)


def fit_by(settings: AnalysisSettings, votes: VotesTable) -> tuple[Fit, str | None]:
    """Fit the items' scores with the ties, order effect and penalty of the settings.

    Returns
    -------
    fit : Fit
    order_left_out : why the order effect is not in it although the settings ask for it
    """
    why = None
    if settings.order_effect:
        why = why_no_order_effect(votes)
        if why is None:
            fit = fit_scores(votes, ties=settings.ties, order_effect=True, penalty=settings.penalty)
            if fit.status == "ok":
                return fit, None
            why = "with it the scores have no finite estimate"
    return fit_scores(votes, ties=settings.ties, penalty=settings.penalty), why


def tested_order(votes: VotesTable, settings: AnalysisSettings) -> tuple[AnalysisSettings, dict[str, Any] | None]:
    """Test whether being shown first matters, wherever that was recorded; if it does, the models are to have it.

    Parameters
    ----------
    votes : VotesTable, the votes to score
    settings : as given

    Returns
    -------
    settings : with the order effect if the votes show one (1 %, participants as the sample)
    row : the test, `order_effect`, `order_se`, `p_value`, `is_in_model`; None where it cannot be made
    """
    if settings.order_effect or not len(votes) or (votes.first_shown < 0).any():
        return settings, None
    compared = only_compared(votes)
    if len(compared.items) > MOST_ITEMS_OF_A_TEST or why_no_order_effect(compared) is not None:
        return settings, None
    fit = fit_scores(compared, ties=settings.ties, order_effect=True)
    if fit.status != "ok" or fit.theta is None or fit.covariance is None:
        return settings, None
    place = fit.design.n_effects
    has_people = votes.has_participants
    p_value = wald_p_value(fit, np.eye(fit.design.n_parameters)[place : place + 1]) if has_people else None
    if not has_people:
        p_value = float(2 * norm.sf(abs(fit.theta[place]) / np.sqrt(fit.covariance[place, place])))
    if p_value is None:
        return settings, None
    is_shown = p_value < ORDER_LEVEL
    row = {
        "order_effect": float(fit.theta[place]),
        "order_se": fit.error(place, by_participant=has_people),
        "p_value": p_value,
        "is_in_model": is_shown,
    }
    return (replace(settings, order_effect=True) if is_shown else settings), row


def votes_on_dataset(votes: VotesTable, dataset: str) -> VotesTable:
    """Return the votes on a dataset, or all votes."""
    return votes if dataset == ALL else votes.where(votes.dataset == votes.datasets.index(dataset))


def dataset_names(votes: VotesTable, settings: AnalysisSettings) -> tuple[str, ...]:
    """Return the datasets to analyse, then `all`."""
    return (*(votes.datasets if settings.by_dataset and votes.has_datasets else ()), ALL)

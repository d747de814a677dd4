"""Make tables of ratings from the votes of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.reading.cells import numbered_names
from app.analysis.reading.phrases import part
from app.analysis.reading.votes_table import VotesTable
from app.analysis.screening.observers import NOT_SMOOTH, n_without

Float = NDArray[np.float64]
Names = tuple[tuple[str, str], ...]


def counted_ratings(votes: VotesTable, rating: Float) -> tuple[VotesTable, Float]:
    """Return the votes that count, with their ratings: no practice, no exclusion, no check of the participant.

    Parameters
    ----------
    votes : all of a study
    rating : float64 (N,), one for each vote
    """
    return votes.used(), rating[votes.is_used]


def rating_table(
    votes: VotesTable, rating: Float, protocol: str, scale: tuple[float, float], reference: str
) -> RatingTable:
    """Return the ratings of single stimuli; each is of `item_b`.

    Parameters
    ----------
    votes : those that count
    rating : float64 (N,), one for each vote
    protocol : ACR, ACR-HR or DCR
    scale : its ends, worst and best
    reference : the condition that is the reference among the rated ones; empty: none
    """
    participants, person = _participants(votes)
    items, item = _stimuli(votes, votes.item_b)
    is_reference = np.array([bool(reference) and condition == reference for _, condition in items], bool)
    return RatingTable(participants, items, person, item, rating, is_reference, protocol.lower(), *scale)


def comparison_table(votes: VotesTable, rating: Float) -> ComparisonTable:
    """Return the comparisons of two stimuli (CCR).

    Parameters
    ----------
    votes : those that count
    rating : float64 (N,), one for each vote
    """
    participants, person = _participants(votes)
    items, both = _stimuli(votes, np.stack([votes.item_a, votes.item_b], axis=1).ravel())
    return ComparisonTable(participants, items, person, both[::2], both[1::2], rating, votes.first_shown == 0)


def with_films(raters: Sequence[Mapping[str, Any]], votes: VotesTable) -> list[dict[str, Any]]:
    """Return participants' rows with what the votes tell of their films, and a flag where these did not run.

    Parameters
    ----------
    raters : of `analyse_ratings`
    votes : those that count
    """
    parts = {votes.participants[index]: theirs for index, theirs in votes.by_participant().items()}
    rows = []
    for row in raters:
        theirs = parts[row["participant"]]
        n = n_without(theirs, theirs.shown_smoothly)
        flags = [*row["flags"], *([NOT_SMOOTH.format(part(n, theirs.n_votes, "vote"))] if n else [])]
        rows.append({**row, "not_smooth": n, "flags": flags})
    return rows


def _participants(votes: VotesTable) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    known: dict[int, int] = {}
    index = numbered_names(votes.participant.tolist(), known)
    return tuple(votes.participants[code] for code in known), index


def _stimuli(votes: VotesTable, item: NDArray[np.int32]) -> tuple[Names, NDArray[np.intp]]:
    """Return dataset and condition of each stimulus, and the stimulus of each entry of `item`, int32 (N,) or (2 N,)."""
    dataset = np.repeat(votes.dataset, len(item) // max(len(votes), 1))
    known: dict[tuple[int, int], int] = {}
    index = numbered_names(zip(dataset.tolist(), item.tolist(), strict=True), known)
    return tuple((votes.datasets[place], votes.items[condition]) for place, condition in known), index

"""Evaluate attention checks: pairs of a stimulus with itself, and pairs shown a second time."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.analysis.reading.votes_table import IDENTICAL, MAIN, NONE, REPEAT, VotesTable


def check_rows(votes: VotesTable) -> list[dict[str, Any]]:
    """Count each participant's answers on attention checks.

    An attentive participant has no preference between a stimulus and itself, and chooses the same again when a pair
    comes back unchanged. Like the flags of `observer_rows`, these numbers inform a decision; they exclude nobody.

    Parameters
    ----------
    votes : VotesTable, all votes; practice and excluded rows are passed over

    Returns
    -------
    list of dict, {"participant", "n_identical", "n_identical_none", "n_repeated", "n_repeated_same"} of every
    participant with such trials
    """
    counting = votes.where(~(votes.practice | votes.excluded))
    if not votes.has_participants or not np.any(counting.role != MAIN):
        return []
    return [
        {"participant": votes.participants[participant], **_counts(part)}
        for participant, part in counting.by_participant().items()
        if np.any(part.role != MAIN)
    ]


def _counts(votes: VotesTable) -> dict[str, int]:
    before = {_presentation(votes, row): votes.choice[row] for row in np.flatnonzero(votes.role == MAIN)}
    again = [(_presentation(votes, row), votes.choice[row]) for row in np.flatnonzero(votes.role == REPEAT)]
    known = [(presentation, choice) for presentation, choice in again if presentation in before]
    identical = votes.choice[votes.role == IDENTICAL]
    return {
        "n_identical": len(identical),
        "n_identical_none": int(np.sum(identical == NONE)),
        "n_repeated": len(known),
        "n_repeated_same": sum(bool(before[presentation] == choice) for presentation, choice in known),
    }


def _presentation(votes: VotesTable, row: np.integer[Any]) -> tuple[int, int, int]:
    return int(votes.dataset[row]), int(votes.item_a[row]), int(votes.item_b[row])

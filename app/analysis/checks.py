"""Votes that check the participant instead of the stimuli: a stimulus against itself, and pairs seen again."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.analysis.votes_table import IDENTICAL, MAIN, NONE, REPEAT, VotesTable


def check_rows(votes: VotesTable) -> list[dict[str, Any]]:
    """Return what each participant answered where the answer says something about the participant.

    Whoever looks has no preference between a stimulus and itself, and chooses the same again when a pair comes back
    just as it was. Like the flags of `observer_rows` these numbers inform a decision; they exclude nobody.

    Parameters
    ----------
    votes : VotesTable
        All votes; practice and excluded rows are passed over.

    Returns
    -------
    list of dict
        {"participant", "n_identical", "n_identical_none", "n_repeated", "n_repeated_same"} of those who were checked.
    """
    counting = votes.where(~(votes.practice | votes.excluded))
    if not votes.has_participants or not np.any(counting.role != MAIN):
        return []
    checked = np.unique(counting.participant[counting.role != MAIN])
    return [
        {"participant": votes.participants[one], **_of_participant(counting.where(counting.participant == one))}
        for one in checked
    ]


def _of_participant(own: VotesTable) -> dict[str, int]:
    before = {_presentation(own, row): own.choice[row] for row in np.flatnonzero(own.role == MAIN)}
    again = [(_presentation(own, row), own.choice[row]) for row in np.flatnonzero(own.role == REPEAT)]
    known = [(presentation, choice) for presentation, choice in again if presentation in before]
    identical = own.choice[own.role == IDENTICAL]
    return {
        "n_identical": len(identical),
        "n_identical_none": int(np.sum(identical == NONE)),
        "n_repeated": len(known),
        "n_repeated_same": sum(bool(before[presentation] == choice) for presentation, choice in known),
    }


def _presentation(votes: VotesTable, row: np.integer[Any]) -> tuple[int, int, int]:
    return int(votes.dataset[row]), int(votes.item_a[row]), int(votes.item_b[row])

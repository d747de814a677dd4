"""Screening of participants: what is unusual about somebody's votes. Flags inform a decision of the experimenter;
they exclude nobody.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.triads import Triads, pooled_p_value
from app.analysis.votes import NONE, A, B, VotesTable

CHANCE = 0.05  # a pooled p-value above it means no more consistent than random votes


def observer_rows(votes: VotesTable, screened: Sequence[Triads]) -> list[dict[str, Any]]:
    """Return one row per participant, with numbers and flags."""
    if not votes.has_participants:
        return []
    by_participant: dict[str, list[Triads]] = {}
    for row in screened:
        by_participant.setdefault(row.participant, []).append(row)
    rows = []
    for index, participant in enumerate(votes.participants):
        own = votes.where(votes.participant == index)
        if len(own):
            rows.append(_observer_row(participant, own, by_participant.get(participant, [])))
    return rows


def _observer_row(participant: str, votes: VotesTable, own: list[Triads]) -> dict[str, Any]:
    n = votes.n_votes
    pooled = pooled_p_value(own)
    row: dict[str, Any] = {
        "participant": participant,
        "n_votes": n,
        "tie_rate": _share(votes, votes.choice == NONE, n),
        "side_a_rate": _share(votes, votes.choice == A, int(votes.count[votes.choice <= B].sum())),
        "circular": sum(triad.circular for triad in own),
        "circular_p_value": pooled,
        "median_response_ms": _median(votes.response_ms),
        "flags": [],
    }
    if pooled is not None and pooled > CHANCE:
        row["flags"].append("no more consistent than chance")
    return row


def _share(votes: VotesTable, chosen: NDArray[np.bool_], n: int) -> float | None:
    return float(votes.count[chosen].sum() / n) if n else None


def _median(values: NDArray[np.float64]) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else None

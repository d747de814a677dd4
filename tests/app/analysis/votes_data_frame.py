"""A votes table as a data frame."""

from __future__ import annotations

import numpy as np
import pandas as pd

from app.analysis.reading.votes_table import CHOICES, ROLES, VotesTable


def frame_from_votes(votes: VotesTable) -> pd.DataFrame:
    """Return the table with names instead of indices, in the columns of the exchange format."""
    names = np.array(votes.items, object)
    first = np.where(votes.first_shown == 1, names[votes.item_b], names[votes.item_a])
    return pd.DataFrame(
        {
            "participant": np.array(votes.participants, object)[votes.participant],
            "dataset": np.array(votes.datasets, object)[votes.dataset],
            "item_a": names[votes.item_a],
            "item_b": names[votes.item_b],
            "choice": np.array(CHOICES, object)[votes.choice],
            "first_shown": np.where(votes.first_shown < 0, "", first),
            "response_ms": votes.response_ms,
            "practice": votes.practice,
            "excluded": votes.excluded,
            "reason": votes.reason,
            "count": votes.count,
            "role": np.array(ROLES, object)[votes.role],
        }
    )

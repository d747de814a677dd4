"""Count the votes of a running study minute by minute, for its overview."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import Connection, select

from app.store.database.tables import vote
from app.store.participants.exclusions import sessions_in


def votes_by_minute(connection: Connection, study_id: int, now: datetime, minutes: int) -> list[int]:
    """Count the votes of each of the last minutes, the oldest first."""
    since = now - timedelta(minutes=minutes)
    rows = connection.scalars(
        # "+ 0": the latest votes are found by their time, not by their sessions
        select(vote.c.received_at).where(vote.c.received_at > since, (vote.c.session_id + 0).in_(sessions_in(study_id)))
    )
    counts = [0] * minutes
    for received_at in rows:
        counts[max(0, min(minutes - 1, int((received_at - since).total_seconds() // 60)))] += 1
    return counts

"""Select, in SQL, who counts: all but previews, and those who are excluded."""

from __future__ import annotations

from typing import Any

from sqlalchemy import ColumnElement, Select, exists, select

from app.store.database.tables import exclusion, participant, session

AGAIN = "takes part again"  # why what somebody gave before counts no more


def takes_part_in(study_id: ColumnElement[int] | int) -> ColumnElement[bool]:
    """SQL condition: the participant belongs to a study and is no preview."""
    return (participant.c.study_id == study_id) & participant.c.is_preview.is_(False)


def sessions_in(study_id: int) -> Select[Any]:
    """Select the ids of a study's sessions, but of no preview."""
    return select(session.c.id).select_from(session.join(participant)).where(takes_part_in(study_id))


def in_force(participant_id: ColumnElement[int] | int) -> ColumnElement[bool]:
    """SQL condition: the exclusion is the participant's and was not undone."""
    return (exclusion.c.participant_id == participant_id) & exclusion.c.undone_at.is_(None)


COUNTING = (  # of a query of sessions that is joined to `participant`
    session.c.withdrawn_at,
    select(exclusion.c.reason)
    .where(in_force(participant.c.id))
    .correlate(participant)
    .scalar_subquery()
    .label("exclusion"),
)


def counting(row: Any) -> dict[str, Any]:
    """Say whether what a participant gave counts; the row has the columns of COUNTING."""
    reason = "withdrawn" if row.withdrawn_at is not None else row.exclusion or ""
    return {"excluded": bool(reason), "reason": reason}


def is_excluded() -> ColumnElement[bool]:
    """SQL condition: the participant is excluded."""
    return exists().where(in_force(participant.c.id))

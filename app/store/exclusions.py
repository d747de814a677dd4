"""Exclusions: whose votes do not count, for a reason, until that is undone."""

from __future__ import annotations

from sqlalchemy import ColumnElement, exists

from app.store.tables import exclusion, participant


def in_force(participant_id: ColumnElement[int] | int) -> ColumnElement[bool]:
    """Which exclusion of a participant holds: the one that was not undone."""
    return (exclusion.c.participant_id == participant_id) & exclusion.c.undone_at.is_(None)


def is_excluded() -> ColumnElement[bool]:
    """Whether the participant of a row is excluded."""
    return exists().where(in_force(participant.c.id))

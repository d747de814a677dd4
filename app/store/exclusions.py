"""Whose votes do not count: a preview's never, an excluded participant's for a reason, until that is undone."""

from __future__ import annotations

from sqlalchemy import ColumnElement, exists

from app.store.tables import exclusion, participant


def takes_part_in(study_id: ColumnElement[int] | int) -> ColumnElement[bool]:
    """Whether the participant of a row is one of a study, and no preview."""
    return (participant.c.study_id == study_id) & participant.c.is_preview.is_(False)


def in_force(participant_id: ColumnElement[int] | int) -> ColumnElement[bool]:
    """Which exclusion of a participant holds: the one that was not undone."""
    return (exclusion.c.participant_id == participant_id) & exclusion.c.undone_at.is_(None)


def is_excluded() -> ColumnElement[bool]:
    """Whether the participant of a row is excluded."""
    return exists().where(in_force(participant.c.id))

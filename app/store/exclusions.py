"""SQL conditions for votes that do not count: previews', and those of excluded participants."""

from __future__ import annotations

from sqlalchemy import ColumnElement, exists

from app.store.tables import exclusion, participant


def takes_part_in(study_id: ColumnElement[int] | int) -> ColumnElement[bool]:
    """SQL condition: the participant belongs to a study and is no preview."""
    return (participant.c.study_id == study_id) & participant.c.is_preview.is_(False)


def in_force(participant_id: ColumnElement[int] | int) -> ColumnElement[bool]:
    """SQL condition: the exclusion is the participant's and was not undone."""
    return (exclusion.c.participant_id == participant_id) & exclusion.c.undone_at.is_(None)


def is_excluded() -> ColumnElement[bool]:
    """SQL condition: the participant is excluded."""
    return exists().where(in_force(participant.c.id))

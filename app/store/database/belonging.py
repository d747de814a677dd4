"""Select, by SQL conditions, the rows of a table that belong to a study, or to some of its participants."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Select, Table, select

from app.store.database.tables import dataset, pair, participant, practice_pair, session, study

People = Select[Any] | Sequence[int]  # ids of participants, or a query of them


def rows_of_study(table: Table, study_id: int) -> ColumnElement[bool] | None:
    """SQL condition: the row is of the study; None for tables that are of no study."""
    datasets = select(dataset.c.id).where(dataset.c.study_id == study_id)
    if table is study:
        return table.c.id == study_id
    if "of_media" in table.c:
        of_pairs = select(pair.c.media).where(pair.c.dataset_id.in_(datasets))
        of_practice = select(practice_pair.c.media).where(practice_pair.c.study_id == study_id)
        return table.c.of_media.in_(of_pairs) | table.c.of_media.in_(of_practice)
    if "study_id" in table.c:
        return table.c.study_id == study_id
    if "dataset_id" in table.c:
        return table.c.dataset_id.in_(datasets)
    return rows_of_people(table, select(participant.c.id).where(participant.c.study_id == study_id))


def rows_of_people(table: Table, people: People) -> ColumnElement[bool] | None:
    """SQL condition: the row is of one of the participants; None for tables that are of nobody."""
    if table is participant:
        return table.c.id.in_(people)
    if "participant_id" in table.c:
        return table.c.participant_id.in_(people)
    if "session_id" in table.c:
        return table.c.session_id.in_(select(session.c.id).where(session.c.participant_id.in_(people)))
    return None

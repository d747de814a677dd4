"""Delete all rows of a study."""

from __future__ import annotations

from sqlalchemy import ColumnElement, Connection, Table, delete, select, update

from app.store.schema import metadata
from app.store.tables import (
    api_token,
    audit_entry,
    dataset,
    experimenter,
    pair,
    participant,
    practice_pair,
    session,
    study,
)


def delete_rows(connection: Connection, study_id: int) -> None:
    """Delete a study's rows from all tables, referring rows first; entries of the audit log stay, as of no study.

    Who may see it is no longer said, lest another study of its name be seen.
    """
    slug = connection.execute(select(study.c.slug).where(study.c.id == study_id)).scalar_one()
    for holder in (experimenter, api_token):
        for row in connection.execute(select(holder.c.id, holder.c.studies).where(holder.c.studies.is_not(None))):
            others = [name for name in row.studies if name != slug]
            connection.execute(update(holder).where(holder.c.id == row.id).values(studies=others))
    connection.execute(update(audit_entry).where(audit_entry.c.study_id == study_id).values(study_id=None))
    tables = list(reversed(metadata.sorted_tables))
    tables.sort(key=lambda table: "of_media" not in table.c)  # films of pairs first: no reference puts them in order
    for table in tables:
        if table is not audit_entry and (belongs := _belongs(table, study_id)) is not None:
            connection.execute(delete(table).where(belongs))


def _belongs(table: Table, study_id: int) -> ColumnElement[bool] | None:
    """SQL condition: the row is of the study; None for tables that are of no study."""
    people = select(participant.c.id).where(participant.c.study_id == study_id)
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
    if "participant_id" in table.c:
        return table.c.participant_id.in_(people)
    if "session_id" in table.c:
        return table.c.session_id.in_(select(session.c.id).where(session.c.participant_id.in_(people)))
    return None

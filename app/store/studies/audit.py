"""Keep the audit log: who did what, when. An entry is added in the transaction of its change and never altered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, exists, func, insert, or_, select

from app.store.database.engine import Database, sorted_by
from app.store.database.tables import audit_entry
from app.store.database.tables import study as study_table
from app.store.studies.studies import Study
from app.study.languages.text import storable, storable_content

COMMAND_LINE = "command line"
STRANGER = "stranger"
PARTICIPANT = "participant"
LONGEST_SUBJECT = 200
SORTABLE: Mapping[str, ColumnElement[Any]] = {  # columns by which `audit_records` can be sorted
    "when": audit_entry.c.id,
    "who": audit_entry.c.actor,
    "what": audit_entry.c.action,
    "study": study_table.c.slug,
}


@dataclass(frozen=True)
class Entry:
    """What was done, and to what.

    Parameters
    ----------
    action : in a few words, for example "study paused"
    subject : whom or what it was done to, for example a participant's label
    detail : what an auditor would want to know beyond that; nothing secret
    """

    action: str
    study_id: int | None = None
    subject: str = ""
    detail: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Actor:
    """An experimenter who changes something now, and notes it in the transaction of the change."""

    id: int
    name: str
    now: datetime

    def note(
        self, connection: Connection, action: str, study: Study | None = None, subject: str = "", **detail: object
    ) -> None:
        record(connection, self.name, Entry(action, study.id if study else None, subject, detail), self.now)


def record(connection: Connection, actor: str, entry: Entry, now: datetime) -> None:
    """Add an entry to the log, in the transaction of the change; what no file can hold becomes U+FFFD."""
    values = {
        "at": now,
        "actor": storable(actor),
        "action": entry.action,
        "study_id": entry.study_id,
        "subject": storable(entry.subject)[:LONGEST_SUBJECT],
        "detail": storable_content(dict(entry.detail)),
    }
    connection.execute(insert(audit_entry).values(**values))


def record_alone(database: Database, actor: str, entry: Entry, now: datetime) -> None:
    """Add an entry that belongs to no change, for example a refusal."""
    with database.writing() as connection:
        record(connection, actor, entry, now)


def is_recorded(connection: Connection, study_id: int, action: str, at: datetime) -> bool:
    """Say whether the log holds an action on a study at a moment."""
    entry = (audit_entry.c.study_id == study_id, audit_entry.c.action == action, audit_entry.c.at == at)
    return bool(connection.scalar(select(exists().where(*entry))))


def audit_records(
    connection: Connection,
    *,
    study_id: int | None = None,
    search: str = "",
    sort: str = "",
    until: int | None = None,
    limit: int | None = None,
    offset: int = 0,
) -> list[dict[str, Any]]:
    """Return entries, the newest first.

    Parameters
    ----------
    study_id : None: of all studies and none
    search : a part of the actor, action or subject
    sort : of SORTABLE; empty: the newest first
    until : number of the newest entry; None: of all
    """
    order = (*sorted_by(SORTABLE, sort), audit_entry.c.id.desc())
    rows = _sought(_entries(), study_id, search).order_by(*order).limit(limit).offset(offset)
    if until is not None:
        rows = rows.where(audit_entry.c.id <= until)
    return [dict(row._mapping) for row in connection.execute(rows)]


def audit_state(connection: Connection, *, study_id: int | None = None, search: str = "") -> tuple[int, int | None]:
    """Return how many entries `audit_records` finds, and the newest one's number; None without any."""
    counts: tuple[Any, ...] = (func.count(), func.max(audit_entry.c.id))
    n, newest = connection.execute(_sought(select(*counts).select_from(audit_entry), study_id, search)).one()
    return n, newest


def _sought(query: Select[Any], study_id: int | None, search: str) -> Select[Any]:
    if study_id is not None:
        query = query.where(audit_entry.c.study_id == study_id)
    if search:
        columns = (audit_entry.c.actor, audit_entry.c.action, audit_entry.c.subject)
        query = query.where(or_(*(column.icontains(search, autoescape=True) for column in columns)))
    return query


def _entries() -> Select[Any]:
    columns = (audit_entry.c.id.label("entry"), audit_entry.c.at, audit_entry.c.actor, audit_entry.c.action)
    more = (study_table.c.slug.label("study"), audit_entry.c.subject, audit_entry.c.detail)
    return select(*columns, *more).select_from(audit_entry.outerjoin(study_table))

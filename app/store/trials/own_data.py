"""Collect all that a participant gave, for themselves: as they saw it, with A and B, without names of conditions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, Label, Table, select

from app.store.database.tables import (
    participant,
    recruit,
    screening_display,
    screening_entry,
    screening_item,
    screening_test,
    session,
    stage_record,
    trial,
    vote,
)
from app.store.trials.sessions import Session
from app.study.stages import FINISHED

TEST = select(screening_test.c.test).where(screening_test.c.id == screening_item.c.screening_test_id)
GIVEN: dict[
    str, tuple[Table, tuple[str | Label[str], ...]]
] = {  # what is left out is the server's, or would say what was compared
    "stages": (stage_record, ("stage", "data", "completed_at")),
    "votes": (
        vote,
        ("choice", "rating", "first_shown", "shown_ms", "response_ms", "viewing", "received_at"),
    ),
    "screening_display": (screening_display, ("pixel_mm", "distance_mm", "distance_source", "measured", "measured_at")),
    "screening_tests": (screening_test, ("test", "started_at", "finished_at", "verdict", "result")),
    "screening_answers": (
        screening_item,
        (TEST.scalar_subquery().label("test"), "number", "answer", "response_ms", "answered_at"),
    ),
    "screening_entries": (screening_entry, ("test", "instrument", "result", "verdict", "logmar", "entered_at")),
}
NOTES = (
    "Notes of experimenters, on what was said beside the study, are not in this file, because they may name what is "
    "compared. Ask the study's contact for them."
)


def own_data(connection: Connection, of_session: Session) -> dict[str, Any]:
    """Return what the participant of a session gave, as JSON may hold it; times are ISO 8601.

    Parameters
    ----------
    connection : to read from
    of_session : whose participant asks
    """
    who = connection.execute(
        select(
            participant.c.id, participant.c.label, session.c.started_at, session.c.finished_at, session.c.withdrawn_at
        )
        .select_from(session.join(participant))
        .where(session.c.id == of_session.id)
    ).one()
    given = {
        name: _rows(connection, table, columns, table.c.session_id == of_session.id)
        for name, (table, columns) in GIVEN.items()
    }
    is_voided = (trial.c.session_id == of_session.id) & trial.c.voided_at.is_not(None)
    interrupted = _rows(connection, trial, ("void_reason", "void_viewing", "voided_at"), is_voided)
    code = ("completion_code",) if of_session.stage == FINISHED else ()  # who has it is paid
    came = _rows(connection, recruit, ("outside_id", "kept", *code), recruit.c.participant_id == who.id)
    times = {name: _plain(getattr(who, name)) for name in ("started_at", "finished_at", "withdrawn_at")}
    facts = {"study": of_session.name, "participant": who.label, "language": of_session.language, **times}
    return {**facts, "stage": of_session.stage, **given, "interrupted": interrupted, "recruiting": came, "notes": NOTES}


def _rows(
    connection: Connection, table: Table, columns: Sequence[str | Label[str]], belongs: ColumnElement[bool]
) -> list[dict[str, Any]]:
    chosen = [table.c[column] if isinstance(column, str) else column for column in columns]
    rows = connection.execute(select(*chosen).where(belongs).order_by(table.c.id))
    return [{name: _plain(value) for name, value in row._mapping.items()} for row in rows]


def _plain(value: Any) -> Any:
    return value.isoformat() if hasattr(value, "isoformat") else value

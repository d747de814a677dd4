"""Tell whether tables of a study have changed, without reading their rows into Python."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import JSON, ColumnElement, Connection, Float, Integer, LargeBinary, Table, func, select

from app.store.engine import UtcDateTime
from app.store.tables import dataset, participant, session

Tables = Iterable[Table]


def table_state(connection: Connection, study_id: int, tables: Tables) -> list[tuple[Any, ...]]:
    """Return numbers that change when a row of a study is added, altered or deleted, for each table.

    They are the number of rows, the largest id, the latest times, and the sums of numbers and of texts' lengths. JSON
    is left out: where it changes, a time beside it does.

    Parameters
    ----------
    tables : with a column `study_id`, `session_id`, `participant_id` or `dataset_id`
    """
    return [
        tuple(connection.execute(select(func.count(), *_marks(table)).where(_is_of(table, study_id))).one())
        for table in tables
    ]


def _marks(table: Table) -> list[ColumnElement[Any]]:
    marks: list[ColumnElement[Any]] = []
    for column in table.c:
        if column.name == "id" or isinstance(column.type, UtcDateTime):
            marks += [func.max(column), func.count(column)]
        elif isinstance(column.type, (Integer, Float)):
            marks.append(func.sum(column))
        elif not isinstance(column.type, (JSON, LargeBinary)):
            marks.append(func.sum(func.length(column)))
    return marks


def _is_of(table: Table, study_id: int) -> ColumnElement[bool]:
    if "study_id" in table.c:
        return table.c.study_id == study_id
    people = select(participant.c.id).where(participant.c.study_id == study_id)
    keys = {
        "session_id": select(session.c.id).where(session.c.participant_id.in_(people)),
        "participant_id": people,
        "dataset_id": select(dataset.c.id).where(dataset.c.study_id == study_id),
    }
    return next(table.c[name].in_(those) for name, those in keys.items() if name in table.c)

"""Tell whether tables of a study have changed, without reading their rows into Python."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import JSON, ColumnElement, Connection, Float, Integer, LargeBinary, Table, func, select

from app.store.database.belonging import rows_of_study
from app.store.database.engine import UtcDateTime

Tables = Iterable[Table]


def table_state(connection: Connection, study_id: int, tables: Tables) -> list[tuple[Any, ...]]:
    """Return numbers that change when a row of a study is added, altered or deleted, for each table.

    They are the number of rows, the largest id, the latest times, and the sums of numbers and of texts' lengths. JSON
    is left out: where it changes, a time beside it does.

    Parameters
    ----------
    tables : whose rows are of a study
    """
    states = []
    for table in tables:
        belongs = rows_of_study(table, study_id)
        assert belongs is not None, f"{table.name} is of no study"
        states.append(tuple(connection.execute(select(func.count(), *_marks(table)).where(belongs)).one()))
    return states


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

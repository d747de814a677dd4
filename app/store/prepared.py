"""Statements of which many run each second: compiled once, and run by the driver.

SQLAlchemy looks a statement up, goes through its parameters and describes its result whenever it runs. For the three
statements of a batch of votes that takes longer than the database does (bench/server.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic_core import to_json
from sqlalchemy import ARRAY, JSON, BindParameter, Column, ColumnElement, Connection, any_, bindparam, func, select
from sqlalchemy.dialects.postgresql.psycopg import PGDialect_psycopg
from sqlalchemy.dialects.sqlite.pysqlite import SQLiteDialect_pysqlite
from sqlalchemy.engine import Dialect
from sqlalchemy.sql.dml import Insert
from sqlalchemy.sql.selectable import Select

from app.store.engine import run_by_driver

Row = Mapping[str, Any]


def _json(value: Any) -> str:
    return to_json(value).decode()


def _as_it_is(value: Any) -> Any:
    return value


DIALECTS: dict[str, Callable[[], Dialect]] = {
    "sqlite": lambda: SQLiteDialect_pysqlite(paramstyle="qmark", json_serializer=_json),
    "postgresql": lambda: PGDialect_psycopg(paramstyle="format", json_serializer=_json),  # type: ignore[no-untyped-call]
}


class Prepared:
    """A statement in the words of a database; its errors are SQLAlchemy's.

    Parameters
    ----------
    dialect_name : sqlite or postgresql
    columns : of an INSERT, those that its rows have
    """

    def __init__(
        self, statement: Select[Any] | Insert, dialect_name: str, columns: Sequence[str] | None = None
    ) -> None:
        self._dialect = DIALECTS[dialect_name]()
        compiled = statement.compile(dialect=self._dialect, column_keys=columns)
        self._text = str(compiled)
        self._parameters = [self._parameter(name, compiled.binds[name]) for name in compiled.positiontup or ()]

    def _parameter(self, name: str, parameter: BindParameter[Any]) -> tuple[str | None, Any]:
        """What stands at one place of the statement: a name and how its value is told, or a constant."""
        process = parameter.type.dialect_impl(self._dialect).bind_processor(self._dialect) or _as_it_is
        return (name, process) if parameter.required else (None, process(parameter.value))

    def rows(self, connection: Connection, **values: Any) -> list[tuple[Any, ...]]:
        """What a SELECT finds."""
        return run_by_driver(
            connection, self._text, lambda cursor, text: cursor.execute(text, self._bound(values)).fetchall()
        )

    def insert(self, connection: Connection, rows: Sequence[Row]) -> int:
        """Insert rows; how many there are of them then."""

        def insert_each(cursor: Any, text: str) -> int:
            cursor.executemany(text, [self._bound(row) for row in rows])
            n_rows: int = cursor.rowcount
            return n_rows

        return run_by_driver(connection, self._text, insert_each)

    def _bound(self, values: Row) -> list[Any]:
        return [process(values[name]) if name else process for name, process in self._parameters]


def among(column: Column[Any], parameter: str, dialect_name: str) -> ColumnElement[bool]:
    """Whether a column's value is in a list that is one parameter: lists of all lengths have one statement."""
    if dialect_name == "postgresql":
        return column == any_(bindparam(parameter, type_=ARRAY(column.type)))
    members = func.json_each(bindparam(parameter, type_=JSON)).table_valued("value")
    return column.in_(select(members.c.value))

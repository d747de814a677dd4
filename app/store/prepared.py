"""Statements of which many run each second: compiled once, and run by the driver.

SQLAlchemy looks a statement up, goes through its parameters and describes its result whenever it runs. For the three
statements of a batch of votes that takes longer than the database does (bench/server.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from pydantic_core import to_json
from sqlalchemy import ARRAY, JSON, Column, ColumnElement, Connection, any_, bindparam, func, select
from sqlalchemy.dialects.postgresql.psycopg import PGDialect_psycopg
from sqlalchemy.dialects.sqlite.pysqlite import SQLiteDialect_pysqlite
from sqlalchemy.engine import Dialect
from sqlalchemy.exc import DBAPIError
from sqlalchemy.sql.dml import Insert
from sqlalchemy.sql.selectable import Select

Row = Mapping[str, Any]
Found = TypeVar("Found")


def _json(value: Any) -> str:
    return to_json(value).decode()


DIALECTS: dict[str, Callable[[], Dialect]] = {
    "sqlite": lambda: SQLiteDialect_pysqlite(paramstyle="named", json_serializer=_json),
    "postgresql": lambda: PGDialect_psycopg(json_serializer=_json),  # type: ignore[no-untyped-call]
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
        self._constants: dict[str, Any] = {}
        self._processors: list[tuple[str, Callable[[Any], Any]]] = []
        for parameter, name in compiled.bind_names.items():
            process = parameter.type.dialect_impl(self._dialect).bind_processor(self._dialect)
            if not parameter.required:
                self._constants[name] = process(parameter.value) if process else parameter.value
            elif process:
                self._processors.append((name, process))

    def rows(self, connection: Connection, **values: Any) -> list[tuple[Any, ...]]:
        """What a SELECT finds."""
        return self._run(connection, lambda cursor: cursor.execute(self._text, self._bound(values)).fetchall())

    def insert(self, connection: Connection, rows: Sequence[Row]) -> int:
        """Insert rows; how many there are of them then."""

        def insert_each(cursor: Any) -> int:
            cursor.executemany(self._text, [self._bound(row) for row in rows])
            n_rows: int = cursor.rowcount
            return n_rows

        return self._run(connection, insert_each)

    def _bound(self, values: Row) -> dict[str, Any]:
        bound = {**self._constants, **values}
        for name, process in self._processors:
            bound[name] = process(bound[name])
        return bound

    def _run(self, connection: Connection, what: Callable[[Any], Found]) -> Found:
        cursor = connection.connection.cursor()
        try:
            return what(cursor)
        except connection.dialect.loaded_dbapi.Error as error:
            raise DBAPIError.instance(
                self._text, None, error, connection.dialect.loaded_dbapi.Error, dialect=connection.dialect
            ) from error
        finally:
            cursor.close()


def among(column: Column[Any], parameter: str, dialect_name: str) -> ColumnElement[bool]:
    """Whether a column's value is in a list that is one parameter: lists of all lengths have one statement."""
    if dialect_name == "postgresql":
        return column == any_(bindparam(parameter, type_=ARRAY(column.type)))
    members = func.json_each(bindparam(parameter, type_=JSON)).table_valued("value")
    return column.in_(select(members.c.value))

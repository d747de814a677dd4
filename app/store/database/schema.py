"""Name the keys and checks of all tables, and define the kinds of their columns."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Column, ColumnElement, ForeignKey, Index, Integer, MetaData, String, Table
from sqlalchemy.schema import SchemaItem

NAMES = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s",
    "pk": "pk_%(table_name)s",
}
metadata = MetaData(naming_convention=NAMES)


def table(name: str, *items: SchemaItem) -> Table:
    """Define a table whose primary key counts its rows."""
    return Table(name, metadata, Column("id", Integer, primary_key=True), *items)


def unique_where(name: str, *columns: Column[Any], where: ColumnElement[bool]) -> Index:
    """Define a unique index over the rows of which a condition holds."""
    return Index(name, *columns, unique=True, sqlite_where=where, postgresql_where=where)


def reference(target: str, *, index: bool = True) -> Column[int]:
    """Return a foreign key to another table's row."""
    return Column(f"{target}_id", ForeignKey(f"{target}.id"), nullable=False, index=index)


def required(name: str, kind: Any, **options: Any) -> Column[Any]:
    """Return a column that is never NULL."""
    return Column(name, kind, nullable=False, **options)


def digest(name: str, **options: Any) -> Column[str]:
    """Return a column for a SHA-256, hexadecimal."""
    return required(name, String(64), **options)

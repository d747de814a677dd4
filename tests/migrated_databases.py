"""New SQLite files as copies of one that has all tables, as migrating each takes longer."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from app.store.database.engine import Database, open_database
from app.store.database.migrate import newest_version, upgrade

on_sqlite = pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True)  # alone


def copied_where_new(template: Path) -> Callable[[Database], str]:
    """An `upgrade` that copies a template, made at first use, into a file without tables; others are migrated."""

    def copy_or_upgrade(database: Database) -> str:
        if not _is_new_file(database):
            return upgrade(database)
        if not template.is_file():
            with open_database(f"sqlite:///{template}") as first:
                upgrade(first)
        with sqlite3.connect(template) as source, database.engine.connect() as connection:
            source.backup(connection.connection.driver_connection)  # type: ignore[arg-type]  # it is of sqlite3
        source.close()
        return newest_version()

    return copy_or_upgrade


def _is_new_file(database: Database) -> bool:
    if database.engine.dialect.name != "sqlite":
        return False
    with database.reading() as connection:
        return connection.exec_driver_sql("SELECT count(*) FROM sqlite_master").scalar() == 0

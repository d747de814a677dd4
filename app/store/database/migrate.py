"""Migrate the database, forward only: by `db upgrade`, and SQLite whenever it is opened."""

from __future__ import annotations

from functools import cache

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection

from app.errors import UnavailableError
from app.files import packaged
from app.store.database.engine import Database


def upgrade(database: Database) -> str:
    """Migrate a database to the newest version, if it is older, and return that version.

    Raises
    ------
    ValueError
        If a newer program has migrated it.
    """
    version = version_of(database)
    if version != newest_version():
        if unknown := _why_unknown(version):
            raise ValueError(unknown)
        with database.writing() as connection:
            upgrade_within(connection, newest_version())
    return newest_version()


def upgrade_within(connection: Connection, version: str) -> None:
    """Migrate a database to a version, within an open transaction."""
    config = _config()
    config.attributes["connection"] = connection
    command.upgrade(config, version)


def revisions() -> list[str]:
    """Return all versions, the newest first."""
    return [script.revision for script in ScriptDirectory.from_config(_config()).walk_revisions()]


def version_of(database: Database) -> str | None:
    """Return the version a database is at; None when it is empty."""
    with database.reading() as connection:
        return MigrationContext.configure(connection).get_current_revision()


def why_not_ready(database: Database) -> str | None:
    """Say why the database cannot be used; None if it can."""
    try:
        version = version_of(database)
    except UnavailableError:
        return "The database does not answer."
    if version == newest_version():
        return None
    state = "has no tables yet" if version is None else f"is at version {version}, expected {newest_version()}"
    return _why_unknown(version) or f"The database {state}; run `reconstudy db upgrade`."


def _why_unknown(version: str | None) -> str | None:
    """Say why this program cannot migrate a database of a version; None if it can."""
    if version is None or version in revisions():
        return None
    return (
        f"The database is at version {version}, which this program does not know, expected {newest_version()}; "
        "install the version of reconstudy that upgraded it, or a newer one."
    )


@cache
def newest_version() -> str:
    """Return the newest version; its files are read once, as every probe of the server's health asks for it."""
    head = ScriptDirectory.from_config(_config()).get_current_head()
    assert head is not None, "there is at least one migration"
    return head


def _config() -> Config:
    """Make the settings of Alembic; alembic.ini is for its own command line, which only developers use."""
    config = Config()
    config.set_main_option("script_location", str(packaged("migrations")).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config

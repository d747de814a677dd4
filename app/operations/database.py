"""Open the database that the settings name."""

from __future__ import annotations

from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.migrate import upgrade, why_not_ready


def open_store(settings: Settings) -> Database:
    """Open the database; the embedded one is upgraded to the newest version first.

    Raises
    ------
    ValueError
        If another database is not at the newest version.
    """
    database = open_database(settings.url)
    if settings.is_embedded:
        upgrade(database)
    elif reason := why_not_ready(database):
        database.dispose()
        raise ValueError(reason)
    return database

"""Open the database that the settings name."""

from __future__ import annotations

from app.settings import Settings
from app.store.database.engine import Database, Transaction, open_database
from app.store.database.migrate import upgrade, why_not_ready
from app.store.studies.studies import Study, study_by_slug


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


def study_named(connection: Transaction, slug: str) -> Study:
    """Return a study by its short name, as a command gives it.

    Raises
    ------
    ValueError
        If there is none.
    """
    study = study_by_slug(connection, slug)
    if study is None:
        raise ValueError(f"there is no study {slug!r}; `reconstudy study list` shows all")
    return study

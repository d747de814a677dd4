"""Tell which films could not be shown by what they show."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection

from app.store.studies.film_failures import alarm_of, failure_records, ids_with_failures
from app.store.studies.studies import all_studies
from app.store.trials.designs import OF_PRACTICE, film_names


def failing_films(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return every film that could not be shown, with what it shows, the latest first."""
    names = film_names(connection, study_id)
    return [
        {**row, "film": names.get(row["media"], OF_PRACTICE), "why": row["reason"], "noted_at": row["settled_at"]}
        for row in failure_records(connection, study_id)
    ]


def failing_films_of_all(connection: Connection) -> list[tuple[tuple[str, str, str], int]]:
    """Return for how many people a film fails and nobody has taken note of it, by study, film and browser."""
    counts: list[tuple[tuple[str, str, str], int]] = []
    if not (ids := ids_with_failures(connection)):
        return counts
    for each in all_studies(connection):
        if each.id in ids and (alarm := alarm_of(connection, each.id)):
            names = film_names(connection, each.id)
            for film in alarm.films:
                name = names.get(film["media"], OF_PRACTICE)
                counts += [((each.slug, name, browser), n) for browser, n in film["browsers"]]
    return counts

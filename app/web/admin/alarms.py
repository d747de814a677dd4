"""Tell on every page of a study which films failed, for how many people, on which browsers."""

from __future__ import annotations

from typing import Any

from app.store.database.engine import Database
from app.store.studies.film_failures import alarm_of
from app.store.studies.studies import Study
from app.store.trials.designs import film_names

MOST_FILMS = 5  # of an alarm; the table of failures has all
OF_PRACTICE = "a film of the practice"


def alarm_in(database: Database, study: Study) -> dict[str, Any] | None:
    """Return what a study's pages say of failures that nobody has taken note of; None: there are none."""
    with database.reading() as connection:
        alarm = alarm_of(connection, study.id)
        names = film_names(connection, study.id) if alarm else {}
    if alarm is None:
        return None
    films = [{**film, "name": names.get(film["media"], OF_PRACTICE)} for film in alarm.films]
    return {
        "films": films[:MOST_FILMS],
        "n_more": len(films[MOST_FILMS:]),
        "n_people": alarm.n_people,
        "last_at": alarm.last_at,
    }

"""Keep which films participants' browsers could not show, pause a study where they are many, and say what is new.

Failures are an alarm until an experimenter takes note of them or opens the study anew.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, func, insert, select, update

from app.store.database.tables import (
    assignment,
    film_failure,
    pair,
    participant,
    practice_pair,
    session,
    trial,
    vote,
)
from app.store.participants.exclusions import sessions_in, takes_part_in
from app.store.studies import studies
from app.store.studies.audit import Entry, record
from app.study.options.options import parse_options
from app.study.stages import PRACTICE as PRACTICE_STAGE

RULE = "rule: films that fail"  # who has paused a study, in the audit log
PRACTICE = "practice-"  # begins the names of trials to practise with
MOST_TRIES = 2  # of a film in a session: then trying again leads in a circle


@dataclass(frozen=True)
class Failure:
    """A film that could not be shown to somebody.

    Parameters
    ----------
    trial : as the participant's page calls it
    reason : what the browser says
    browser : its name and system
    """

    trial: str
    reason: str
    browser: str


@dataclass(frozen=True)
class Alarm:
    """What has failed since an experimenter last took note: by film, and for how many people."""

    films: tuple[Mapping[str, Any], ...]
    n_people: int
    last_at: datetime


def note_failure(connection: Connection, study_id: int, session_id: int, failure: Failure, now: datetime) -> bool:
    """Keep that a film failed; return whether the study pauses now, as it failed for so many people.

    A trial that the session does not have is left aside.

    Parameters
    ----------
    connection : of a writing transaction
    """
    media = _media(connection, study_id, session_id, failure.trial)
    if media is None:
        return False
    values = {"trial": failure.trial, "reason": failure.reason, "browser": failure.browser}
    connection.execute(insert(film_failure).values(session_id=session_id, media=media, happened_at=now, **values))
    return _pause_by_rule(connection, study_id, now)


def is_stuck(connection: Connection, session_id: int) -> bool:
    """Whether a session cannot go on: its last film failed as often as it may be tried, and no answer came since."""
    rows = connection.execute(
        select(film_failure.c.trial, func.count().label("n"))
        .where(film_failure.c.session_id == session_id, film_failure.c.settled_at.is_(None))
        .group_by(film_failure.c.trial)
        .order_by(func.max(film_failure.c.id).desc())
        .limit(1)
    ).all()
    return bool(rows) and rows[0].n >= MOST_TRIES and _is_ahead(connection, session_id, rows[0].trial)


def alarm_of(connection: Connection, study_id: int) -> Alarm | None:
    """Return what has failed and nobody has taken note of; None: nothing."""
    rows = connection.execute(
        select(film_failure).where(_new_in(study_id)).order_by(film_failure.c.id)  # the latest says why
    ).all()
    if not rows:
        return None
    by_film: dict[str, list[Row[Any]]] = {}
    for row in rows:
        by_film.setdefault(row.media, []).append(row)
    most_first = sorted(map(_film, by_film.values()), key=lambda film: (-film["n_people"], film["media"]))
    return Alarm(tuple(most_first), len({row.session_id for row in rows}), rows[-1].happened_at)


def ids_with_failures(connection: Connection) -> set[int]:
    """Return the ids of the studies, previews included, with failures that nobody has taken note of."""
    joined = film_failure.join(session).join(participant)
    ids = select(participant.c.study_id).select_from(joined).where(film_failure.c.settled_at.is_(None))
    return set(connection.scalars(ids.distinct()))


def in_words(reason: str) -> str:
    """Return why a film was not shown without what a browser adds for its own developers, after a colon."""
    return reason.partition(": ")[0]


def failures_by_person(connection: Connection, study_id: int) -> dict[str, int]:
    """Return how many films failed for each participant, by label."""
    rows = connection.execute(
        select(participant.c.label, func.count().label("n_failed"))
        .select_from(film_failure.join(session).join(participant))
        .where(takes_part_in(study_id))
        .group_by(participant.c.label)
    )
    return {row.label: row.n_failed for row in rows}


def failure_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return every failure with its participant, the latest first."""
    rows = connection.execute(
        select(
            participant.c.label.label("participant"),
            film_failure.c.media,
            film_failure.c.trial,
            film_failure.c.reason,
            film_failure.c.browser,
            film_failure.c.happened_at,
            film_failure.c.settled_at,
        )
        .select_from(film_failure.join(session).join(participant))
        .where(takes_part_in(study_id))
        .order_by(film_failure.c.id.desc())
    )
    return [dict(row._mapping) for row in rows]


def settle_failures(connection: Connection, study_id: int, now: datetime) -> int:
    """Take note of all failures of a study, which then are no alarm; return how many were new."""
    sessions = select(session.c.id).select_from(session.join(participant)).where(participant.c.study_id == study_id)
    settled = connection.execute(
        update(film_failure)
        .where(film_failure.c.session_id.in_(sessions), film_failure.c.settled_at.is_(None))
        .values(settled_at=now)
    )
    return settled.rowcount


def _film(failures: Sequence[Row[Any]]) -> dict[str, Any]:
    """Summarise the failures of one film: for how many people, on which browsers, and why the last time."""
    last = failures[-1]
    by_browser = Counter(browser for _, browser in {(row.session_id, row.browser) for row in failures})
    return {
        "media": last.media,
        "n_people": len({row.session_id for row in failures}),
        "browsers": by_browser.most_common(),
        "last_at": last.happened_at,
        "reason": in_words(last.reason),
    }


def _is_ahead(connection: Connection, session_id: int, name: str) -> bool:
    """Whether a session has still to take a trial."""
    if name.startswith(PRACTICE):
        stage = connection.scalar(select(session.c.stage).where(session.c.id == session_id))
        return stage == PRACTICE_STAGE
    voted = select(vote.c.id).select_from(vote.join(trial, vote.c.trial_id == trial.c.id))
    return connection.scalar(voted.where(vote.c.session_id == session_id, trial.c.public_id == name)) is None


def _new_in(study_id: int) -> ColumnElement[bool]:
    """SQL condition: the failure is new, and that of a participant of the study."""
    return film_failure.c.settled_at.is_(None) & film_failure.c.session_id.in_(sessions_in(study_id))


def _n_people(connection: Connection, study_id: int) -> int:
    query = select(func.count(film_failure.c.session_id.distinct())).where(_new_in(study_id))
    return connection.scalar(query) or 0


def _pause_by_rule(connection: Connection, study_id: int, now: datetime) -> bool:
    study_now = studies.lock_study(connection, study_id)
    most = parse_options(study_now.options).pause_on_failures
    n_people = _n_people(connection, study_id)
    if study_now.standing != "open" or not most or n_people < most:
        return False
    studies.set_standing(connection, study_id, "paused", now)
    record(connection, RULE, Entry("study paused", study_id, study_now.slug, {"people": n_people}), now)
    return True


def _media(connection: Connection, study_id: int, session_id: int, name: str) -> str | None:
    """Return the film of a trial of a session, or of its practice; None: it has no such trial."""
    if name.startswith(PRACTICE):
        number = name.removeprefix(PRACTICE)
        if not number.isdecimal():
            return None
        return connection.scalar(
            select(practice_pair.c.media).where(
                practice_pair.c.study_id == study_id, practice_pair.c.position == int(number) - 1
            )
        )
    return connection.scalar(
        select(pair.c.media)
        .select_from(trial.join(assignment).join(pair))
        .where(trial.c.session_id == session_id, trial.c.public_id == name)
    )

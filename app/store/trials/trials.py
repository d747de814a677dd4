"""Serve the next trial, and repeat interrupted ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, and_, exists, insert, select, update

from app.errors import ConflictError, NotFoundError
from app.store.database.engine import Database
from app.store.database.keys import new_opaque_id
from app.store.database.tables import assignment, pair, trial, vote
from app.store.participants.participants import lock_unless_withdrawn
from app.store.trials.designs import PairFilm, pair_film
from app.study.trial.trial import LEFT_THE_PAGE

MOST_ATTEMPTS = 2  # an interrupted trial is repeated once
MOST_LOOKS = 100  # a trial whose page is left comes again each time


@dataclass(frozen=True, kw_only=True)
class NextTrial(PairFilm):
    """A trial as its participant may know it; `position` counts from 0, `attempt` from 1."""

    id: int
    public_id: str
    position: int
    attempt: int
    a_half: str
    first_shown: str
    served_at: datetime | None


def is_voted_on() -> ColumnElement[bool]:
    """SQL condition: the trial has a vote."""
    return and_(vote.c.session_id == trial.c.session_id, vote.c.trial_id == trial.c.id)


def next_trials(connection: Connection, session_id: int, limit: int = 2) -> list[NextTrial]:
    """Return the first trials of a session without a vote: the one to show, and the one to fetch meanwhile.

    A trial that was interrupted comes again after all others.
    """
    rows = connection.execute(
        select(
            trial.c.id,
            trial.c.public_id,
            assignment.c.position,
            trial.c.attempt,
            assignment.c.a_half,
            assignment.c.first_shown,
            trial.c.served_at,
            *pair_film(pair),
        )
        .select_from(trial.join(assignment).join(pair))
        .where(
            trial.c.session_id == session_id,
            trial.c.voided_at.is_(None),
            ~exists().where(is_voted_on()),
        )
        .order_by(trial.c.attempt, assignment.c.position)
        .limit(limit)
    )
    return [NextTrial(**row._mapping) for row in rows]


def mark_served(database: Database, trial_ids: Sequence[int], now: datetime) -> None:
    """Store when trials were first given out."""
    with database.writing() as connection:
        connection.execute(
            update(trial).where(trial.c.id.in_(trial_ids), trial.c.served_at.is_(None)).values(served_at=now)
        )


def void_trial(
    database: Database, session_id: int, trial_id: str, reason: str, viewing: Mapping[str, Any], now: datetime
) -> bool:
    """Void an interrupted attempt and plan the trial again at the end; returns whether it was not void yet.

    Raises
    ------
    NotFoundError
        If the session has no such trial.
    ConflictError
        If it has a vote, has not been given out, or is itself a repetition whose page was not left.
    GoneError
        If the participant has withdrawn.
    """
    with database.writing() as connection:
        lock_unless_withdrawn(connection, session_id)
        row = connection.execute(
            select(trial, exists().where(is_voted_on()).label("has_vote")).where(
                trial.c.session_id == session_id, trial.c.public_id == trial_id
            )
        ).one_or_none()
        if row is None:
            raise NotFoundError("This session has no such trial.")
        if row.voided_at is not None:
            return False
        _check_voidable(row, reason)
        changes = {"voided_at": now, "void_reason": reason, "void_viewing": dict(viewing)}
        connection.execute(update(trial).where(trial.c.id == row.id).values(**changes))
        again = {"session_id": session_id, "assignment_id": row.assignment_id, "attempt": row.attempt + 1}
        connection.execute(insert(trial).values(public_id=new_opaque_id(), **again))
    return True


def _check_voidable(row: Row[Any], reason: str) -> None:
    if row.has_vote:
        raise ConflictError("This trial has a vote already.")
    if row.served_at is None:
        raise ConflictError("This trial has not been given out yet.")
    if row.attempt >= (MOST_LOOKS if reason == LEFT_THE_PAGE else MOST_ATTEMPTS):
        raise ConflictError("This trial was repeated already.")

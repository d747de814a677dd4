"""Participants at their trials, and what they vote."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any
from uuid import uuid4

from sqlalchemy import event, func, select

from app.errors import StudyError
from app.store.database.engine import Database
from app.store.database.tables import vote
from app.store.participants.invitations import Invitation
from app.store.trials.sessions import Session, complete_stage, session_by_token
from app.store.trials.trials import NextTrial, mark_served, next_trials
from app.store.trials.vote_records import KeptVote, Vote, keep_votes
from tests.seeded_studies import NOW, begin_session


@dataclass(frozen=True)
class Participant:
    """Who has read the introduction."""

    token: str
    session: Session

    @property
    def id(self) -> int:
        return self.session.id


def let_in(database: Database, invitation: Invitation) -> Participant:
    token = begin_session(database, invitation, NOW)
    with database.reading() as connection:
        session = session_by_token(connection, token)
    assert session is not None
    complete_stage(database, session, "introduction", {}, NOW)
    return Participant(token, session)


def serve_next(database: Database, participant: Participant) -> NextTrial:
    return serve_trials(database, participant, 1)[0]


def serve_trials(database: Database, participant: Participant, n_trials: int) -> list[NextTrial]:
    with database.reading() as connection:
        trials = next_trials(connection, participant.id, n_trials)
    mark_served(database, [trial.id for trial in trials], NOW)
    return trials


def vote_on(trial: NextTrial, token: str = "", **changes: Any) -> Vote:
    viewing = {"first_shown": trial.first_shown, "shown_ms": 1000.0, "response_ms": 12.5, "switches": []}
    return replace(Vote(token, trial.public_id, str(uuid4()), "a", viewing, NOW), **changes)


def n_votes(database: Database) -> int:
    with database.reading() as connection:
        return connection.scalar(select(func.count()).select_from(vote)) or 0


def rows_read(database: Database) -> list[tuple[Any, ...]]:
    """Grows by every row that SQLite's driver gives from now on."""
    read: list[tuple[Any, ...]] = []

    def noted(_cursor: sqlite3.Cursor, row: tuple[Any, ...]) -> tuple[Any, ...]:
        read.append(row)
        return row

    @event.listens_for(database.engine, "checkout")
    def note(connection: sqlite3.Connection, *_: Any) -> None:
        connection.row_factory = noted

    return read


def keep_vote(database: Database, participant: Participant, trial_id: str, sent: Vote, now: datetime) -> KeptVote:
    """Keep one vote as if a participant had sent it for a trial, or raise why it is not kept."""
    (outcome,) = keep_votes(database, [replace(sent, token=participant.token, trial=trial_id, received_at=now)])
    if isinstance(outcome, StudyError):
        raise outcome
    return outcome

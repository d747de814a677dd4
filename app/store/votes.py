"""Votes: inserted once, never updated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, exists, select

from app.errors import ConflictError, GoneError, InvalidError, NotFoundError
from app.store.engine import Database, insert_or_ignore
from app.store.sessions import Session, end_trials
from app.store.tables import assignment, session, trial, vote
from app.store.trials import trial_records
from app.study.trial import Label
from app.study.votes import InvalidVoteError, Vote, check_vote, is_same


@dataclass(frozen=True)
class KeptVote:
    """A vote as it is on disk; `is_new` unless it had been sent before."""

    vote: Vote
    number: int
    received_at: datetime
    is_new: bool


def keep_vote(database: Database, of: Session, trial_id: str, sent: Vote, now: datetime) -> KeptVote:
    """Keep a vote; when this returns it is on disk. The last one ends the trials.

    Raises
    ------
    NotFoundError
        If the session has no such trial.
    ConflictError
        If the trial has another vote, the vote's id belongs to another, or the trial has not been given out.
    InvalidError
        If the vote contradicts itself or the trial.
    GoneError
        If the participant has withdrawn and the vote was not kept before.
    """
    with database.writing() as connection:
        target = _target(connection, of.id, trial_id)
        if target.withdrawn_at is not None:
            return _kept_before_withdrawal(connection, target, sent)
        _check(sent, target)
        values = {
            "client_id": sent.client_id,
            "session_id": of.id,
            "trial_id": target.id,
            "choice": sent.choice,
            "first_shown": sent.viewing["first_shown"],
            "n_switches": len(sent.switches),
            "shown_ms": sent.viewing["shown_ms"],
            "response_ms": sent.viewing["response_ms"],
            "viewing": dict(sent.viewing),
            "received_at": now,
        }
        if not insert_or_ignore(connection, vote, values):
            return _sent_before(connection, target, sent)
        if not _has_trials_left(connection, of.id):
            end_trials(connection, of, now)
    return KeptVote(sent, target.position + 1, now, is_new=True)


def vote_records(connection: Connection, study_id: int) -> Iterator[dict[str, Any]]:
    """The votes table of a study, as DESIGN's votes file."""
    for record in trial_records(connection, study_id):
        if record["choice"] is not None:
            yield {
                "participant": record["participant"],
                "dataset": record["dataset"],
                "item_a": record["item_a"],
                "item_b": record["item_b"],
                "choice": record["choice"],
                "first_shown": record["first_shown"],
                "trial": record["trial"],
                "response_ms": record["response_ms"],
                "practice": False,
                "excluded": record["withdrawn"],
                "reason": "withdrawn" if record["withdrawn"] else "",
            }


@dataclass(frozen=True)
class _Target:
    id: int
    served_at: datetime | None
    voided_at: datetime | None
    withdrawn_at: datetime | None
    position: int
    first_shown: Label


def _target(connection: Connection, session_id: int, trial_id: str) -> _Target:
    row = connection.execute(
        select(
            trial.c.id,
            trial.c.served_at,
            trial.c.voided_at,
            session.c.withdrawn_at,
            assignment.c.position,
            assignment.c.first_shown,
        )
        .select_from(trial.join(assignment).join(session, trial.c.session_id == session.c.id))
        .where(trial.c.session_id == session_id, trial.c.public_id == trial_id)
    ).one_or_none()
    if row is None:
        raise NotFoundError("This session has no such trial.")
    return _Target(**row._mapping)


def _check(sent: Vote, target: _Target) -> None:
    if target.served_at is None:
        raise ConflictError("This trial has not been given out yet.")
    if target.voided_at is not None:
        raise ConflictError("This trial was interrupted; it comes again at the end.")
    try:
        check_vote(sent, target.first_shown)
    except InvalidVoteError as error:
        raise InvalidError(f"The viewing record is not right: {error}.") from error


def _kept_before_withdrawal(connection: Connection, target: _Target, sent: Vote) -> KeptVote:
    """A vote that was kept before its participant withdrew may be sent again; another one is not taken."""
    if connection.scalar(select(exists().where(vote.c.trial_id == target.id))):
        return _sent_before(connection, target, sent)
    raise GoneError("You have withdrawn from the study, so this answer was not kept.")


def _sent_before(connection: Connection, target: _Target, sent: Vote) -> KeptVote:
    """The vote that stood in the way, if it is this one."""
    row = connection.execute(select(vote).where(vote.c.trial_id == target.id)).one_or_none()
    if row is None:
        raise ConflictError("This vote's id belongs to another vote.")
    kept = Vote(row.client_id, row.choice, row.viewing)
    if not is_same(sent, kept):
        raise ConflictError("This trial has a vote already, and it is another one.")
    return KeptVote(kept, target.position + 1, row.received_at, is_new=False)


def _has_trials_left(connection: Connection, session_id: int) -> bool:
    open_trials = exists().where(
        trial.c.session_id == session_id,
        trial.c.voided_at.is_(None),
        ~exists().where(vote.c.trial_id == trial.c.id),
    )
    return bool(connection.scalar(select(open_trials)))

"""Votes: inserted once, never updated."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import Connection, Insert, exists, func, select
from sqlalchemy.dialects import postgresql, sqlite

from app.errors import ConflictError, GoneError, InvalidError, NoSessionError, NotFoundError, StudyError
from app.store.engine import Database, insert_or_ignore
from app.store.keys import digest
from app.store.prepared import Prepared, among
from app.store.sessions import end_trials, session_by_token
from app.store.tables import assignment, participant, session, study, trial, vote
from app.store.trials import is_voted_on, trial_records
from app.study.trial import Label
from app.study.valid_vote import InvalidVoteError, Vote, check_vote, check_vote_on_trial, is_same


@dataclass(frozen=True)
class KeptVote:
    """A vote as it is on disk; `is_new` unless it had been sent before."""

    vote: Vote
    number: int
    received_at: datetime
    is_new: bool


@dataclass
class Ballot:
    """A vote as it arrives: with whose token, for which trial, when, and for which session where its sender says so.

    What can be told without the database is told when it is made, and not in the transaction that all wait for.

    Raises
    ------
    InvalidError
        If the vote contradicts itself.
    """

    token: str
    trial: str
    sent: Vote
    received_at: datetime
    session: str | None = None

    def __post_init__(self) -> None:
        self.token_hash = digest(self.token)
        try:
            check_vote(self.sent)
        except InvalidVoteError as error:
            raise _invalid(error) from error


_OPEN_TRIAL = select(trial.c.id).where(
    trial.c.session_id == session.c.id,
    trial.c.voided_at.is_(None),
    ~exists().where(is_voted_on()),
)
# The last first: votes begin at the other end, so that one is found at once.
_LAST_OPEN_TRIAL = _OPEN_TRIAL.order_by(trial.c.assignment_id.desc()).limit(1)


class _Statements(NamedTuple):
    """What keeping votes takes, in the words of one database."""

    targets: Prepared
    insert: Prepared
    ended: Prepared


@cache
def _statements(dialect_name: str) -> _Statements:
    # Trials by their public ids, locked with their sessions in one order: no two writers wait for each other.
    targets = (
        select(
            trial.c.public_id,
            trial.c.id,
            trial.c.session_id,
            session.c.public_id.label("session"),
            session.c.token_hash,
            trial.c.served_at.is_not(None),
            trial.c.voided_at.is_not(None),
            session.c.withdrawn_at.is_not(None),
            assignment.c.position,
            assignment.c.first_shown,
            func.coalesce(study.c.options["reference"].as_string(), "") != "",
        )
        .select_from(
            trial.join(assignment).join(session, trial.c.session_id == session.c.id).join(participant).join(study)
        )
        .where(among(trial.c.public_id, "trials", dialect_name))
        .order_by(session.c.id, trial.c.id)
        .with_for_update(of=[session, trial], key_share=True)
    )
    insert: Insert = (
        postgresql.insert(vote).on_conflict_do_nothing()
        if dialect_name == "postgresql"
        else sqlite.insert(vote).on_conflict_do_nothing()
    )
    ended = select(session.c.id).where(
        among(session.c.id, "sessions", dialect_name), _LAST_OPEN_TRIAL.scalar_subquery().is_(None)
    )
    columns = [column.name for column in vote.columns if not column.primary_key]
    return _Statements(
        Prepared(targets, dialect_name),
        Prepared(insert.inline(), dialect_name, columns),
        Prepared(ended, dialect_name),
    )


def keep_votes(database: Database, ballots: Sequence[Ballot]) -> list[KeptVote | StudyError]:
    """Keep votes in one transaction; when this returns they are on disk. The last one of a session ends its trials.

    Returns
    -------
    For each ballot in its order the vote that is kept, or why it is not, which harms no other:
    NoSessionError if its token opens no session, or another one than it is for; NotFoundError if the session has no
    such trial; ConflictError if the trial has another vote, the vote's id belongs to another, or the trial is not open;
    InvalidError if the vote contradicts the trial; GoneError if the participant has withdrawn and the vote was not kept
    before.

    Raises
    ------
    UnavailableError
        If the database does not take them now. Any other error: a row that no database takes; none is kept.
    """
    try:
        return _keep(database, ballots, _insert_all)
    except _NotAllError:  # from the beginning: which of them are new is told only by the slower way
        return _keep(database, ballots, _insert_or_ignore)


_InsertVotes = Callable[[Connection, Sequence[Mapping[str, Any]]], Collection[str]]


def _keep(database: Database, ballots: Sequence[Ballot], insert: _InsertVotes) -> list[KeptVote | StudyError]:
    with database.writing() as connection:
        targets = _targets(connection, ballots)
        checked = [_checked(connection, ballot, targets.get(ballot.trial)) for ballot in ballots]
        accepted = [
            (ballot, target)
            for ballot, target in zip(ballots, checked, strict=True)
            if isinstance(target, _Target) and not target.has_withdrawn
        ]
        firsts = _firsts(accepted)
        ids = insert(connection, [_row(*first) for first in firsts.values()])
        inserted = {client_id: firsts[client_id][0] for client_id in ids}
        _end_sessions(connection, [(ballot, target) for ballot, target in accepted if _is_in(ballot, inserted)])
        return [
            target if isinstance(target, StudyError) else _outcome(connection, ballot, target, inserted)
            for ballot, target in zip(ballots, checked, strict=True)
        ]


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
                "excluded": record["withdrawn"] or record["exclusion"] is not None,
                "reason": "withdrawn" if record["withdrawn"] else record["exclusion"] or "",
                "role": record["role"],
                "technique": record["technique"],
                "frame_locked": record["frame_locked"],
            }


class _Target(NamedTuple):
    """The trial that a ballot is for, with what decides about it."""

    id: int
    session_id: int
    session: str
    token_hash: str
    is_served: bool
    is_voided: bool
    has_withdrawn: bool
    position: int
    first_shown: Label
    has_reference: bool


def _targets(connection: Connection, ballots: Sequence[Ballot]) -> dict[str, _Target]:
    rows = _statements(connection.dialect.name).targets.rows(connection, trials=[ballot.trial for ballot in ballots])
    return {public_id: _Target(*rest) for public_id, *rest in rows}


def _checked(connection: Connection, ballot: Ballot, target: _Target | None) -> _Target | StudyError:
    if target is None or target.token_hash != ballot.token_hash:
        holder = session_by_token(connection, ballot.token)
        if holder is None or ballot.session not in (None, holder.public_id):
            return NoSessionError()
        return NotFoundError("This session has no such trial.")
    if ballot.session not in (None, target.session):
        return NoSessionError()
    if target.has_withdrawn:
        return target
    if not target.is_served:
        return ConflictError("This trial has not been given out yet.")
    if target.is_voided:
        return ConflictError("This trial was interrupted; it comes again at the end.")
    try:
        check_vote_on_trial(ballot.sent, target.first_shown, has_reference=bool(target.has_reference))
    except InvalidVoteError as error:
        return _invalid(error)
    return target


def _invalid(error: InvalidVoteError) -> InvalidError:
    return InvalidError(f"The viewing record is not right: {error}.")


def _firsts(accepted: Sequence[tuple[Ballot, _Target]]) -> dict[str, tuple[Ballot, _Target]]:
    """The first vote of every trial and id, by id."""
    first_of_trial: dict[int, tuple[Ballot, _Target]] = {}
    for ballot, target in accepted:
        first_of_trial.setdefault(target.id, (ballot, target))
    firsts: dict[str, tuple[Ballot, _Target]] = {}
    for ballot, target in first_of_trial.values():
        firsts.setdefault(ballot.sent.client_id, (ballot, target))
    return firsts


class _NotAllError(Exception):
    """Some votes were there already; a number of rows does not say which."""


def _insert_all(connection: Connection, rows: Sequence[Mapping[str, Any]]) -> Collection[str]:
    """Insert votes of which none is there yet; their ids."""
    if rows and _statements(connection.dialect.name).insert.insert(connection, rows) != len(rows):
        raise _NotAllError
    return [row["client_id"] for row in rows]


def _insert_or_ignore(connection: Connection, rows: Sequence[Mapping[str, Any]]) -> Collection[str]:
    """Insert votes whose trials and ids have none yet; the ids of those that were inserted."""
    return insert_or_ignore(connection, vote, rows, vote.c.client_id)


def _row(ballot: Ballot, target: _Target) -> dict[str, Any]:
    sent = ballot.sent
    return {
        "client_id": sent.client_id,
        "session_id": target.session_id,
        "trial_id": target.id,
        "choice": sent.choice,
        "first_shown": sent.viewing["first_shown"],
        "n_switches": len(sent.switches),
        "shown_ms": sent.viewing["shown_ms"],
        "response_ms": sent.viewing["response_ms"],
        "viewing": dict(sent.viewing),
        "received_at": ballot.received_at,
    }


def _is_in(ballot: Ballot, inserted: Mapping[str, Ballot]) -> bool:
    return inserted.get(ballot.sent.client_id) is ballot


def _outcome(
    connection: Connection, ballot: Ballot, target: _Target, inserted: Mapping[str, Ballot]
) -> KeptVote | StudyError:
    if _is_in(ballot, inserted):
        return KeptVote(ballot.sent, target.position + 1, ballot.received_at, is_new=True)
    return _sent_before(connection, ballot.sent, target)


def _sent_before(connection: Connection, sent: Vote, target: _Target) -> KeptVote | StudyError:
    """The vote that stood in the way, if it is this one."""
    row = connection.execute(
        select(vote).where(vote.c.session_id == target.session_id, vote.c.trial_id == target.id)
    ).one_or_none()
    if row is None and target.has_withdrawn:
        return GoneError("You have withdrawn from the study, so this answer was not kept.")
    if row is None:
        return ConflictError("This vote's id belongs to another vote.")
    kept = Vote(row.client_id, row.choice, row.viewing)
    if not is_same(sent, kept):
        return ConflictError("This trial has a vote already, and it is another one.")
    return KeptVote(kept, target.position + 1, row.received_at, is_new=False)


def _end_sessions(connection: Connection, inserted: Sequence[tuple[Ballot, _Target]]) -> None:
    """Let the sessions go on of which no trial is left."""
    last_at = {target.session_id: ballot.received_at for ballot, target in inserted}
    if not last_at:
        return
    ended = _statements(connection.dialect.name).ended.rows(connection, sessions=list(last_at))
    for (session_id,) in ended:
        end_trials(connection, session_id, last_at[session_id])

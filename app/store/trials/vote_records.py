"""Insert votes, each once and never updated, and read them as rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Row, bindparam, exists, select

from app.errors import ConflictError, GoneError, InvalidError, NoSessionError, NotFoundError, StudyError
from app.store.database.engine import Database, insert_or_ignore
from app.store.database.keys import digest
from app.store.database.tables import assignment, pair, participant, session, study, trial, vote
from app.store.trials.sessions import end_trials, session_by_token
from app.store.trials.trial_records import trial_records
from app.store.trials.trials import is_voted_on
from app.study.protocols import PC, SHOWN_ALONE, WITH_REFERENCE, grades_of, stored_scale
from app.study.trial.smoothness import smoothness
from app.study.trial.valid_vote import (
    Choice,
    InvalidVoteError,
    check_viewing,
    choice_of,
    has_seen_both,
    press_to_picture_ms,
)

OF_TRIAL = (  # columns of a table of votes that a table of trials has, too
    *("participant", "dataset", "item_a", "item_b", "choice", "first_shown", "trial", "response_ms", "role"),
    *("technique", "frame_locked", "both_seen", "looks_before", "press_to_picture_ms", "protocol", "rating"),
    *("reference", "lighter_film", "longest_gap_ms", "frame_share", "mismatch_share", "shown_smoothly"),
)


@dataclass(frozen=True)
class Vote:
    """A participant's choice in one trial and how it was come to, as it arrives.

    Parameters
    ----------
    token : of the session that it says it comes from
    trial : public id
    client_id : made by the browser before it sends, so that sending twice is harmless
    choice : the better one, or none; None: it is a rating
    rating : on the study's scale; None: it is a choice
    viewing : as app/study/trial/valid_vote.py describes it
    session : public id of the session that it is meant for, where its sender says so
    """

    token: str
    trial: str
    client_id: str
    choice: Choice | None
    viewing: Mapping[str, Any]
    received_at: datetime
    session: str | None = None
    rating: int | None = None


@dataclass(frozen=True)
class KeptVote:
    """A vote that is on disk; `number` is its trial's place in the order, `is_new` unless it had been sent before."""

    number: int
    received_at: datetime
    is_new: bool


# Locked with their sessions in one order: no two writers wait for each other.
_TRIALS = (
    select(
        trial.c.public_id,
        trial.c.id,
        trial.c.session_id,
        trial.c.served_at,
        trial.c.voided_at,
        session.c.public_id.label("session"),
        session.c.token_hash,
        session.c.withdrawn_at,
        assignment.c.position,
        assignment.c.first_shown,
        pair.c.fps,
        *(study.c.options[name].as_string().label(name) for name in ("reference", "protocol", "scale")),
    )
    .select_from(
        trial.join(assignment)
        .join(pair)
        .join(session, trial.c.session_id == session.c.id)
        .join(participant)
        .join(study, participant.c.study_id == study.c.id)
    )
    .where(trial.c.public_id.in_(bindparam("trials", expanding=True)))
    .order_by(session.c.id, trial.c.id)
    .with_for_update(of=[session, trial], key_share=True)
)
_OPEN_TRIAL = (
    select(trial.c.id)
    .where(trial.c.session_id == session.c.id, trial.c.voided_at.is_(None), ~exists().where(is_voted_on()))
    .order_by(trial.c.assignment_id.desc())  # votes begin at the other end, so that the first look finds one
    .limit(1)
)
_ENDED = select(session.c.id).where(
    session.c.id.in_(bindparam("sessions", expanding=True)), _OPEN_TRIAL.scalar_subquery().is_(None)
)


def keep_votes(database: Database, votes: Sequence[Vote]) -> list[KeptVote | StudyError]:
    """Keep votes in one transaction; when this returns they are on disk. The last one of a session ends its trials.

    Returns
    -------
    For each vote in its order that it is kept, or why it is not, which harms no other:
    NoSessionError if its token opens no session, or another one than it is for; NotFoundError if the session has no
    such trial; ConflictError if the trial has another vote, the vote's id belongs to another, or the trial is not open;
    InvalidError if the vote contradicts itself or the trial; GoneError if the participant has withdrawn and the vote
    was not kept before.

    Raises
    ------
    UnavailableError
        If the database does not take them now. Any other error: a row that no database takes; none is kept.
    """
    with database.writing() as connection:
        ids = [sent.trial for sent in votes]
        trials: dict[str, Any] = {row.public_id: row for row in connection.execute(_TRIALS, {"trials": ids})}
        refusals = [_refusal(connection, sent, trials.get(sent.trial)) for sent in votes]
        firsts: dict[str, Vote] = {}  # by trial
        for sent, refusal in zip(votes, refusals, strict=True):
            if refusal is None and trials[sent.trial].withdrawn_at is None:
                firsts.setdefault(sent.trial, sent)
        rows = [_row(sent, trials[sent.trial]) for sent in firsts.values()]
        inserted = set(insert_or_ignore(connection, vote, rows, vote.c.trial_id))
        new = {name: sent for name, sent in firsts.items() if trials[name].id in inserted}
        _end_sessions(connection, {trials[name].session_id: sent.received_at for name, sent in new.items()})
        return [
            refusal or _outcome(connection, sent, trials[sent.trial], is_new=new.get(sent.trial) is sent)
            for sent, refusal in zip(votes, refusals, strict=True)
        ]


def _refusal(connection: Connection, sent: Vote, row: Row[Any] | None) -> StudyError | None:
    """Say why a vote cannot be kept, whatever its trial has already; the row is of `_TRIALS`."""
    if row is None or row.token_hash != digest(sent.token):
        holder = session_by_token(connection, sent.token)
        if holder is None or sent.session not in (None, holder.public_id):
            return NoSessionError()
        return NotFoundError("This session has no such trial.")
    if sent.session not in (None, row.session):
        return NoSessionError()
    if row.withdrawn_at is not None:
        return None
    if row.served_at is None:
        return ConflictError("This trial has not been given out yet.")
    if row.voided_at is not None:
        return ConflictError("This trial was interrupted; it comes again at the end.")
    try:
        _choice(sent, row)
    except InvalidVoteError as error:
        return InvalidError(f"The answer is not right: {error}.")
    protocol, has_reference = row.protocol or PC, bool(row.reference) and row.protocol not in WITH_REFERENCE
    try:
        check_viewing(sent.viewing, row.first_shown, has_reference=has_reference, is_alone=protocol in SHOWN_ALONE)
    except InvalidVoteError as error:
        return InvalidError(f"The viewing record is not right: {error}.")
    return None


def _choice(sent: Vote, row: Row[Any]) -> Choice | None:
    """Return the choice that a vote means in its study; studies made before there were protocols compare pairs."""
    protocol = row.protocol or PC
    grades = None if protocol == PC else grades_of(protocol, stored_scale(row.scale))
    return choice_of(sent.choice, sent.rating, protocol, grades)


def _row(sent: Vote, row: Row[Any]) -> dict[str, Any]:
    return {
        "client_id": sent.client_id,
        "session_id": row.session_id,
        "trial_id": row.id,
        "choice": _choice(sent, row),
        "rating": sent.rating,
        "first_shown": sent.viewing["first_shown"],
        "n_switches": len(sent.viewing["switches"]),
        "shown_ms": sent.viewing["shown_ms"],
        "response_ms": sent.viewing["response_ms"],
        "viewing": dict(sent.viewing),
        "received_at": sent.received_at,
        "both_seen": None if (row.protocol or PC) in SHOWN_ALONE else has_seen_both(sent.viewing),
        "press_to_picture_ms": press_to_picture_ms(sent.viewing),
        "shown_smoothly": smoothness(sent.viewing, row.fps).shown_smoothly,
    }


def _end_sessions(connection: Connection, last_at: Mapping[int, datetime]) -> None:
    """Let the sessions go on that have no trial left; they come with the time of their last vote."""
    for session_id in connection.scalars(_ENDED, {"sessions": list(last_at)}).all():
        end_trials(connection, session_id, last_at[session_id])


def _outcome(connection: Connection, sent: Vote, row: Row[Any], *, is_new: bool) -> KeptVote | StudyError:
    """Tell a vote that was not inserted from the one that its trial has."""
    if is_new:
        return KeptVote(row.position + 1, sent.received_at, is_new=True)
    on_trial = connection.execute(select(vote).where(vote.c.trial_id == row.id)).one_or_none()
    if on_trial is None and row.withdrawn_at is not None:
        return GoneError("You have withdrawn from the study, so this answer was not kept.")
    if on_trial is None:
        return ConflictError("This vote's id belongs to another vote.")
    is_same_answer = on_trial.rating == sent.rating and sent.choice in (on_trial.choice, None)
    if not is_same_answer or (on_trial.client_id, on_trial.viewing) != (sent.client_id, sent.viewing):
        return ConflictError("This trial has a vote already, and it is another one.")
    return KeptVote(row.position + 1, on_trial.received_at, is_new=False)


def vote_records(connection: Connection, study_id: int) -> Iterator[dict[str, Any]]:
    """Return the votes table of a study, as DESIGN's votes file."""
    return (vote_row(record) for record in trial_records(connection, study_id) if record["voted_at"] is not None)


def vote_row(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the row of a table of votes from that of a table of trials."""
    return {
        **{name: record[name] for name in OF_TRIAL},
        "practice": False,
        "excluded": record["withdrawn"] or record["exclusion"] is not None,
        "reason": "withdrawn" if record["withdrawn"] else record["exclusion"] or "",
    }

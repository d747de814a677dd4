"""Let participants into a study, and begin their sessions, each with its slot and its order of trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from sqlalchemy import Connection, Row, func, insert, select, update

from app.errors import ClosedError, ConflictError, GoneError
from app.store.database.engine import Database, insert_or_ignore
from app.store.database.keys import digest, new_opaque_id, new_secret, token_of_key
from app.store.database.tables import assignment, participant, session, shown_texts, trial
from app.store.participants.invitations import Invitation, invitation_by_code, preview_invitation
from app.store.participants.recruits import insert_recruit, renew_visit, session_of_outside_id
from app.store.studies.studies import Study, lock_study
from app.store.trials.deletion import forget_preview_votes
from app.store.trials.orders import n_taken_in, planned_trials, take_order_slot
from app.store.trials.sessions import session_by_token, token_digests
from app.study.options.options import parse_options
from app.study.options.recruiting import Arrival
from app.study.options.wording import Wording
from app.study.stages import INTRODUCTION

WhyClosed = Literal["paused", "closed", "full"]
CLOSED: Mapping[WhyClosed, str] = {
    "paused": "This study is paused. Please come back later.",
    "closed": "This study is closed. Thank you for your interest.",
    "full": "This study has all the participants it needs at the moment. Thank you for your interest.",
}
WENT_ON_ELSEWHERE = "This session goes on in another browser. Its resume code leads back to it."


@dataclass(frozen=True)
class Admitted:
    """An opened session; `is_new` unless it was there before."""

    token: str
    is_new: bool


@dataclass(frozen=True)
class Admission:
    """Who asks to begin.

    Parameters
    ----------
    key : random, made by the client: a request that is sent again with it gets the same session, whose token is derived
        from it; None: every request is another person
    arrival : how the person came from a recruiting platform; the same outside id leads to the same session
    token : of the session that the client's cookie opens, if any
    wording : what the participant reads; None: the client has texts of its own
    """

    key: str | None = None
    arrival: Arrival | None = None
    token: str | None = None
    wording: Wording | None = None


def admit(database: Database, invitation: Invitation, admission: Admission, now: datetime) -> Admitted:
    """Let somebody in: take a slot with its order of trials, and begin a session, whose token is stored as a digest.

    Somebody whose key or outside id is known goes on with their session; that of an outside id gets a new token. It is
    one transaction, so two who begin at once never get the same slot.

    Raises
    ------
    ConflictError
        If the key belongs to a session of another invitation, or to one that was resumed in another browser; or if the
        outside id has a session that goes on only where it began.
    GoneError
        If all places of the invitation are taken.
    ClosedError
        If the study takes in nobody now.
    """
    key, arrival = admission.key, admission.arrival
    token = token_of_key(key) if key else new_secret()
    with database.writing() as connection:
        study_now = lock_study(connection, invitation.study_id)  # first, because the same request may be running
        known = _session_of_key(connection, key) if key else None
        returning = session_of_outside_id(connection, study_now.id, arrival.outside_id) if arrival else None
        if known is not None:
            is_same = known.invitation_id == invitation.id if returning is None else known.id == returning
            if not is_same or known.token_hash != digest(token):
                raise ConflictError(WENT_ON_ELSEWHERE)
            return Admitted(token, is_new=False)
        if returning is not None:
            assert arrival is not None, "it led to the session"
            _check_same_browser(connection, study_now, returning, admission.token)
            renew_visit(connection, returning, arrival)
            secrets = {**token_digests(token), "begin_hash": digest(key) if key else None}
            connection.execute(update(session).where(session.c.id == returning).values(**secrets))
            return Admitted(token, is_new=False)
        _admit(connection, study_now, invitation, token, admission, now)
    return Admitted(token, is_new=True)


def _session_of_key(connection: Connection, key: str) -> Row[Any, Any, Any] | None:
    return connection.execute(
        select(session.c.id, session.c.token_hash, participant.c.invitation_id)
        .select_from(session.join(participant))
        .where(session.c.begin_hash == digest(key))
    ).one_or_none()


def _check_same_browser(connection: Connection, study_now: Study, session_id: int, token: str | None) -> None:
    """Refuse to go on in another browser where the study's option `outside.resume` does not allow it."""
    held = session_by_token(connection, token) if token else None
    is_there = held is not None and held.id == session_id
    if not is_there and parse_options(study_now.options).outside.resume == "same browser":
        raise ConflictError(WENT_ON_ELSEWHERE)


def _admit(
    connection: Connection, study_now: Study, invitation: Invitation, token: str, admission: Admission, now: datetime
) -> None:
    current = invitation_by_code(connection, invitation.code)
    if (why := why_closed(connection, study_now, now)) is not None:
        raise ClosedError(CLOSED[why], why)
    if current is None or current.is_used:
        raise GoneError("This invitation has been used. Please ask for a new one.")
    participant_id = _insert_session(connection, study_now, invitation.id, token, admission.key, now)
    if admission.wording is not None:
        _keep_wording(connection, participant_id, admission.wording)
    options = parse_options(study_now.options).outside
    if options.is_on:
        insert_recruit(connection, study_now.id, participant_id, admission.arrival, options)


def _keep_wording(connection: Connection, participant_id: int, shown: Wording) -> None:
    """Note the texts that a participant reads, in a language that stays the session's."""
    texts = {"sha256": shown.sha256, "language": shown.language, "content": shown.texts}
    insert_or_ignore(connection, shown_texts, [texts], shown_texts.c.sha256)
    connection.execute(
        update(session)
        .where(session.c.participant_id == participant_id)
        .values(language=shown.language, texts_sha256=shown.sha256)
    )


def why_closed(connection: Connection, study_now: Study, now: datetime) -> WhyClosed | None:
    """Return why a study takes in nobody new now; None: it does."""
    if study_now.standing != "open":
        return "paused" if study_now.standing == "paused" else "closed"
    limits = parse_options(study_now.options).limits
    if limits.is_over(now):
        return "closed"
    if limits.finished or limits.under_way:
        return "full" if limits.is_full(*n_taken_in(connection, study_now, now)) else None
    return None


def begin_preview(database: Database, this_study: Study, now: datetime, stage: str = INTRODUCTION) -> str:
    """Begin a preview, in which an experimenter walks through a study; it counts nowhere.

    What was entered in earlier previews of the study is forgotten.

    Parameters
    ----------
    database : of the server
    this_study : which is walked through
    now : the time
    stage : of the study's way, to begin with

    Returns
    -------
    The session's token.
    """
    token = new_secret()
    with database.writing() as connection:
        lock_study(connection, this_study.id)
        forget_preview_votes(connection, this_study.id)
        _insert_session(
            connection,
            this_study,
            preview_invitation(connection, this_study.id, now),
            token,
            None,
            now,
            is_preview=True,
        )
        connection.execute(update(session).where(session.c.token_hash == digest(token)).values(stage=stage))
    return token


def _insert_session(
    connection: Connection,
    this_study: Study,
    invitation_id: int,
    token: str,
    key: str | None,
    now: datetime,
    *,
    is_preview: bool = False,
) -> int:
    """Insert a participant with a session and its trials; returns the participant's id."""
    slot = _next_slot(connection, this_study.id, is_preview=is_preview)
    label = f"preview{-slot}" if is_preview else f"P{slot + 1:03d}"
    order_slot = slot if is_preview else take_order_slot(connection, this_study, now)
    person = {
        "study_id": this_study.id,
        "invitation_id": invitation_id,
        "slot": slot,
        "label": label,
        "order_slot": order_slot,
        "is_preview": is_preview,
        "released_at": now if is_preview else None,  # a preview takes nobody's order
    }
    participant_id = connection.execute(
        insert(participant).values(**person, created_at=now).returning(participant.c.id)
    ).scalar_one()
    secrets = {**token_digests(token), "begin_hash": digest(key) if key else None}
    session_id = connection.execute(
        insert(session)
        .values(public_id=new_opaque_id(), participant_id=participant_id, **secrets, stage=INTRODUCTION, started_at=now)
        .returning(session.c.id)
    ).scalar_one()
    _insert_trials(connection, this_study, order_slot, participant_id, session_id)
    return int(participant_id)


def _next_slot(connection: Connection, study_id: int, *, is_preview: bool) -> int:
    """Number arrivals: 0, 1, 2, … for participants, -1, -2, … for previews, which take nobody's order."""
    slots = select(func.max(participant.c.slot), func.min(participant.c.slot)).where(participant.c.study_id == study_id)
    highest, lowest = connection.execute(slots).one()
    if is_preview:
        return min(lowest or 0, 0) - 1
    return max(-1 if highest is None else int(highest), -1) + 1


def _insert_trials(connection: Connection, this_study: Study, slot: int, participant_id: int, session_id: int) -> None:
    group_name, order = planned_trials(connection, this_study, abs(slot))
    connection.execute(update(participant).where(participant.c.id == participant_id).values(group_name=group_name))
    rows = [
        {
            "participant_id": participant_id,
            "position": position,
            "pair_id": planned.pair,
            "a_half": planned.a_half,
            "first_shown": planned.first_shown,
            "role": planned.role,
        }
        for position, planned in enumerate(order)
    ]
    connection.execute(insert(assignment), rows)
    ids = connection.scalars(select(assignment.c.id).where(assignment.c.participant_id == participant_id))
    connection.execute(
        insert(trial),
        [
            {"public_id": new_opaque_id(), "session_id": session_id, "assignment_id": assignment_id, "attempt": 1}
            for assignment_id in ids
        ],
    )

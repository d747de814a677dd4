"""Sessions: a participant's way through a study, from the invitation to the last vote."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, func, insert, select, update

from app.errors import ForbiddenError, GoneError
from app.store.designs import planned_pairs
from app.store.engine import Database
from app.store.invitations import Invitation, invitation_by_code
from app.store.keys import digest, new_opaque_id, new_secret, resume_code
from app.store.studies import Study
from app.store.tables import assignment, participant, session, stage_record, study, trial, vote
from app.study.design import participant_order
from app.study.stages import FINISHED, INTRODUCTION, after_completing


@dataclass(frozen=True)
class Session:
    """A session with what its participant may know of the study."""

    id: int
    public_id: str
    study_id: int
    invitation_id: int
    slug: str
    name: str
    exposure_s: float
    stage: str


@dataclass(frozen=True)
class Done:
    """Trials voted on, of all."""

    n_done: int
    n_total: int


def begin_session(database: Database, invitation: Invitation, now: datetime) -> str:
    """Let a new participant in: the next slot, the order of trials that belongs to it, a session.

    All in one transaction: two who begin at once never get the same slot.

    Returns
    -------
    The session's token, which is not kept.

    Raises
    ------
    GoneError
        If all places of the invitation are taken.
    ForbiddenError
        If the study is closed.
    """
    token = new_secret()
    with database.writing() as connection:
        of = connection.execute(select(study).where(study.c.id == invitation.study_id).with_for_update()).one()
        current = invitation_by_code(connection, invitation.code)
        if of.state == "closed":
            raise ForbiddenError("This study is closed. Thank you for your interest.")
        if current is None or current.is_used:
            raise GoneError("This invitation has been used. Please ask for a new one.")
        _insert_session(connection, Study(**of._mapping), invitation.id, token, now)
    return token


def session_by_token(connection: Connection, token: str) -> Session | None:
    return _session(connection, session.c.token_hash == digest(token))


def resume_session(database: Database, code: str) -> str | None:
    """Give the session with this resume code a new token, and with it a new resume code; the old ones end."""
    token = new_secret()
    with database.writing() as connection:
        changed = connection.execute(
            update(session)
            .where(session.c.resume_hash == digest(code))
            .values(token_hash=digest(token), resume_hash=digest(resume_code(token)))
        )
        return token if changed.rowcount else None


def done_of(connection: Connection, session_id: int) -> Done:
    total = select(func.count()).where(trial.c.session_id == session_id).scalar_subquery()
    done = select(func.count()).where(vote.c.session_id == session_id).scalar_subquery()
    return Done(*connection.execute(select(done, total)).one())


def complete_stage(database: Database, of: Session, stage: str, data: Mapping[str, Any], now: datetime) -> str:
    """Complete a stage by hand and return the stage the session is in; what comes with it is kept from the first time.

    Raises
    ------
    IllegalMoveError
        If the stage cannot be completed now.
    """
    with database.writing() as connection:
        current = connection.execute(
            select(session.c.stage).where(session.c.id == of.id).with_for_update()
        ).scalar_one()
        after = after_completing(stage, current)
        if after != current:
            record = {"session_id": of.id, "stage": stage, "data": dict(data), "completed_at": now}
            connection.execute(insert(stage_record).values(**record))
            enter_stage(connection, of.id, after, now)
    return str(after)


def enter_stage(connection: Connection, session_id: int, stage: str, now: datetime) -> None:
    changes: dict[str, Any] = {"stage": stage, "finished_at": now} if stage == FINISHED else {"stage": stage}
    connection.execute(update(session).where(session.c.id == session_id).values(**changes))


def _insert_session(connection: Connection, of: Study, invitation_id: int, token: str, now: datetime) -> None:
    slots = select(func.coalesce(func.max(participant.c.slot), -1) + 1).where(participant.c.study_id == of.id)
    slot = int(connection.execute(slots).scalar_one())
    person = {"study_id": of.id, "invitation_id": invitation_id, "slot": slot, "label": f"P{slot + 1:03d}"}
    participant_id = connection.execute(
        insert(participant).values(**person, created_at=now).returning(participant.c.id)
    ).scalar_one()
    secrets = {"token_hash": digest(token), "resume_hash": digest(resume_code(token))}
    session_id = connection.execute(
        insert(session)
        .values(public_id=new_opaque_id(), participant_id=participant_id, **secrets, stage=INTRODUCTION, started_at=now)
        .returning(session.c.id)
    ).scalar_one()
    _insert_trials(connection, of, slot, participant_id, session_id)


def _insert_trials(connection: Connection, of: Study, slot: int, participant_id: int, session_id: int) -> None:
    order = participant_order(planned_pairs(connection, of.id), of.seed, slot)
    rows = [
        {
            "participant_id": participant_id,
            "position": position,
            "pair_id": planned.pair,
            "a_half": planned.a_half,
            "first_shown": planned.first_shown,
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


def _session(connection: Connection, condition: Any) -> Session | None:
    row = connection.execute(
        select(
            session.c.id,
            session.c.public_id,
            participant.c.study_id,
            participant.c.invitation_id,
            study.c.slug,
            study.c.name,
            study.c.exposure_s,
            session.c.stage,
        )
        .select_from(session.join(participant).join(study))
        .where(condition)
    ).one_or_none()
    return Session(**row._mapping) if row else None

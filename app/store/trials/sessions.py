"""Keep sessions: a participant's way through a study, from the first page to the last vote."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, func, insert, select, update

from app.errors import ConflictError
from app.store.database.engine import Database
from app.store.database.keys import digest, new_secret, resume_code, resumed_token, typed_code
from app.store.database.tables import participant, session, shown_texts, stage_record, study, trial, vote
from app.store.participants.exclusions import sessions_in
from app.store.participants.screening import close_screening
from app.store.trials.orders import ALL_VOTED, is_late
from app.study.options.options import StudyOptions, parse_options
from app.study.stages import (
    ENDS,
    FINISHED,
    SCREENED_OUT,
    SCREENING,
    TIMED_OUT,
    TRIAL,
    WITHDRAWN,
    after_completing,
    next_stage,
)


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
    study_options: Mapping[str, Any]
    stage: str
    started_at: datetime
    language: str | None  # of its texts; None: it was begun by another client than the page
    is_preview: bool  # an experimenter's walk through; nothing of it is kept

    @property
    def options(self) -> StudyOptions:
        return parse_options(self.study_options)

    @property
    def has_withdrawn(self) -> bool:
        return self.stage == WITHDRAWN


@dataclass(frozen=True)
class Done:
    """How many of a session's trials have votes."""

    n_done: int
    n_total: int


def shown_wordings(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return all texts that a study's participants have read: language, sha256 and content."""
    of_study = sessions_in(study_id).with_only_columns(session.c.texts_sha256)
    rows = connection.execute(
        select(shown_texts)
        .where(shown_texts.c.sha256.in_(of_study))
        .order_by(shown_texts.c.language, shown_texts.c.sha256)
    )
    return [dict(row._mapping) for row in rows]


def session_by_token(connection: Connection, token: str) -> Session | None:
    return _session(connection, session.c.token_hash == digest(token))


def resume_session(database: Database, code: str, key: str | None = None) -> str | None:
    """Give the session with this resume code a new token, and with it a new resume code; the old ones end.

    Parameters
    ----------
    code : as a person typed it: in capitals, or in groups, too
    key : random, made by the browser: with it the same code may be sent again until the new code is used; None: the
        code works once
    """
    code = typed_code(code)
    token = resumed_token(code, key) if key else new_secret()
    with database.writing() as connection:
        changed = connection.execute(
            update(session).where(session.c.resume_hash == digest(code)).values(**token_digests(token))
        )
        has_gone_on = changed.rowcount > 0 or session_by_token(connection, token) is not None
    return token if has_gone_on else None


def new_resume_code(connection: Connection, participant_id: int) -> str:
    """Make a new resume code for a participant who lost theirs; the session's older token and code end.

    Raises
    ------
    ConflictError
        If the session has ended.
    """
    token = new_secret()  # nobody gets it; it is made for the code derived from it
    is_open = (session.c.participant_id == participant_id, session.c.stage.not_in(ENDS))
    if not connection.execute(update(session).where(*is_open).values(**token_digests(token))).rowcount:
        raise ConflictError("This session has ended: there is nothing to go on with.")
    return resume_code(token)


def stage_of(connection: Connection, session_id: int) -> str:
    """Return the stage of a session."""
    return str(connection.execute(select(session.c.stage).where(session.c.id == session_id)).scalar_one())


def done_of(connection: Connection, session_id: int) -> Done:
    counting = (trial.c.session_id == session_id, trial.c.voided_at.is_(None))
    total = select(func.count()).where(*counting).scalar_subquery()
    done = select(func.count()).where(vote.c.session_id == session_id).scalar_subquery()
    return Done(*connection.execute(select(done, total)).one())


def last_answer_at(connection: Connection, session_id: int) -> datetime | None:
    """Return the time of a session's last vote; None before the first."""
    return connection.scalar(
        select(vote.c.received_at).where(vote.c.session_id == session_id).order_by(vote.c.received_at.desc()).limit(1)
    )


def complete_stage(database: Database, before: Session, stage: str, data: Mapping[str, Any], now: datetime) -> str:
    """Complete a stage with its data and return the stage the session is in; done again, it keeps the first data.

    Raises
    ------
    IllegalMoveError
        If the stage cannot be completed now.
    """
    way = before.options.way
    with database.writing() as connection:
        current = connection.execute(
            select(session.c.stage).where(session.c.id == before.id).with_for_update()
        ).scalar_one()
        after = after_completing(stage, current, way)
        if after != current:
            record = {"session_id": before.id, "stage": stage, "data": dict(data), "completed_at": now}
            connection.execute(insert(stage_record).values(**record))
            if stage == SCREENING and _is_screened_out(connection, before, now):
                after = SCREENED_OUT
            enter_stage(connection, before.id, after, now)
    return str(after)


def _is_screened_out(connection: Connection, before: Session, now: datetime) -> bool:
    """Close the screening; returns whether the study's rule ends the session."""
    options = before.options.screening
    return options.stops(close_screening(connection, before.id, options, now))


def end_trials(connection: Connection, session_id: int, now: datetime) -> None:
    """Enter the stage that follows the trials."""
    current = _session(connection, session.c.id == session_id)
    assert current is not None
    if current.stage == TRIAL:
        enter_stage(connection, session_id, next_stage(TRIAL, current.options.way), now)


def withdraw(database: Database, leaving: Session, now: datetime) -> None:
    """Withdraw a participant from the study; their data stay, marked as withdrawn. Done again, it changes nothing."""
    with database.writing() as connection:
        connection.execute(
            update(session)
            .where(session.c.id == leaving.id, session.c.withdrawn_at.is_(None))
            .values(stage=WITHDRAWN, withdrawn_at=now)
        )


def end_overdue(database: Database, late: Session, now: datetime) -> Session:
    """End a session whose time is over, as the study limits it; returns the session as it is then."""
    overdue = (session.c.id == late.id, is_late(late.options.limits, now))
    if not late.options.limits.minutes or late.stage in (*ALL_VOTED, *ENDS):
        return late
    with database.reading() as connection:
        if connection.scalar(select(session.c.id).where(*overdue)) is None:
            return late
    with database.writing() as connection:
        connection.execute(update(session).where(*overdue).values(stage=TIMED_OUT))
        ended = _session(connection, session.c.id == late.id)
    assert ended is not None
    return ended


def enter_stage(connection: Connection, session_id: int, stage: str, now: datetime) -> None:
    changes: dict[str, Any] = {"stage": stage, "finished_at": now} if stage == FINISHED else {"stage": stage}
    connection.execute(update(session).where(session.c.id == session_id).values(**changes))


def token_digests(token: str) -> dict[str, str]:
    """Return the digests of a session's token and of its resume code, to store."""
    return {"token_hash": digest(token), "resume_hash": digest(resume_code(token))}


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
            study.c.options.label("study_options"),
            session.c.stage,
            session.c.started_at,
            session.c.language,
            participant.c.is_preview,
        )
        .select_from(session.join(participant).join(study))
        .where(condition)
    ).one_or_none()
    return Session(**row._mapping) if row else None

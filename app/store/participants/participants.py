"""Show experimenters the participants: progress, exclusions, withdrawals, and all that is kept of one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, Select, func, literal_column, select, update

from app.errors import ConflictError, GoneError, InvalidError, NotFoundError
from app.store.database.belonging import rows_of_people
from app.store.database.engine import insert_or_ignore, sorted_by
from app.store.database.schema import metadata
from app.store.database.tables import (
    exclusion,
    invitation,
    participant,
    screening_item,
    session,
    stage_record,
    trial,
    vote,
)
from app.store.participants.exclusions import in_force, is_excluded, sessions_in, takes_part_in
from app.store.participants.invitations import lets_in_one
from app.study.stages import ENDS, FINISHED, SCREENED_OUT, TIMED_OUT, WITHDRAWN


@dataclass(frozen=True)
class Person:
    """A participant with the label that the study gave them."""

    id: int
    label: str
    study_id: int
    erased_at: datetime | None


def participant_labelled(connection: Connection, study_id: int, label: str) -> Person:
    """Return the participant with a label.

    Raises
    ------
    NotFoundError
        If the study has nobody of this label.
    """
    row = connection.execute(
        select(participant.c.id, participant.c.label, participant.c.study_id, participant.c.erased_at).where(
            takes_part_in(study_id), participant.c.label == label
        )
    ).one_or_none()
    if row is None:
        raise NotFoundError("This study has no such participant.")
    return Person(**row._mapping)


def person_of_session(connection: Connection, public_id: str) -> Person | None:
    """Return the participant of a session, by its public id."""
    columns = (participant.c[name] for name in ("id", "label", "study_id", "erased_at"))
    query = select(*columns).select_from(session.join(participant)).where(session.c.public_id == public_id)
    row = connection.execute(query).one_or_none()
    return Person(**row._mapping) if row else None


def check_not_erased(connection: Connection, participant_id: int) -> None:
    """Refuse to keep anything more of a participant who was erased, and lock their row: erasures and notes wait.

    Raises
    ------
    InvalidError
    """
    this = select(participant.c.label, participant.c.erased_at).where(participant.c.id == participant_id)
    label, erased_at = connection.execute(this.with_for_update(key_share=True)).one()
    if erased_at is not None:
        raise InvalidError(f"{label} was erased; nothing is kept of them any more.")


def lock_unless_withdrawn(connection: Connection, session_id: int) -> None:
    """Lock a session, lest anything be kept of who withdraws, or is erased, while a request is under way.

    Raises
    ------
    GoneError
        If the participant has withdrawn.
    """
    is_open = (session.c.id == session_id, session.c.withdrawn_at.is_(None))
    if connection.scalar(select(session.c.id).where(*is_open).with_for_update(key_share=True)) is None:
        raise GoneError("You have withdrawn from the study.")


def sessions_of(connection: Connection, participant_id: int) -> list[str]:
    """Return the public ids of a participant's sessions."""
    return list(connection.scalars(select(session.c.public_id).where(session.c.participant_id == participant_id)))


@dataclass(frozen=True)
class SoughtPeople:
    """Which participants to find.

    Parameters
    ----------
    label : part of a label; empty: any
    standing : one of STANDINGS; anything else: any
    among : labels of those who may be found; None: everybody
    """

    label: str = ""
    standing: str = ""
    among: frozenset[str] | None = None


EVERYBODY = SoughtPeople()
_GIVEN_IN_SESSION = vote.c.session_id == session.c.id
_N_VOTES = select(func.count()).where(_GIVEN_IN_SESSION)
STANDINGS: Mapping[str, ColumnElement[bool]] = {
    "going": session.c.stage.not_in(ENDS),
    "ended": session.c.stage.in_(ENDS),
    "finished": session.c.stage == FINISHED,
    "screened_out": session.c.stage == SCREENED_OUT,
    "timed_out": session.c.stage == TIMED_OUT,
    "withdrawn": session.c.withdrawn_at.is_not(None),
    "excluded": exclusion.c.id.is_not(None),
}
SORTABLE: Mapping[str, ColumnElement[Any]] = {  # columns by which `participant_records` can be sorted
    "participant": participant.c.slot,
    "stage": session.c.stage,
    "votes": literal_column("n_votes"),
    "interrupted": literal_column("n_voided"),
    "response": literal_column("mean_response_ms"),
    "began": session.c.started_at,
}


def participant_records(
    connection: Connection,
    study_id: int,
    sought: SoughtPeople = EVERYBODY,
    *,
    sort: str = "",
    limit: int | None = None,
    offset: int = 0,
    newest_first: bool = False,
) -> list[dict[str, Any]]:
    """Return everybody who has begun, by arrival or the other way round; `sort` is of SORTABLE and comes first."""
    arrival = participant.c.slot.desc() if newest_first else participant.c.slot
    order = (*sorted_by(SORTABLE, sort), arrival)
    rows = connection.execute(_records(study_id, sought).order_by(*order).limit(limit).offset(offset))
    return [_described(row) for row in rows]


def participant_record(connection: Connection, person: Person) -> dict[str, Any]:
    """Return a participant as in `participant_records`."""
    return _described(connection.execute(_records(person.study_id).where(participant.c.id == person.id)).one())


def last_heard_at(record: Mapping[str, Any]) -> datetime:
    """Return when anything last came from a participant; the record is of `participant_records`."""
    signs = ("started_at", "last_stage_at", "last_tested_at", "last_served_at", "last_vote_at", "finished_at")
    times: list[datetime] = [record[sign] for sign in signs if record[sign] is not None]
    return max(times)


def counted_voters(connection: Connection, study_id: int) -> set[str]:
    """Return the labels of those who have voted and neither withdrew nor are excluded."""
    has_voted = select(vote.c.trial_id).where(_GIVEN_IN_SESSION).exists()
    counts = (takes_part_in(study_id), session.c.withdrawn_at.is_(None), ~is_excluded(), has_voted)
    return set(connection.scalars(select(participant.c.label).select_from(participant.join(session)).where(*counts)))


def assigned_groups(connection: Connection, study_id: int) -> dict[str, str]:
    """Return the group that each participant was assigned to, by label; who is in none is left out."""
    rows = select(participant.c.label, participant.c.group_name).where(
        takes_part_in(study_id), participant.c.group_name.is_not(None)
    )
    return {row.label: row.group_name for row in connection.execute(rows)}


def group_counts(connection: Connection, study_id: int) -> dict[str, tuple[int, int]]:
    """Count who has begun and who has finished in each group that somebody was assigned to."""
    has_finished = func.count().filter(session.c.stage == FINISHED)
    rows = connection.execute(
        select(participant.c.group_name, func.count(), has_finished)
        .select_from(participant.join(session))
        .where(takes_part_in(study_id), participant.c.group_name.is_not(None))
        .group_by(participant.c.group_name)
    )
    return {name: (n_begun, n_finished) for name, n_begun, n_finished in rows}


def session_state(connection: Connection, study_id: int) -> list[tuple[Any, ...]]:
    """Return numbers that change whenever a session of a study begins, goes on to another stage, or ends."""
    counts = (func.count(), func.count(session.c.finished_at), func.count(session.c.language))
    rows = select(session.c.stage, *counts).select_from(session.join(participant)).where(takes_part_in(study_id))
    return [tuple(row) for row in connection.execute(rows.group_by(session.c.stage).order_by(session.c.stage))]


def n_interrupted(connection: Connection, study_id: int) -> int:
    """Count the trials of a study that were interrupted."""
    # "+ 0": few trials are interrupted, and an index finds them
    voided = select(func.count()).where(
        trial.c.voided_at.is_not(None), (trial.c.session_id + 0).in_(sessions_in(study_id))
    )
    return int(connection.execute(voided).scalar_one())


def n_participants(connection: Connection, study_id: int, sought: SoughtPeople = EVERYBODY) -> int:
    """Count the participants that `participant_records` finds."""
    return int(connection.execute(_records(study_id, sought).with_only_columns(func.count())).scalar_one())


def _described(row: Row[Any]) -> dict[str, Any]:
    return {**row._mapping, "excluded": row.reason is not None}


def _records(study_id: int, sought: SoughtPeople = EVERYBODY) -> Select[Any]:
    trials = select(func.count()).where(trial.c.session_id == session.c.id)
    facts = {
        "n_trials": trials.where(trial.c.voided_at.is_(None)),
        "n_votes": _N_VOTES,
        "n_voided": trials.where(trial.c.voided_at.is_not(None)),
        "last_stage_at": select(func.max(stage_record.c.completed_at)).where(stage_record.c.session_id == session.c.id),
        "last_tested_at": select(func.max(screening_item.c.answered_at)).where(
            screening_item.c.session_id == session.c.id
        ),
        "last_served_at": select(func.max(trial.c.served_at)).where(trial.c.session_id == session.c.id),
        "last_vote_at": select(func.max(vote.c.received_at)).where(_GIVEN_IN_SESSION),
        "mean_response_ms": select(func.avg(vote.c.response_ms)).where(_GIVEN_IN_SESSION),
    }
    query = (
        select(
            participant.c.label.label("participant"),
            participant.c.group_name.label("group"),
            session.c.public_id.label("session"),
            session.c.stage,
            session.c.started_at,
            session.c.finished_at,
            session.c.withdrawn_at,
            session.c.language,
            session.c.texts_sha256,
            participant.c.erased_at,
            exclusion.c.reason,
            exclusion.c.excluded_by,
            exclusion.c.excluded_at,
            *(query.scalar_subquery().label(name) for name, query in facts.items()),
        )
        .select_from(participant.join(session))
        .outerjoin(exclusion, in_force(participant.c.id))
        .where(takes_part_in(study_id))
    )
    if sought.label:
        query = query.where(participant.c.label.icontains(sought.label, autoescape=True))
    if sought.among is not None:
        query = query.where(participant.c.label.in_(sought.among))
    return query.where(STANDINGS[sought.standing]) if sought.standing in STANDINGS else query


def exclusion_records(connection: Connection, participant_id: int) -> list[dict[str, Any]]:
    """Return all exclusions of a participant, including undone ones, the newest first."""
    rows = select(exclusion).where(exclusion.c.participant_id == participant_id).order_by(exclusion.c.id.desc())
    return [dict(row._mapping) for row in connection.execute(rows)]


def exclude(connection: Connection, person: Person, reason: str, by: str, now: datetime) -> None:
    """Leave a participant's votes out of the analysis, for a reason.

    Raises
    ------
    ConflictError
        If they are left out already.
    InvalidError
        If they were erased.
    """
    check_not_erased(connection, person.id)
    values = {"participant_id": person.id, "reason": reason, "excluded_by": by, "excluded_at": now}
    if not insert_or_ignore(connection, exclusion, [values], exclusion.c.id):
        raise ConflictError(f"{person.label} is excluded already.")


def undo_exclusion(connection: Connection, person: Person, by: str, now: datetime) -> None:
    """Count a participant's votes again.

    Raises
    ------
    ConflictError
        If they are not left out.
    """
    changed = connection.execute(update(exclusion).where(in_force(person.id)).values(undone_by=by, undone_at=now))
    if not changed.rowcount:
        raise ConflictError(f"{person.label} is not excluded.")


def withdraw_participant(connection: Connection, person: Person, now: datetime) -> None:
    """Withdraw a participant at their request; their data stay stored but no longer count."""
    connection.execute(
        update(session)
        .where(session.c.participant_id == person.id, session.c.withdrawn_at.is_(None))
        .values(stage=WITHDRAWN, withdrawn_at=now)
    )


def stage_records(connection: Connection, participant_id: int) -> list[dict[str, Any]]:
    """Return the data that a participant sent with each stage, in order."""
    rows = connection.execute(
        select(stage_record.c.stage, stage_record.c.data, stage_record.c.completed_at)
        .join(session)
        .where(session.c.participant_id == participant_id)
        .order_by(stage_record.c.id)
    )
    return [dict(row._mapping) for row in rows]


def everything_of(connection: Connection, person: Person) -> dict[str, list[dict[str, Any]]]:
    """Return every row of a participant, by table, without secrets."""
    records: dict[str, list[dict[str, Any]]] = {}
    for table in metadata.sorted_tables:
        if (belongs := rows_of_people(table, [person.id])) is not None:
            columns = [column for column in table.c if not column.name.endswith("_hash")]
            rows = connection.execute(select(*columns).where(belongs))
            records[table.name] = [dict(row._mapping) for row in rows]
    if (label := _name_on_invitation(connection, person)) is not None:
        records["invitation"] = [{"label": label}]
    return records


def _name_on_invitation(connection: Connection, person: Person) -> str | None:
    """Return the label of the invitation that let in a participant alone, which may name them; None without one."""
    named = (participant.c.id == person.id, lets_in_one(), invitation.c.label != "")
    return connection.scalar(select(invitation.c.label).select_from(participant.join(invitation)).where(*named))

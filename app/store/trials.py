"""Trials: serve the next one, repeat interrupted ones, list them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, Select, and_, exists, func, insert, select, update

from app.errors import ConflictError, NotFoundError
from app.store.designs import SECOND, has_singles
from app.store.engine import Database
from app.store.exclusions import in_force, takes_part_in
from app.store.keys import new_opaque_id
from app.store.tables import (
    assignment,
    condition,
    dataset,
    exclusion,
    pair,
    participant,
    second_film,
    session,
    stimulus,
    study,
    trial,
    vote,
)
from app.study.protocols import PC, SHOWN_ALONE, WITH_REFERENCE
from app.study.technique import is_frame_locked
from app.study.trial import LEFT_THE_PAGE, reveal
from app.study.valid_vote import has_seen_both, press_to_picture_ms

MOST_ATTEMPTS = 2  # an interrupted trial is repeated once
MOST_LOOKS = 100  # a trial whose page is left comes again each time
ROWS_AT_ONCE = 2000  # so that tables of any length fit into memory
IN_ORDER = (participant.c.slot, assignment.c.position, trial.c.attempt)


@dataclass(frozen=True)
class NextTrial:
    """A trial as its participant may know it; `position` counts from 0, `attempt` from 1."""

    id: int
    public_id: str
    position: int
    attempt: int
    a_half: str
    first_shown: str
    served_at: datetime | None
    media: str
    width: int
    height: int
    guard_rows: int
    fps: float
    n_frames: int
    second_media: str | None
    second_codec: str | None
    has_singles: bool


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
            pair.c.media,
            pair.c.width,
            pair.c.height,
            pair.c.guard_rows,
            pair.c.fps,
            pair.c.n_frames,
            *SECOND,
            has_singles(pair.c.media).label("has_singles"),
        )
        .select_from(trial.join(assignment).join(pair).outerjoin(second_film, second_film.c.of_media == pair.c.media))
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
    """
    with database.writing() as connection:
        connection.execute(select(session.c.id).where(session.c.id == session_id).with_for_update(key_share=True))
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


def trial_records(connection: Connection, study_id: int, session_id: str | None = None) -> Iterator[dict[str, Any]]:
    """Every planned trial of a study, with what it compared and how it was answered.

    Parameters
    ----------
    session_id : the public id of one session; None for all
    """
    query = _records().where(takes_part_in(study_id))
    if session_id is not None:
        query = query.where(session.c.public_id == session_id)
    ordered = query.order_by(*IN_ORDER)
    protocol, reference = _judging(connection, study_id)
    with connection.execute(
        ordered.execution_options(yield_per=ROWS_AT_ONCE)
    ) as rows:  # else PostgreSQL would send all rows at once
        for row in rows:
            yield _described(row, protocol, reference)


def trial_record(connection: Connection, study_id: int, trial_id: str) -> dict[str, Any] | None:
    """Return a trial of a study as in `trial_records`."""
    query = _records().where(takes_part_in(study_id), trial.c.public_id == trial_id)
    row = connection.execute(query).one_or_none()
    return None if row is None else _described(row, *_judging(connection, study_id))


@dataclass(frozen=True)
class SoughtTrials:
    """A filter of trials with a vote or an interruption.

    Parameters
    ----------
    participant, dataset : empty: any
    kind : a key of KINDS; anything else: any
    """

    participant: str = ""
    dataset: str = ""
    kind: str = ""


KINDS: Mapping[str, ColumnElement[bool]] = {
    "voided": trial.c.voided_at.is_not(None),
    "ties": vote.c.choice == "none",
    "unswitched": vote.c.n_switches == 0,
    "excluded": session.c.withdrawn_at.is_not(None) | exclusion.c.id.is_not(None),
}
IS_GIVEN = vote.c.id.is_not(None) | trial.c.voided_at.is_not(None)


def given_trials(
    connection: Connection, study_id: int, sought: SoughtTrials, *, limit: int, offset: int = 0
) -> list[dict[str, Any]]:
    """Trials with a vote or an interruption, the latest first, as in `trial_records`."""
    latest_first = (func.coalesce(vote.c.received_at, trial.c.voided_at).desc(), *IN_ORDER)
    # Ids first, so that long viewing records need not be sorted.
    ids = _given(study_id, sought).with_only_columns(trial.c.id).order_by(*latest_first).limit(limit).offset(offset)
    query = _records().where(trial.c.id.in_(ids.subquery().select())).order_by(*latest_first)
    protocol, reference = _judging(connection, study_id)
    return [_described(row, protocol, reference) for row in connection.execute(query)]


def n_given_trials(connection: Connection, study_id: int, sought: SoughtTrials) -> int:
    """How many trials `given_trials` finds."""
    return int(connection.execute(_given(study_id, sought).with_only_columns(func.count())).scalar_one())


def given_labels(connection: Connection, study_id: int) -> list[str]:
    """Labels of participants who have voted or been interrupted, in order of arrival."""
    of_session = trial.c.session_id == session.c.id
    has_given = exists().where(vote.c.session_id == session.c.id) | exists().where(
        of_session, trial.c.voided_at.is_not(None)
    )
    rows = select(participant.c.label).select_from(participant.join(session)).where(takes_part_in(study_id), has_given)
    return list(connection.scalars(rows.order_by(participant.c.slot)))


def _given(study_id: int, sought: SoughtTrials) -> Select[Any]:
    query = _records().where(takes_part_in(study_id), IS_GIVEN)
    if sought.participant:
        query = query.where(participant.c.label == sought.participant)
    if sought.dataset:
        query = query.where(dataset.c.name == sought.dataset)
    return query.where(KINDS[sought.kind]) if sought.kind in KINDS else query


def _judging(connection: Connection, study_id: int) -> tuple[str, str]:
    """Read a study's protocol, and the condition that is its reference among the rated ones; empty: none.

    They are read by themselves, because a study's options are long and a table has a row for each trial.
    """
    names = (study.c.options[name].as_string() for name in ("protocol", "reference"))
    protocol, reference = connection.execute(select(*names).where(study.c.id == study_id)).one()
    return protocol or PC, reference if protocol in WITH_REFERENCE else ""


def _described(row: Row[Any], protocol: str, reference: str) -> dict[str, Any]:
    items = reveal(row.top, row.bottom, row.a_half, row.first_shown)
    viewing = row.viewing if row.voided_at is None else row.void_viewing
    technique = (viewing or {}).get("technique")
    return {
        "trial": row.public_id,
        "session": row.session,
        "participant": row.participant,
        "number": row.position + 1,
        "attempt": row.attempt,
        "looks_before": row.attempt - 1,
        "dataset": row.dataset,
        "item_a": items.item_a,
        "item_b": items.item_b,
        "first_shown": items.first_shown,
        "role": row.role,
        "served_at": row.served_at,
        "voided_at": row.voided_at,
        "void_reason": row.void_reason,
        "voted_at": row.received_at,
        "protocol": protocol,
        "choice": row.choice,
        "rating": row.rating,
        "reference": items.item_b == reference,
        "shown_ms": row.shown_ms,
        "response_ms": row.response_ms,
        "n_switches": row.n_switches,
        "both_seen": has_seen_both(viewing) if viewing and protocol not in SHOWN_ALONE else None,
        "press_to_picture_ms": press_to_picture_ms(viewing) if viewing else None,
        "technique": technique,
        "frame_locked": is_frame_locked(technique),
        "n_mismatches": (viewing or {}).get("n_mismatches"),
        "viewing": viewing,
        "withdrawn": row.withdrawn_at is not None,
        "exclusion": row.exclusion,
    }


def _records() -> Select[Any]:
    top, bottom = stimulus.alias("top"), stimulus.alias("bottom")
    top_condition, bottom_condition = condition.alias("top_condition"), condition.alias("bottom_condition")
    return (
        select(
            trial.c.public_id,
            session.c.public_id.label("session"),
            participant.c.label.label("participant"),
            assignment.c.position,
            trial.c.attempt,
            dataset.c.name.label("dataset"),
            top_condition.c.name.label("top"),
            bottom_condition.c.name.label("bottom"),
            assignment.c.a_half,
            assignment.c.first_shown,
            assignment.c.role,
            trial.c.served_at,
            trial.c.voided_at,
            trial.c.void_reason,
            trial.c.void_viewing,
            session.c.withdrawn_at,
            exclusion.c.reason.label("exclusion"),
            vote.c.received_at,
            vote.c.choice,
            vote.c.rating,
            vote.c.shown_ms,
            vote.c.response_ms,
            vote.c.n_switches,
            vote.c.viewing,
        )
        .select_from(trial)
        .join(session, trial.c.session_id == session.c.id)
        .join(participant, session.c.participant_id == participant.c.id)
        .join(assignment, trial.c.assignment_id == assignment.c.id)
        .join(pair, assignment.c.pair_id == pair.c.id)
        .join(dataset, pair.c.dataset_id == dataset.c.id)
        .join(top, pair.c.top_id == top.c.id)
        .join(bottom, pair.c.bottom_id == bottom.c.id)
        .join(top_condition, top.c.condition_id == top_condition.c.id)
        .join(bottom_condition, bottom.c.condition_id == bottom_condition.c.id)
        .outerjoin(vote, is_voted_on())
        .outerjoin(exclusion, in_force(participant.c.id))
    )


@dataclass(frozen=True)
class TrialFilm:
    """The film of a trial, and which half of it was A."""

    media: str
    a_half: str
    width: int
    height: int
    guard_rows: int
    fps: float
    n_frames: int


def trial_film(connection: Connection, study_id: int, trial_id: str) -> TrialFilm | None:
    """Find the film of a study's trial."""
    facts = ("media", "width", "height", "guard_rows", "fps", "n_frames")
    row = connection.execute(
        select(assignment.c.a_half, *(pair.c[name] for name in facts))
        .select_from(trial.join(assignment).join(pair).join(participant))
        .where(participant.c.study_id == study_id, trial.c.public_id == trial_id)
    ).one_or_none()
    return TrialFilm(**row._mapping) if row else None

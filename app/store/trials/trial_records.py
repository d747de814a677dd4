"""Read trials as rows of tables: what each compared and how it was answered."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Connection, Row, Select, func, select

from app.store.database.engine import Database
from app.store.database.tables import (
    assignment,
    dataset,
    exclusion,
    pair,
    participant,
    session,
    study,
    trial,
    vote,
)
from app.store.participants.exclusions import in_force, sessions_in, takes_part_in
from app.store.trials.designs import PAIR_NAMES, with_pair_names
from app.store.trials.trials import is_voted_on
from app.study.protocols import PC, SHOWN_ALONE, WITH_REFERENCE
from app.study.trial.smoothness import smoothness
from app.study.trial.technique import is_frame_locked
from app.study.trial.trial import reveal
from app.study.trial.valid_vote import has_seen_both, press_to_picture_ms

ROWS_AT_ONCE = 2000  # so that tables of any length fit into memory
IN_ORDER = (participant.c.slot, assignment.c.position, trial.c.attempt)


def trial_records(connection: Connection, study_id: int) -> Iterator[dict[str, Any]]:
    """Yield every planned trial of a study, with what it compared and how it was answered."""
    protocol, reference = judging(connection, study_id)
    query = all_records().where(takes_part_in(study_id)).order_by(*IN_ORDER)
    # in parts: else PostgreSQL would send all rows at once
    with connection.execute(query.execution_options(yield_per=ROWS_AT_ONCE)) as rows:
        for row in rows:
            yield described(row, protocol, reference)


@dataclass(frozen=True)
class SoughtRows:
    """A filter of a study's trials: those of a participant, session (public id) or dataset; None: of any."""

    participant: str | None = None
    session: str | None = None
    dataset: str | None = None


def rows_by_session(
    connection: Connection, study_id: int, sought: SoughtRows, *, is_voted: bool
) -> list[tuple[int, int]]:
    """Count the trials that a filter finds, or their votes: session and number, in the order of `trial_records`."""
    sessions = sessions_in(study_id)
    if sought.participant is not None:
        sessions = sessions.where(participant.c.label == sought.participant)
    if sought.session is not None:
        sessions = sessions.where(session.c.public_id == sought.session)
    counted = vote if is_voted else trial
    rows = select(counted.c.session_id, func.count()).where(counted.c.session_id.in_(sessions))
    if sought.dataset is not None:
        shown = trial.join(assignment).join(pair).join(dataset)
        rows = rows.select_from(vote.join(shown, vote.c.trial_id == trial.c.id) if is_voted else shown)
        rows = rows.where(dataset.c.name == sought.dataset)
    numbers = {row[0]: row[1] for row in connection.execute(rows.group_by(counted.c.session_id))}
    in_order = connection.scalars(sessions.order_by(participant.c.slot))
    return [(key, numbers[key]) for key in in_order if key in numbers]


def trial_page(
    database: Database,
    study_id: int,
    sought: SoughtRows,
    counts: Sequence[tuple[int, int]],
    *,
    is_voted: bool,
    offset: int = 0,
    limit: int | None = None,
) -> Iterator[dict[str, Any]]:
    """Read a page of what `rows_by_session` counted, as `trial_records`, some participants at a time.

    Each part is a transaction of its own, so that a slow reader keeps no connection.

    Parameters
    ----------
    counts : of `rows_by_session` with the same filter
    is_voted : only trials with a vote
    limit : None: to the end
    """
    left = sum(n for _, n in counts) if limit is None else limit
    waiting = deque(counts)
    while waiting and offset >= waiting[0][1]:
        offset -= waiting.popleft()[1]
    while waiting and left > 0:
        sessions, n_rows = [], -offset
        while waiting and n_rows < min(left, ROWS_AT_ONCE):
            key, n = waiting.popleft()
            sessions.append(key)
            n_rows += n
        with database.reading() as connection:
            rows = _rows_of(connection, study_id, sessions, sought, is_voted=is_voted)
        yield from rows[offset : offset + left]
        left -= len(rows) - offset
        offset = 0


def _rows_of(
    connection: Connection, study_id: int, sessions: Sequence[int], sought: SoughtRows, *, is_voted: bool
) -> list[dict[str, Any]]:
    query = all_records().where(session.c.id.in_(sessions))
    if sought.dataset is not None:
        query = query.where(dataset.c.name == sought.dataset)
    if is_voted:
        query = query.where(vote.c.id.is_not(None))
    protocol, reference = judging(connection, study_id)
    return [described(row, protocol, reference) for row in connection.execute(query.order_by(*IN_ORDER))]


def trial_state(connection: Connection, study_id: int) -> tuple[Any, ...]:
    """Return numbers that change whenever a trial of a study is planned, given out or interrupted."""
    sessions = sessions_in(study_id)
    counts = (func.count(), func.count(trial.c.served_at), func.max(trial.c.served_at), func.count(trial.c.voided_at))
    return tuple(connection.execute(select(*counts).where(trial.c.session_id.in_(sessions))).one())


def trial_record(connection: Connection, study_id: int, trial_id: str) -> dict[str, Any] | None:
    """Return a trial of a study as in `trial_records`."""
    query = all_records().where(takes_part_in(study_id), trial.c.public_id == trial_id)
    row = connection.execute(query).one_or_none()
    return None if row is None else described(row, *judging(connection, study_id))


def judging(connection: Connection, study_id: int) -> tuple[str, str]:
    """Read a study's protocol, and the condition that is its reference among the rated ones; empty: none.

    They are read by themselves, because a study's options are long and a table has a row for each trial.
    """
    names = (study.c.options[name].as_string() for name in ("protocol", "reference"))
    protocol, reference = connection.execute(select(*names).where(study.c.id == study_id)).one()
    return protocol or PC, reference if protocol in WITH_REFERENCE else ""


def described(row: Row[Any], protocol: str, reference: str) -> dict[str, Any]:
    """Turn a row of `all_records` into a record of `trial_records`; protocol and reference as of `judging`."""
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
        "lighter_film": bool((viewing or {}).get("lighter_film")),
        "n_mismatches": (viewing or {}).get("n_mismatches"),
        **asdict(smoothness(viewing, row.fps)),
        "viewing": viewing,
        "withdrawn": row.withdrawn_at is not None,
        "exclusion": row.exclusion,
    }


def all_records() -> Select[Any]:
    """Select all trials of all studies with what `described` needs."""
    given = (
        select(
            trial.c.public_id,
            session.c.public_id.label("session"),
            participant.c.label.label("participant"),
            assignment.c.position,
            trial.c.attempt,
            *PAIR_NAMES,
            assignment.c.a_half,
            assignment.c.first_shown,
            assignment.c.role,
            pair.c.fps,
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
    )
    return with_pair_names(given).outerjoin(vote, is_voted_on()).outerjoin(exclusion, in_force(participant.c.id))


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

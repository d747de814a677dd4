"""Trials: which comes next, and what each showed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Select, exists, select, update

from app.store.engine import Database
from app.store.tables import (
    assignment,
    condition,
    dataset,
    pair,
    participant,
    session,
    stimulus,
    trial,
    vote,
)
from app.study.trial import reveal


@dataclass(frozen=True)
class NextTrial:
    """A trial as its participant may know it; `position` counts from 0."""

    id: int
    public_id: str
    position: int
    a_half: str
    first_shown: str
    served_at: datetime | None
    media: str
    width: int
    height: int
    guard_rows: int
    fps: float
    n_frames: int


def next_trials(connection: Connection, session_id: int, limit: int = 2) -> list[NextTrial]:
    """The first trials of a session without a vote, in order: the one to show, and the one to fetch meanwhile."""
    rows = connection.execute(
        select(
            trial.c.id,
            trial.c.public_id,
            assignment.c.position,
            assignment.c.a_half,
            assignment.c.first_shown,
            trial.c.served_at,
            pair.c.media,
            pair.c.width,
            pair.c.height,
            pair.c.guard_rows,
            pair.c.fps,
            pair.c.n_frames,
        )
        .select_from(trial.join(assignment).join(pair))
        .where(trial.c.session_id == session_id, ~exists().where(vote.c.trial_id == trial.c.id))
        .order_by(assignment.c.position)
        .limit(limit)
    )
    return [NextTrial(**row._mapping) for row in rows]


def mark_served(database: Database, trial_id: int, now: datetime) -> None:
    """Remember when a trial was first given out."""
    with database.writing() as connection:
        connection.execute(
            update(trial).where(trial.c.id == trial_id, trial.c.served_at.is_(None)).values(served_at=now)
        )


def trial_records(connection: Connection, study_id: int, session_id: str | None = None) -> Iterator[dict[str, Any]]:
    """Every trial of a study that has been planned, with what it compared and what was done in it.

    Parameters
    ----------
    session_id : the public id of one session; None for all
    """
    query = _records().where(participant.c.study_id == study_id)
    if session_id is not None:
        query = query.where(session.c.public_id == session_id)
    for row in connection.execute(query.order_by(participant.c.slot, assignment.c.position)):
        items = reveal(row.top, row.bottom, row.a_half, row.first_shown)
        yield {
            "trial": row.public_id,
            "session": row.session,
            "participant": row.participant,
            "number": row.position + 1,
            "attempt": row.attempt,
            "dataset": row.dataset,
            "item_a": items.item_a,
            "item_b": items.item_b,
            "first_shown": items.first_shown,
            "served_at": row.served_at,
            "voted_at": row.received_at,
            "choice": row.choice,
            "shown_ms": row.shown_ms,
            "response_ms": row.response_ms,
            "n_switches": row.n_switches,
            "viewing": row.viewing,
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
            trial.c.served_at,
            vote.c.received_at,
            vote.c.choice,
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
        .outerjoin(vote, vote.c.trial_id == trial.c.id)
    )

"""Return trials with a vote or an interruption, as the dashboard lists them: found, sorted and counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, exists, func, select, union_all

from app.store.database.engine import sorted_by
from app.store.database.tables import assignment, dataset, pair, participant, session, trial, vote
from app.store.participants.exclusions import is_excluded, sessions_in, takes_part_in
from app.store.trials.trial_records import IN_ORDER, all_records, described, judging
from app.store.trials.trials import is_voted_on

MOST_COUNTED = 10_000  # trials that a filter finds; more are not counted


@dataclass(frozen=True)
class SoughtTrials:
    """A filter of trials with a vote or an interruption.

    Parameters
    ----------
    participant, dataset : empty: any
    kind : a key of KINDS, or `excluded`; anything else: any
    """

    participant: str = ""
    dataset: str = ""
    kind: str = ""


KINDS: Mapping[str, ColumnElement[bool]] = {
    "voided": trial.c.voided_at.is_not(None),
    "ties": vote.c.choice == "none",
    "unswitched": vote.c.n_switches == 0,
}
GIVEN_AT = func.coalesce(vote.c.received_at, trial.c.voided_at)
SORTABLE: Mapping[str, ColumnElement[Any]] = {  # columns by which `given_trials` can be sorted
    "participant": participant.c.slot,
    "dataset": dataset.c.name,
    "switches": vote.c.n_switches,
    "response": vote.c.response_ms,
    "when": GIVEN_AT,
}


def given_trials(
    connection: Connection, study_id: int, sought: SoughtTrials, *, sort: str = "", limit: int, offset: int = 0
) -> list[dict[str, Any]]:
    """Return trials with a vote or an interruption, as in `trial_records`, the latest first.

    `sort` is of SORTABLE and comes first: for as many trials as are counted, as all of them are then read.
    """
    queries = _given(study_id, sought)
    if sort:
        order = (*sorted_by(SORTABLE, sort), GIVEN_AT.desc(), *IN_ORDER)
        all_ids = union_all(*(given.with_only_columns(trial.c.id) for given, _ in queries)).subquery()
        sorted_ids = all_records().with_only_columns(trial.c.id).where(trial.c.id.in_(select(all_ids.c.id)))
        ids = list(connection.scalars(sorted_ids.order_by(*order).limit(limit).offset(offset)))
    else:
        latest: list[tuple[datetime, int]] = []
        for given, at in queries:
            newest = given.with_only_columns(at, trial.c.id).order_by(at.desc(), trial.c.id).limit(limit + offset)
            latest += [(row[0], row[1]) for row in connection.execute(newest)]
        in_order = sorted(latest, key=lambda row: (-row[0].timestamp(), row[1]))
        ids = [key for _, key in in_order[offset : offset + limit]]
    query = all_records().add_columns(trial.c.id.label("key")).where(trial.c.id.in_(ids))
    rows = {row.key: row for row in connection.execute(query)}
    protocol, reference = judging(connection, study_id)
    return [described(rows[key], protocol, reference) for key in ids]


def n_given_trials(connection: Connection, study_id: int, sought: SoughtTrials) -> int:
    """Count the trials that `given_trials` finds, up to MOST_COUNTED votes and as many interruptions."""
    n = 0
    for given, _ in _given(study_id, sought):
        n += int(
            connection.execute(select(func.count()).select_from(given.limit(MOST_COUNTED).subquery())).scalar_one()
        )
    return n


def given_labels(connection: Connection, study_id: int, *, most: int | None = None) -> list[str]:
    """Return the labels of the first participants who have voted or been interrupted, in order of arrival."""
    of_session = trial.c.session_id == session.c.id
    has_given = exists().where(vote.c.session_id == session.c.id) | exists().where(
        of_session, trial.c.voided_at.is_not(None)
    )
    rows = select(participant.c.label).select_from(participant.join(session)).where(takes_part_in(study_id), has_given)
    return list(connection.scalars(rows.order_by(participant.c.slot).limit(most)))


def _given(study_id: int, sought: SoughtTrials) -> list[tuple[Select[Any], ColumnElement[datetime]]]:
    """Return queries of trials with a vote, and of interrupted ones, each with the column of its time."""
    sessions = sessions_in(study_id)
    if sought.participant:
        sessions = sessions.where(participant.c.label == sought.participant)
    if sought.kind == "excluded":
        sessions = sessions.where(session.c.withdrawn_at.is_not(None) | is_excluded())
    is_of_few = bool(sought.participant) or sought.kind == "excluded"
    queries: list[tuple[Select[Any], ColumnElement[datetime]]] = []
    for is_voted, at in ((True, vote.c.received_at), (False, trial.c.voided_at)):
        if sought.kind in KINDS and is_voted == (sought.kind == "voided"):
            continue  # an interrupted trial has no vote, and no vote was interrupted
        there = vote.join(trial, vote.c.trial_id == trial.c.id) if is_voted else trial.outerjoin(vote, is_voted_on())
        of_session = vote.c.session_id if is_voted else trial.c.session_id
        # "+ 0": the latest of all are found by their time, those of some participants by their sessions
        query = select(trial.c.id).where((of_session if is_of_few else of_session + 0).in_(sessions))
        if sought.dataset:
            there = there.join(assignment).join(pair).join(dataset)
            query = query.where(dataset.c.name == sought.dataset)
        if not is_voted:
            query = query.where(trial.c.voided_at.is_not(None))
        if sought.kind in KINDS:
            query = query.where(KINDS[sought.kind])
        queries.append((query.select_from(there), at))
    return queries

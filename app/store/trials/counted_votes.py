"""Read votes as columns of numbers for the analysis: all of them once, then only those that have come since."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Connection, case, func, select

from app.store.database.tables import assignment, exclusion, participant, session, trial, vote
from app.store.participants.exclusions import in_force, sessions_in, takes_part_in

ROWS_AT_ONCE = 200_000


def _told(column: ColumnElement[bool]) -> ColumnElement[int]:
    """Say a truth value as 1 or 0, and -1 where it is not recorded."""
    return case((column.is_(True), 1), (column.is_(False), 0), else_=-1)


READ: Mapping[str, tuple[Any, type[np.generic]]] = {  # the columns of `VoteColumns`: what is selected, and dtype
    "vote": (vote.c.id, np.int64),
    "session": (vote.c.session_id, np.int64),
    "pair": (assignment.c.pair_id, np.int64),
    "position": (assignment.c.position, np.int32),
    "attempt": (trial.c.attempt, np.int32),
    "a_is_top": (assignment.c.a_half == "top", np.bool_),
    "a_is_first": (assignment.c.first_shown == "a", np.bool_),
    "role": (case({"main": 0, "repeat": 1}, value=assignment.c.role, else_=2), np.int8),
    "choice": (case({"a": 0, "b": 1, "none": 2}, value=vote.c.choice, else_=-1), np.int8),
    "response_ms": (vote.c.response_ms, np.float64),
    "press_to_picture_ms": (vote.c.press_to_picture_ms, np.float64),
    "both_seen": (_told(vote.c.both_seen), np.int8),
    "shown_smoothly": (_told(vote.c.shown_smoothly), np.int8),
    "rating": (vote.c.rating, np.float64),
}


@dataclass(frozen=True)
class VoteColumns:
    """A study's votes in the order of their ids.

    Parameters
    ----------
    vote, session, pair : int64 (N,), ids
    position, attempt : int32 (N,), of the trial
    a_is_top, a_is_first : bool (N,)
    role : int8 (N,), as in `VotesTable`
    choice : int8 (N,), as in `VotesTable`; -1 where the vote is a rating
    response_ms, press_to_picture_ms : float64 (N,), NaN where not recorded
    both_seen, shown_smoothly : int8 (N,), -1 where not recorded
    rating : float64 (N,), NaN where the vote is a choice
    """

    vote: NDArray[np.int64]
    session: NDArray[np.int64]
    pair: NDArray[np.int64]
    position: NDArray[np.int32]
    attempt: NDArray[np.int32]
    a_is_top: NDArray[np.bool_]
    a_is_first: NDArray[np.bool_]
    role: NDArray[np.int8]
    choice: NDArray[np.int8]
    response_ms: NDArray[np.float64]
    press_to_picture_ms: NDArray[np.float64]
    both_seen: NDArray[np.int8]
    shown_smoothly: NDArray[np.int8]
    rating: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.vote)

    def followed_by(self, later: VoteColumns) -> VoteColumns:
        """Return these votes and then the later ones."""
        parts = (np.concatenate([getattr(self, f.name), getattr(later, f.name)]) for f in fields(self))
        return VoteColumns(*parts)

    def in_order(self, order: NDArray[np.intp]) -> VoteColumns:
        """Return the votes in another order, int (N,)."""
        return VoteColumns(*(getattr(self, f.name)[order] for f in fields(self)))


@dataclass(frozen=True)
class VoteState:
    """What tells whether a study's votes, or who counts, have changed; votes are added or erased, never altered.

    Parameters
    ----------
    n_votes : of all who take part
    newest : client id of the newest vote, which no other vote has in any database; None: there is none
    excluded : label -> reason of an experimenter's exclusion
    withdrawn, erased : labels
    """

    n_votes: int
    newest: str | None
    excluded: Mapping[str, str]
    withdrawn: tuple[str, ...]
    erased: tuple[str, ...]


@dataclass(frozen=True)
class Judge:
    """A participant as the analysis knows them; `reason` is that of an exclusion, None for none."""

    label: str
    slot: int
    has_withdrawn: bool
    reason: str | None


def vote_state(connection: Connection, study_id: int) -> VoteState:
    """Return what the votes of a study can be recognised by, without reading them."""
    counts = select(func.count(), func.max(vote.c.id)).where(vote.c.session_id.in_(sessions_in(study_id)))
    n_votes, last = connection.execute(counts).one()
    newest = connection.scalar(select(vote.c.client_id).where(vote.c.id == last))
    people = select(participant.c.label).select_from(participant.join(session)).where(takes_part_in(study_id))
    excluded = (
        select(participant.c.label, exclusion.c.reason)
        .select_from(participant.join(exclusion, in_force(participant.c.id)))
        .where(takes_part_in(study_id))
        .order_by(participant.c.slot)
    )
    return VoteState(
        n_votes,
        newest,
        {row.label: row.reason for row in connection.execute(excluded)},
        *(
            tuple(connection.scalars(people.where(when.is_not(None)).order_by(participant.c.slot)))
            for when in (session.c.withdrawn_at, participant.c.erased_at)
        ),
    )


def judges_of(connection: Connection, study_id: int) -> dict[int, Judge]:
    """Return who takes part, by session."""
    rows = connection.execute(
        select(
            session.c.id,
            participant.c.label,
            participant.c.slot,
            session.c.withdrawn_at.is_not(None),
            exclusion.c.reason,
        )
        .select_from(session.join(participant).outerjoin(exclusion, in_force(participant.c.id)))
        .where(takes_part_in(study_id))
    )
    return {key: Judge(label, slot, bool(withdrawn), reason) for key, label, slot, withdrawn, reason in rows}


@dataclass(frozen=True)
class KnownVotes:
    """All votes of a study as they were once, and the client id of the newest."""

    votes: VoteColumns
    newest: str | None


def counted_votes(connection: Connection, study_id: int, state: VoteState, known: KnownVotes | None) -> KnownVotes:
    """Return all votes of a study; those that are known already are not read again.

    Parameters
    ----------
    state : of the votes now, from the same transaction
    known : what this returned before; None: nothing is known
    """
    if known is not None and len(known.votes):
        last = int(known.votes.vote[-1])
        # the newest of the known votes may have been erased since, and another one have its id
        is_there = known.newest == connection.scalar(select(vote.c.client_id).where(vote.c.id == last))
        later = _read(connection, study_id, last) if is_there else None
        if later is not None and len(known.votes) + len(later) == state.n_votes:
            return KnownVotes(known.votes.followed_by(later) if len(later) else known.votes, state.newest)
    return KnownVotes(_read(connection, study_id, 0), state.newest)


def _read(connection: Connection, study_id: int, after: int) -> VoteColumns:
    """Read the votes of a study with larger ids than `after`."""
    parts = [np.empty((0, len(READ)))]
    while len(part := _rows(connection, study_id, after)):
        parts.append(part)
        after = int(part[-1, 0])
        if len(part) < ROWS_AT_ONCE:
            break
    columns = zip(READ.items(), np.concatenate(parts).T, strict=True)
    return VoteColumns(**{name: values.astype(dtype) for (name, (_, dtype)), values in columns})


def _rows(connection: Connection, study_id: int, after: int) -> NDArray[np.float64]:
    query = (
        select(*(selected for selected, _ in READ.values()))
        .select_from(vote.join(trial, vote.c.trial_id == trial.c.id).join(assignment))
        # "+ 0": read in the order of ids, which an index of sessions would lose
        .where(vote.c.id > after, (vote.c.session_id + 0).in_(sessions_in(study_id)))
        .order_by(vote.c.id)
        .limit(ROWS_AT_ONCE)
    )
    with connection.execute(query) as rows:
        content = rows.cursor.fetchall()  # the driver's own rows: those of SQLAlchemy take twice as long
    return np.array(content, np.float64).reshape(len(content), len(READ))

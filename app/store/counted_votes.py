"""Votes as columns of numbers for the analysis: read once, then only those that have come since."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, case, func, select

from app.store.exclusions import in_force, sessions_in, takes_part_in
from app.store.tables import (
    assignment,
    exclusion,
    participant,
    session,
    trial,
    vote,
)

ROWS_AT_ONCE = 200_000
READ = ("vote", "session", "pair", "packed", "response_ms", "press_to_picture_ms")
PACKED: dict[str, tuple[int, Any]] = {  # small numbers that are read as one, which takes less time: size and value
    "attempt": (128, trial.c.attempt),
    "a_is_top": (2, case((assignment.c.a_half == "top", 1), else_=0)),
    "a_is_first": (2, case((assignment.c.first_shown == "a", 1), else_=0)),
    "role": (3, case((assignment.c.role == "main", 0), (assignment.c.role == "repeat", 1), else_=2)),
    "choice_and_1": (
        4,
        case((vote.c.choice == "a", 1), (vote.c.choice == "b", 2), (vote.c.choice == "none", 3), else_=0),
    ),
    "rating_and_10": (128, func.coalesce(vote.c.rating + 10, 0)),  # of scales from -3 to 100
    "both_seen_and_1": (3, case((vote.c.both_seen.is_(True), 2), (vote.c.both_seen.is_(False), 1), else_=0)),
}


@dataclass(frozen=True)
class VoteColumns:
    """A study's votes in the order of their ids.

    Parameters
    ----------
    vote, session, pair : int64 (N,), ids
    position, attempt : int32 (N,), of the trial
    a_is_top, a_is_first : bool (N,)
    role, choice : int8 (N,), as in `VotesTable`
    response_ms, press_to_picture_ms : float64 (N,), NaN where not recorded
    both_seen : int8 (N,), -1 where not recorded
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
    table = dict(zip(READ, np.concatenate(parts).T, strict=True))
    position, small = _unpacked(table["packed"].astype(np.int64))
    return VoteColumns(
        vote=table["vote"].astype(np.int64),
        session=table["session"].astype(np.int64),
        pair=table["pair"].astype(np.int64),
        position=position.astype(np.int32),
        attempt=small["attempt"].astype(np.int32),
        a_is_top=small["a_is_top"].astype(bool),
        a_is_first=small["a_is_first"].astype(bool),
        role=small["role"].astype(np.int8),
        choice=(small["choice_and_1"] - 1).astype(np.int8),
        both_seen=(small["both_seen_and_1"] - 1).astype(np.int8),
        response_ms=table["response_ms"].copy(),
        press_to_picture_ms=table["press_to_picture_ms"].copy(),
        rating=np.where(small["rating_and_10"], small["rating_and_10"] - 10.0, np.nan),
    )


def _packed() -> Any:
    """Return the SQL of one number of a vote's position and small numbers."""
    number: Any = assignment.c.position
    for size, value in PACKED.values():
        number = number * size + value
    return number


def _unpacked(number: NDArray[np.int64]) -> tuple[NDArray[np.int64], dict[str, NDArray[np.int64]]]:
    """Return positions and small numbers of votes, by name, from `_packed`, int64 (N,)."""
    small = {}
    for name, (size, _) in reversed(list(PACKED.items())):
        number, small[name] = np.divmod(number, size)
    return number, small


def _rows(connection: Connection, study_id: int, after: int) -> NDArray[np.float64]:
    query = (
        select(
            vote.c.id,
            vote.c.session_id,
            assignment.c.pair_id,
            _packed(),
            vote.c.response_ms,
            vote.c.press_to_picture_ms,
        )
        .select_from(vote.join(trial, vote.c.trial_id == trial.c.id).join(assignment))
        # "+ 0": read in the order of ids, which an index of sessions would lose
        .where(vote.c.id > after, (vote.c.session_id + 0).in_(sessions_in(study_id)))
        .order_by(vote.c.id)
        .limit(ROWS_AT_ONCE)
    )
    with connection.execute(query) as rows:
        content = rows.cursor.fetchall()  # the driver's own rows: those of SQLAlchemy take twice as long
    return np.array(content, np.float64).reshape(len(content), len(READ))

"""Participants are found a page at a time; who is excluded is excluded once, also when two ask at the same moment."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from datetime import datetime, timedelta
from itertools import product
from typing import Any

import pytest
from sqlalchemy import insert, select, update

from app.errors import ConflictError
from app.store.database.engine import Database
from app.store.database.tables import screening_item, screening_test, session, stage_record
from app.store.participants.invitations import Invitation
from app.store.participants.participants import (
    SoughtPeople,
    counted_voters,
    exclude,
    exclusion_records,
    last_heard_at,
    n_participants,
    participant_labelled,
    participant_record,
    participant_records,
    undo_exclusion,
    withdraw_participant,
)
from app.store.trials.deletion import erase
from tests.app.store.voting import keep_vote, let_in, rows_read, serve_next, vote_on
from tests.seeded_studies import begin_session

KINDS: dict[str, Callable[[dict[str, Any]], bool]] = {
    "": lambda _row: True,
    "going": lambda row: row["stage"] in ("introduction", "trial"),
    "finished": lambda row: row["finished_at"] is not None,
    "screened_out": lambda row: row["stage"] == "screened_out",
    "withdrawn": lambda row: row["withdrawn_at"] is not None,
    "excluded": lambda row: row["excluded"],
    "unheard of": lambda _row: True,
}
LONG_ENOUGH_S = 0.5  # for who need not wait


def test_nobody_is_excluded_twice_when_two_ask_at_once(
    database: Database, study_id: int, invite: Callable[[int | None], Invitation], now: datetime
) -> None:
    begin_session(database, invite(None), now)
    with database.reading() as connection:
        person = participant_labelled(connection, study_id, "P001")

    def exclude_too() -> None:
        with database.writing() as connection:
            exclude(connection, person, "second", "Eva", now)

    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            exclude(connection, person, "first", "Eva", now)
            second = pool.submit(exclude_too)
            wait([second], LONG_ENOUGH_S)
        with pytest.raises(ConflictError, match="P001 is excluded already"):
            second.result()
    with database.writing() as connection:
        assert [row["reason"] for row in participant_records(connection, study_id)] == ["first"]
        undo_exclusion(connection, person, "Eva", now)
        exclude(connection, person, "again", "Eva", now)
        assert [row["reason"] for row in exclusion_records(connection, person.id)] == ["again", "first"]


@pytest.fixture
def people(database: Database, study_id: int, invite: Callable[[int | None], Invitation], now: datetime) -> int:
    """A study of eight, of whom there are some of every standing."""
    invitation = invite(None)
    begun = [let_in(database, invitation) for _ in range(7)]
    sessions = [one.id for one in begun]
    for one in begun[1:6:2]:
        trial = serve_next(database, one)
        keep_vote(database, one, trial.public_id, vote_on(trial), now)
    begin_session(database, invitation, now)
    with database.writing() as connection:
        ends = {"finished": sessions[:3], "screened_out": sessions[3:4]}
        for stage, ended in ends.items():
            connection.execute(update(session).where(session.c.id.in_(ended)).values(stage=stage, finished_at=now))
        connection.execute(update(session).where(session.c.stage == "screened_out").values(finished_at=None))
        withdraw_participant(connection, participant_labelled(connection, study_id, "P005"), now)
        erase(connection, participant_labelled(connection, study_id, "P006"), now)
        for label in ("P002", "P005"):
            exclude(connection, participant_labelled(connection, study_id, label), "looked away", "Eva", now)
        undone = participant_labelled(connection, study_id, "P003")
        exclude(connection, undone, "by mistake", "Eva", now)
        undo_exclusion(connection, undone, "Eva", now)
    return study_id


def test_every_filter_finds_what_looking_through_all_participants_finds(database: Database, people: int) -> None:
    with database.reading() as connection:
        rows = participant_records(connection, people)
        assert [row["participant"] for row in rows] == [f"P00{number}" for number in range(1, 9)]
        for label, kind in product(("", "5", "p00", "%", "P999"), KINDS):
            sought = SoughtPeople(label, kind)
            expected = [row for row in rows if label.upper() in row["participant"] and KINDS[kind](row)]
            assert participant_records(connection, people, sought) == expected, sought
            assert n_participants(connection, people, sought) == len(expected), sought
    assert all(any(KINDS[kind](row) for row in rows) for kind in KINDS)


def test_pages_of_participants_follow_each_other_and_leave_nobody_out(database: Database, people: int) -> None:
    with database.reading() as connection:
        pages = [participant_records(connection, people, limit=3, offset=at) for at in (0, 3, 6, 9)]
        assert [len(page) for page in pages] == [3, 3, 2, 0]
        assert [row for page in pages for row in page] == participant_records(connection, people)


@pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True)  # whose driver tells of every row
def test_one_participant_is_found_without_reading_the_others(database: Database, people: int) -> None:
    with database.reading() as connection:
        of_all = {row["participant"]: row for row in participant_records(connection, people)}
    read = rows_read(database)
    with database.reading() as connection:
        for number, (label, facts) in enumerate(of_all.items(), 1):
            assert participant_record(connection, participant_labelled(connection, people, label)) == facts
            assert len(read) == 2 * number  # who it is, and the record


def test_who_counts_has_voted_and_is_neither_withdrawn_nor_excluded(
    database: Database, people: int, now: datetime
) -> None:
    with database.writing() as connection:
        voters = {row["participant"] for row in participant_records(connection, people) if row["n_votes"]}
        assert voters == {"P002", "P004"}
        assert counted_voters(connection, people) == {"P004"}  # P002 is excluded
        undo_exclusion(connection, participant_labelled(connection, people, "P002"), "Eva", now)
        withdraw_participant(connection, participant_labelled(connection, people, "P004"), now)
        assert counted_voters(connection, people) == {"P002"}


def test_who_takes_a_test_or_completes_a_stage_was_heard_of_then(
    database: Database, study_id: int, invite: Callable[[int | None], Invitation], now: datetime
) -> None:
    begin_session(database, invite(None), now)
    read, tested = now + timedelta(minutes=3), now + timedelta(minutes=5)

    def heard_at() -> datetime:
        with database.reading() as connection:
            return last_heard_at(participant_record(connection, participant_labelled(connection, study_id, "P001")))

    assert heard_at() == now
    with database.writing() as connection:
        theirs = {"session_id": connection.execute(select(session.c.id)).scalar_one()}
        introduced = {**theirs, "stage": "introduction", "data": {}, "completed_at": read}
        connection.execute(insert(stage_record).values(**introduced))
    assert heard_at() == read
    with database.writing() as connection:
        begun = {**theirs, "test": "acuity", "setup": {}, "started_at": read}
        test_id = connection.execute(insert(screening_test).values(**begun).returning(screening_test.c.id)).scalar_one()
        ring = {**theirs, "screening_test_id": test_id, "number": 1, "content": {}, "served_at": read, "answer": 2}
        connection.execute(insert(screening_item).values(**ring, answered_at=tested))
    assert heard_at() == tested

"""Slots and sessions, also when everybody comes at once."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from typing import Any

import pytest
from sqlalchemy import select

from app.errors import ForbiddenError, GoneError
from app.store.database.engine import Database
from app.store.database.keys import resume_code
from app.store.database.tables import assignment, participant, session, stage_record
from app.store.participants.invitations import (
    Invitation,
    insert_invitation,
    invitation_by_code,
    invitation_of_session,
    preview_code,
)
from app.store.studies.studies import set_standing, study_by_id
from app.store.trials.admission import Admission, Admitted, admit, begin_preview
from app.store.trials.designs import planned_pairs
from app.store.trials.sessions import Session, complete_stage, done_of, resume_session, session_by_token
from app.study.design.design import participant_order
from tests.seeded_studies import begin_session

MakeInvitation = Callable[[int | None], Invitation]


def found(database: Database, token: str) -> Session:
    with database.reading() as connection:
        session = session_by_token(connection, token)
    assert session is not None
    return session


@pytest.mark.slow
def test_nobody_gets_anothers_slot_when_all_begin_at_once(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    invitation = invite(None)
    barrier = threading.Barrier(12)

    def begin() -> None:
        barrier.wait()
        for _ in range(3):
            begin_session(database, invitation, now)

    threads = [threading.Thread(target=begin) for _ in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with database.reading() as connection:
        slots = sorted(connection.scalars(select(participant.c.slot)))
    assert slots == list(range(36))


def test_previews_that_begin_at_once_share_one_invitation(database: Database, study_id: int, now: datetime) -> None:
    with database.reading() as connection:
        of = study_by_id(connection, study_id)
    assert of is not None
    together = threading.Barrier(6)

    def begin(_number: int) -> str:
        together.wait()
        return begin_preview(database, of, now)

    with ThreadPoolExecutor(6) as pool:
        tokens = list(pool.map(begin, range(6)))
    with database.reading() as connection:
        codes = {invitation_of_session(connection, token) for token in tokens}
        assert codes == {preview_code(connection, study_id)}


def test_previews_go_on_where_two_invitations_were_made_for_them(
    database: Database, study_id: int, now: datetime
) -> None:
    with database.writing() as connection:
        first, _ = (insert_invitation(connection, study_id, 0, now) for _ in range(2))
        of = study_by_id(connection, study_id)
    assert of is not None
    token = begin_preview(database, of, now)
    with database.reading() as connection:
        assert preview_code(connection, study_id) == invitation_of_session(connection, token) == first


def test_an_invitation_with_places_lets_exactly_so_many_in(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    invitation = invite(3)
    outcomes: list[str] = []
    barrier = threading.Barrier(8)

    def begin() -> None:
        barrier.wait()
        try:
            begin_session(database, invitation, now)
            outcomes.append("in")
        except GoneError:
            outcomes.append("used")

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(outcomes) == ["in"] * 3 + ["used"] * 5
    with database.reading() as connection:
        current = invitation_by_code(connection, invitation.code)
    assert current is not None
    assert current.is_used


def test_a_begin_that_is_sent_many_times_at_once_opens_one_session_for_all(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    for key in ("first key", "second key", "third key"):
        invitation, barrier = invite(1), threading.Barrier(8)

        def begin(
            _number: int, invitation: Invitation = invitation, key: str = key, barrier: Any = barrier
        ) -> Admitted:
            barrier.wait()
            return admit(database, invitation, Admission(key), now)

        with ThreadPoolExecutor(8) as pool:
            admitted = list(pool.map(begin, range(8)))
        assert len({one.token for one in admitted}) == 1
        assert sum(one.is_new for one in admitted) == 1


def test_a_closed_study_lets_nobody_in(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    invitation = invite(None)
    with database.writing() as connection:
        set_standing(connection, study_id, "closed", now)
    with pytest.raises(ForbiddenError):
        begin_session(database, invitation, now)


def test_the_stored_order_is_that_of_seed_and_slot(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    invitation = invite(None)
    for _ in range(3):
        begin_session(database, invitation, now)
    with database.reading() as connection:
        for slot in range(3):
            rows = connection.execute(
                select(assignment.c.pair_id, assignment.c.a_half, assignment.c.first_shown)
                .join(participant)
                .where(participant.c.slot == slot)
                .order_by(assignment.c.position)
            )
            planned = participant_order(planned_pairs(connection, study_id), 1, slot)
            assert [tuple(row) for row in rows] == [(one.pair, one.a_half, one.first_shown) for one in planned]


def test_neither_token_nor_resume_code_is_kept(database: Database, invite: MakeInvitation, now: datetime) -> None:
    token = begin_session(database, invite(None), now)
    with database.reading() as connection:
        row = connection.execute(select(session)).one()
    assert token not in row
    assert resume_code(token) not in row


def test_a_resume_code_leads_back_to_the_session_once(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    token = begin_session(database, invite(None), now)
    again = resume_session(database, resume_code(token))
    assert again is not None
    assert resume_session(database, resume_code(token)) is None
    with database.reading() as connection:
        assert session_by_token(connection, token) is None
    assert found(database, again).stage == "introduction"


def test_a_resume_whose_answer_was_lost_is_repeated_by_its_key_alone(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    code = resume_code(begin_session(database, invite(None), now))
    first, second = (resume_session(database, code, "this browser") for _ in range(2))
    assert first is not None
    assert second == first
    assert found(database, first).stage == "introduction"
    assert resume_session(database, code, "another browser") is None
    assert resume_session(database, code) is None
    assert resume_session(database, resume_code(first), "another browser") is not None
    assert resume_session(database, code, "this browser") is None  # it has gone on from there
    with database.reading() as connection:
        assert session_by_token(connection, first) is None


def test_a_resume_that_is_sent_twice_at_once_leads_to_one_session(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    code = resume_code(begin_session(database, invite(None), now))
    with ThreadPoolExecutor(8) as pool:
        tokens = list(pool.map(lambda _: resume_session(database, code, "this browser"), range(8)))
    assert len(set(tokens)) == 1
    assert tokens[0] is not None
    assert found(database, tokens[0]).stage == "introduction"


def test_what_came_with_a_stage_is_kept_from_the_first_time(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    of = found(database, begin_session(database, invite(None), now))
    assert complete_stage(database, of, "introduction", {"turn": 1}, now) == "trial"
    assert complete_stage(database, of, "introduction", {"turn": 2}, now) == "trial"
    with database.reading() as connection:
        assert list(connection.scalars(select(stage_record.c.data))) == [{"turn": 1}]
        assert (done_of(connection, of.id).n_done, done_of(connection, of.id).n_total) == (0, 6)

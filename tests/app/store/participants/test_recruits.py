"""Outside ids and quotas hold when thirty come at once."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from typing import Any
from uuid import uuid4

import pytest
from sqlalchemy import func, select, update

from app.errors import ClosedError
from app.operations.studies.edit import Edit, save_edit
from app.operations.studies.manage import study_file_of
from app.store.database.engine import Database
from app.store.database.tables import participant, recruit, session, study
from app.store.participants.invitations import Invitation
from app.store.participants.recruits import outside_ids_of, recruit_of, recruit_of_session, recruit_records
from app.store.studies.audit import Actor
from app.store.studies.studies import study_by_id
from app.store.trials.admission import Admission, admit
from app.study.options.options import parse_options
from app.study.options.recruiting import Arrival

MakeInvitation = Callable[[int | None], Invitation]
N_AT_ONCE = 30


def sets(database: Database, **options: Any) -> None:
    with database.writing() as connection:
        connection.execute(update(study).values(options=parse_options(options).as_json()))


def all_at_once(action: Callable[[int], str]) -> list[str]:
    together = threading.Barrier(N_AT_ONCE)

    def act(number: int) -> str:
        together.wait()
        return action(number)

    with ThreadPoolExecutor(N_AT_ONCE) as pool:
        return list(pool.map(act, range(N_AT_ONCE)))


def test_ten_people_who_each_come_three_times_at_once_take_ten_slots(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    sets(database, outside={"id": "PERSON"})
    invitation = invite(None)

    def come(number: int) -> str:
        return admit(database, invitation, Admission(str(uuid4()), Arrival(f"p-{number % 10}")), now).token

    assert len(set(all_at_once(come))) == N_AT_ONCE  # each browser has its own token, and the last one of an id counts
    with database.reading() as connection:
        assert sorted(connection.scalars(select(participant.c.slot))) == list(range(10))
        assert sorted(connection.scalars(select(recruit.c.outside_id))) == [f"p-{number}" for number in range(10)]
        assert connection.scalar(select(func.count()).select_from(session)) == 10


def test_no_more_are_taken_in_than_the_quota_when_thirty_come_at_once(
    database: Database, invite: MakeInvitation, now: datetime
) -> None:
    sets(database, outside={"id": "PERSON"}, limits={"finished": 7})
    invitation = invite(None)

    def come(number: int) -> str:
        try:
            admit(database, invitation, Admission(None, Arrival(f"p-{number}")), now)
        except ClosedError as refused:
            return refused.standing
        return "in"

    outcomes = all_at_once(come)
    assert (outcomes.count("in"), outcomes.count("full")) == (7, N_AT_ONCE - 7)


@pytest.mark.parametrize("outside", [{}, {"id": "PERSON"}])
def test_who_is_under_way_has_a_code_of_their_own_while_the_study_makes_them(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime, outside: dict[str, Any]
) -> None:
    sets(database, outside=outside)
    invitation = invite(None)
    for number in range(3):
        admit(database, invitation, Admission(None, Arrival(f"p-{number}") if outside else None), now)
    with database.writing() as connection:
        of_first = select(participant.c.id).where(participant.c.label == "P001").scalar_subquery()
        connection.execute(update(session).where(session.c.participant_id == of_first).values(stage="finished"))
        before = study_by_id(connection, study_id)
    assert before is not None
    given = []
    for revision, codes in enumerate([{"random_codes": True}, {"random_codes": True}, {"code": "C0DE"}], start=1):
        changes = {"outside": outside | codes}
        wanted = study_file_of(before).but(options=parse_options(changes))
        save_edit(database, Edit(before, wanted, changes, None), revision, Actor(0, "Eva", now))
        with database.reading() as connection:
            rows = connection.execute(select(participant.c.label, recruit.c.completion_code).join(recruit))
            given.append({label: code for label, code in rows if code})
    assert given[0] == given[1]  # saved again, everybody keeps their code
    assert given[0].keys() == {"P002", "P003"}  # P001 has read theirs already
    assert len(set(given[0].values())) == 2
    assert given[2] == {}


def test_whoever_pays_finds_each_persons_outside_id_and_code_and_nobody_elses(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    sets(database, outside={"id": "PERSON", "random_codes": True})
    invitation = invite(None)
    for name in ("p-0", "p-1"):
        admit(database, invitation, Admission(None, Arrival(name)), now)
    with database.reading() as connection:
        assert outside_ids_of(connection, study_id, ["P002", "P003"]) == {"P002": "p-1"}
        sessions = select(participant.c.label, session.c.id).join(session).order_by(participant.c.label)
        found = {label: recruit_of_session(connection, number) for label, number in connection.execute(sessions)}
        assert {label: one and one.outside_id for label, one in found.items()} == {"P001": "p-0", "P002": "p-1"}
        codes = {label: one and one.completion_code for label, one in found.items()}
        assert len(set(codes.values()) - {""}) == 2
        paid = recruit_records(connection, study_id, fixed_code="FIXED")
        assert {row["participant"]: row["completion_code"] for row in paid} == codes
        assert recruit_of(connection, 1 + max(connection.scalars(select(participant.c.id)))) is None

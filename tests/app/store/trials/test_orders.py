"""Slots are given out again when they were given up, never to two who both may finish."""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import datetime, timedelta

import pytest
from sqlalchemy import select, update

from app.errors import ClosedError
from app.store.database import steady_clock
from app.store.database.engine import Database
from app.store.database.tables import assignment, participant, session, study
from app.store.participants.invitations import Invitation
from app.store.studies.studies import study_by_id
from app.store.trials import orders as orders_of_trials
from app.store.trials.orders import study_plan, taken_orders
from app.store.trials.sessions import complete_stage, session_by_token, withdraw
from app.store.trials.trials import mark_served, next_trials
from app.store.trials.vote_records import Vote
from app.study.design.balance import TakenOrder, balance_report
from app.study.stages import SCREENED_OUT
from tests.app.store.voting import Participant, keep_vote
from tests.seeded_studies import begin_session

MakeInvitation = Callable[[int | None], Invitation]
DAY = timedelta(hours=24)


def orders(database: Database, study_id: int, now: datetime) -> list[TakenOrder]:
    with database.reading() as connection:
        of = study_by_id(connection, study_id)
        assert of is not None
        return taken_orders(connection, of, now)


def holders(database: Database, study_id: int, now: datetime) -> dict[int, str]:
    return {one.slot: one.participant for one in orders(database, study_id, now) if not one.is_released}


def vote_on(database: Database, token: str, n_votes: int, now: datetime) -> None:
    with database.reading() as connection:
        of = session_by_token(connection, token)
    assert of is not None
    complete_stage(database, of, "introduction", {}, now)
    for number in range(n_votes):
        with database.reading() as connection:
            (trial, *_) = next_trials(connection, of.id)
        mark_served(database, [trial.id], now)
        viewing = {"first_shown": trial.first_shown, "shown_ms": 1.0, "response_ms": 1.0, "switches": []}
        sent = Vote(token, trial.public_id, f"{token[:20]}{number}", "a", viewing, now)
        keep_vote(database, Participant(token, of), trial.public_id, sent, now)


def test_a_slot_that_was_abandoned_is_given_out_again_and_its_order_with_it(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    invitation = invite(None)
    begin_session(database, invitation, now)
    later = now + DAY + timedelta(seconds=1)
    begin_session(database, invitation, later)
    assert holders(database, study_id, later) == {0: "P002"}
    first, second = orders(database, study_id, later)
    assert (first.state, first.is_released, second.state) == ("abandoned", True, "under way")
    assert list(first.trials) == list(second.trials)


@pytest.mark.parametrize(("hours", "is_kept"), [(23, True), (25, False)])
def test_a_slot_is_kept_for_a_day_after_the_last_answer(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime, hours: int, is_kept: bool
) -> None:
    token = begin_session(database, invite(None), now - DAY)
    vote_on(database, token, 2, now)
    later = now + timedelta(hours=hours)
    begin_session(database, invite(None), later)
    assert holders(database, study_id, later) == ({0: "P001", 1: "P002"} if is_kept else {0: "P002"})


def test_who_has_voted_on_everything_keeps_the_slot_for_ever(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    vote_on(database, begin_session(database, invite(None), now), 6, now)
    later = now + 30 * DAY
    begin_session(database, invite(None), later)
    assert holders(database, study_id, later) == {0: "P001", 1: "P002"}


def test_who_left_before_the_questionnaire_keeps_the_slot_and_frees_the_place(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    limits = {"optional_stages": ["interview"], "limits": {"under_way": 1, "finished": 1}}
    with database.writing() as connection:
        connection.execute(update(study).values(options=limits))
    vote_on(database, begin_session(database, invite(None), now), 6, now)
    with pytest.raises(ClosedError):
        begin_session(database, invite(None), now + timedelta(hours=23))
    later = now + timedelta(hours=25)
    begin_session(database, invite(None), later)
    assert holders(database, study_id, later) == {0: "P001", 1: "P002"}


def test_the_slot_of_who_withdraws_is_given_out_at_once(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    _, token, _ = (begin_session(database, invite(None), now) for _ in range(3))
    with database.reading() as connection:
        of = session_by_token(connection, token)
    assert of is not None
    withdraw(database, of, now)
    begin_session(database, invite(None), now)
    begin_session(database, invite(None), now)
    assert holders(database, study_id, now) == {0: "P001", 1: "P004", 2: "P003", 3: "P005"}


def test_the_slot_of_who_is_screened_out_is_given_out_at_once(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    begin_session(database, invite(None), now)
    with database.writing() as connection:
        connection.execute(update(session).values(stage=SCREENED_OUT))
    begin_session(database, invite(None), now)
    assert holders(database, study_id, now) == {0: "P002"}


def test_a_study_says_itself_after_how_many_hours_a_slot_is_abandoned(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    with database.writing() as connection:
        connection.execute(update(study).values(options={"abandoned_after_h": 0.5}))
    begin_session(database, invite(None), now)
    begin_session(database, invite(None), now + timedelta(minutes=29))
    begin_session(database, invite(None), now + timedelta(minutes=31))
    assert holders(database, study_id, now) == {0: "P003", 1: "P002"}


def test_nobody_is_taken_for_silent_or_late_because_the_clock_was_set(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(orders_of_trials, "this_start", steady_clock.this_start)
    with database.writing() as connection:
        connection.execute(update(study).values(options={"limits": {"minutes": 60}}))
    begin_session(database, invite(None), now)
    begin_session(database, invite(None), now + 2 * DAY)
    assert holders(database, study_id, now + 2 * DAY) == {0: "P001", 1: "P002"}
    with database.writing() as connection:
        connection.execute(update(session).values(running_s=steady_clock.running_s() - 3601))
    begin_session(database, invite(None), now - 2 * DAY)
    assert holders(database, study_id, now - 2 * DAY)[0] == "P003"


def test_slots_that_were_given_up_are_given_out_once_when_all_begin_at_once(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    invitation = invite(None)
    for _ in range(4):
        begin_session(database, invitation, now)
    later = now + 2 * DAY
    barrier = threading.Barrier(8)

    def begin() -> None:
        barrier.wait()
        begin_session(database, invitation, later)

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(holders(database, study_id, later)) == list(range(8))
    assert len(orders(database, study_id, later)) == 12


def test_the_report_finds_stored_orders_balanced_and_a_changed_one_not(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    with database.writing() as connection:
        connection.execute(update(study).values(options={"both_orders": True, "repeated_pairs": 1}))
    for step in range(9):
        begin_session(database, invite(None), now + step * DAY / 6)

    def is_ok() -> bool:
        with database.reading() as connection:
            of = study_by_id(connection, study_id)
            assert of is not None
            return bool(balance_report(study_plan(connection, of), taken_orders(connection, of, now))["ok"])

    assert is_ok()
    with database.writing() as connection:
        one = select(assignment.c.id).join(participant).where(assignment.c.first_shown == "a").limit(1)
        connection.execute(update(assignment).where(assignment.c.id == one.scalar_subquery()).values(first_shown="b"))
    assert not is_ok()


def test_an_adaptive_study_shows_the_pairs_that_the_votes_so_far_ask_for(
    database: Database, study_id: int, invite: MakeInvitation, now: datetime
) -> None:
    with database.writing() as connection:
        connection.execute(update(study).values(options={"adaptive_pairs": 1}))
    invitation = invite(None)
    vote_on(database, begin_session(database, invitation, now), 2, now)
    begin_session(database, invitation, now)
    first, second = orders(database, study_id, now)
    assert len(first.trials) == len(second.trials) == 2  # one of each dataset
    assert not {trial.pair for trial in first.trials} & {trial.pair for trial in second.trials}
    with database.reading() as connection:
        of = study_by_id(connection, study_id)
        assert of is not None
        report = balance_report(study_plan(connection, of), [first, second])
    assert [rule for rule in report["rules"] if not rule["ok"] and rule["of"] == "each"] == []

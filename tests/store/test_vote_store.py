"""A vote is counted once, whatever the network does."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from typing import Any
from uuid import uuid4

import pytest
from sqlalchemy import func, select

from app.errors import ConflictError, InvalidError, NotFoundError
from app.store.engine import Database
from app.store.invitations import Invitation
from app.store.sessions import Session, begin_session, complete_stage, session_by_token
from app.store.tables import session, vote
from app.store.trials import NextTrial, mark_served, next_trials, trial_records
from app.store.votes import KeptVote, keep_vote, vote_records
from app.study.votes import Vote

MakeInvitation = Callable[[int | None], Invitation]


@pytest.fixture
def of(database: Database, invite: MakeInvitation, now: datetime) -> Session:
    token = begin_session(database, invite(None), now)
    with database.reading() as connection:
        found = session_by_token(connection, token)
    assert found is not None
    complete_stage(database, found, "introduction", {}, now)
    return found


def serve_next(database: Database, of: Session, now: datetime) -> NextTrial:
    with database.reading() as connection:
        trial = next_trials(connection, of.id)[0]
    mark_served(database, [trial.id], now)
    return trial


def vote_on(trial: NextTrial, **changes: Any) -> Vote:
    viewing = {"first_shown": trial.first_shown, "shown_ms": 1000.0, "response_ms": 12.5, "switches": []}
    return replace(Vote(str(uuid4()), "a", viewing), **changes)


def n_votes(database: Database) -> int:
    with database.reading() as connection:
        return connection.scalar(select(func.count()).select_from(vote)) or 0


def test_a_vote_is_counted_once_when_it_is_sent_twice(database: Database, of: Session, now: datetime) -> None:
    trial = serve_next(database, of, now)
    sent = vote_on(trial)
    first, second = (keep_vote(database, of, trial.public_id, sent, now) for _ in range(2))
    assert first.is_new
    assert not second.is_new
    assert replace(second, is_new=True) == first
    assert n_votes(database) == 1


def test_a_vote_is_counted_once_when_it_is_sent_many_times_at_once(
    database: Database, of: Session, now: datetime
) -> None:
    trial = serve_next(database, of, now)
    sent = vote_on(trial)
    kept: list[KeptVote] = []
    barrier = threading.Barrier(8)

    def send() -> None:
        barrier.wait()
        kept.append(keep_vote(database, of, trial.public_id, sent, now))

    threads = [threading.Thread(target=send) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert Counter(one.is_new for one in kept) == {True: 1, False: 7}
    assert n_votes(database) == 1


def test_a_second_vote_on_a_trial_is_refused(database: Database, of: Session, now: datetime) -> None:
    trial = serve_next(database, of, now)
    sent = vote_on(trial)
    keep_vote(database, of, trial.public_id, sent, now)
    for other in (vote_on(trial), replace(sent, choice="b"), vote_on(trial, client_id=sent.client_id, choice="none")):
        with pytest.raises(ConflictError, match="has a vote already"):
            keep_vote(database, of, trial.public_id, other, now)
    with database.reading() as connection:
        assert connection.scalar(select(vote.c.choice)) == "a"


def test_a_votes_id_cannot_serve_for_another_trial(database: Database, of: Session, now: datetime) -> None:
    first = serve_next(database, of, now)
    sent = vote_on(first)
    keep_vote(database, of, first.public_id, sent, now)
    second = serve_next(database, of, now)
    with pytest.raises(ConflictError, match="belongs to another vote"):
        keep_vote(database, of, second.public_id, vote_on(second, client_id=sent.client_id), now)


def test_a_trial_of_somebody_else_does_not_exist(
    database: Database, of: Session, invite: MakeInvitation, now: datetime
) -> None:
    trial = serve_next(database, of, now)
    token = begin_session(database, invite(None), now)
    with database.reading() as connection:
        other = session_by_token(connection, token)
    assert other is not None
    with pytest.raises(NotFoundError):
        keep_vote(database, other, trial.public_id, vote_on(trial), now)


def test_a_trial_that_was_not_given_out_takes_no_vote(database: Database, of: Session, now: datetime) -> None:
    with database.reading() as connection:
        following = next_trials(connection, of.id)[1]
    with pytest.raises(ConflictError, match="not been given out"):
        keep_vote(database, of, following.public_id, vote_on(following), now)


def test_a_vote_that_contradicts_its_trial_is_not_kept(database: Database, of: Session, now: datetime) -> None:
    trial = serve_next(database, of, now)
    wrong = dict(vote_on(trial).viewing) | {"first_shown": "b" if trial.first_shown == "a" else "a"}
    with pytest.raises(InvalidError, match="first_shown"):
        keep_vote(database, of, trial.public_id, vote_on(trial, viewing=wrong), now)
    assert n_votes(database) == 0


def test_the_last_vote_ends_the_session(database: Database, of: Session, study_id: int, now: datetime) -> None:
    stages = []
    for _ in range(6):
        trial = serve_next(database, of, now)
        keep_vote(database, of, trial.public_id, vote_on(trial), now)
        with database.reading() as connection:
            stages.append(connection.scalar(select(session.c.stage)))
    assert stages == ["trial"] * 5 + ["finished"]
    with database.reading() as connection:
        assert next_trials(connection, of.id) == []
        assert connection.scalar(select(session.c.finished_at)) == now
        assert len(list(vote_records(connection, study_id))) == 6


def test_an_exported_vote_names_what_was_behind_the_labels(
    database: Database, of: Session, study_id: int, now: datetime
) -> None:
    trial = serve_next(database, of, now)
    keep_vote(database, of, trial.public_id, vote_on(trial, choice="b"), now)
    with database.reading() as connection:
        (exported,) = vote_records(connection, study_id)
        planned = next(row for row in trial_records(connection, study_id) if row["trial"] == trial.public_id)
    assert exported["choice"] == "b"
    assert exported["response_ms"] == 12.5
    for column in ("participant", "dataset", "item_a", "item_b", "first_shown"):
        assert exported[column] == planned[column]
    assert exported["first_shown"] == exported["item_a" if trial.first_shown == "a" else "item_b"]

"""One writer, one commit for all that wait, and no answer before it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace

import pytest
from ballots import Participant, ballot_of, let_in, n_votes, serve_trials
from sqlalchemy import event

from app.errors import UnavailableError
from app.store.engine import Database
from app.store.invitations import Invitation
from app.store.vote_writer import VoteWriter
from app.store.votes import Ballot, KeptVote

MakeInvitation = Callable[[int | None], Invitation]
TIMEOUT_S = 10


@pytest.fixture
def of(database: Database, invite: MakeInvitation) -> Participant:
    return let_in(database, invite(None))


@pytest.fixture
def ballots(database: Database, of: Participant) -> list[Ballot]:
    return [ballot_of(of, trial) for trial in serve_trials(database, of, 6)]


@pytest.fixture
def commits(database: Database) -> Iterator[list[bool]]:
    """For each commit whether every answer of `futures` was still open."""
    found: list[bool] = []

    def note(_connection: object) -> None:
        found.append(not any(future.done() for future in FUTURES))

    event.listen(database.engine, "commit", note)
    yield found
    event.remove(database.engine, "commit", note)
    FUTURES.clear()


FUTURES: list[Future[KeptVote]] = []


def test_all_that_wait_are_kept_by_one_commit_and_answered_after_it(
    database: Database, ballots: list[Ballot], commits: list[bool]
) -> None:
    writer = VoteWriter(database)
    FUTURES.extend(writer.submit(ballot) for ballot in ballots)
    assert writer.n_waiting == 6
    with writer:
        assert all(future.result(TIMEOUT_S).is_new for future in FUTURES)
    assert commits == [True]
    assert n_votes(database) == 6


def test_a_row_that_no_database_takes_fails_alone(database: Database, ballots: list[Ballot]) -> None:
    ballots[2] = replace(ballots[2], sent=replace(ballots[2].sent, choice="neither"))  # refused by a CHECK, or too long
    writer = VoteWriter(database)
    answers = [writer.submit(ballot) for ballot in ballots]
    with writer:
        errors = [answer.exception(TIMEOUT_S) for answer in answers]
    assert [error is None for error in errors] == [True] * 2 + [False] + [True] * 3
    assert n_votes(database) == 5


def test_who_comes_to_a_full_queue_is_told_to_come_again(database: Database, ballots: list[Ballot]) -> None:
    writer = VoteWriter(database, most_waiting=2)
    waiting = [writer.submit(ballot) for ballot in ballots[:2]]
    with pytest.raises(UnavailableError, match="sent again"):
        writer.submit(ballots[2])
    with writer:
        for answer in waiting:
            answer.result(TIMEOUT_S)
        assert writer.submit(ballots[2]).result(TIMEOUT_S).is_new


def test_what_waits_at_the_end_is_kept_and_later_votes_are_refused(database: Database, ballots: list[Ballot]) -> None:
    with VoteWriter(database) as writer:
        answers = [writer.submit(ballot) for ballot in ballots]
    assert all(answer.done() for answer in answers)
    assert n_votes(database) == 6
    with pytest.raises(UnavailableError):
        writer.submit(ballots[0])


def test_who_went_away_is_no_trouble_to_others(database: Database, ballots: list[Ballot]) -> None:
    writer = VoteWriter(database)
    first, second = (writer.submit(ballot) for ballot in ballots[:2])
    assert first.cancel()
    with writer:
        assert second.result(TIMEOUT_S).is_new
    assert n_votes(database) == 1

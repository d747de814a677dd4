"""One writer, one commit for all that wait, and no answer before it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import pytest
from anyio.lowlevel import checkpoint
from sqlalchemy import event

from app.errors import UnavailableError
from app.store.database.engine import Database
from app.store.participants.invitations import Invitation
from app.store.trials.vote_records import KeptVote, Vote
from app.store.trials.vote_writer import VoteWriter
from tests.app.store.voting import Participant, let_in, n_votes, serve_trials, vote_on

MakeInvitation = Callable[[int | None], Invitation]
TIMEOUT_S = 60


@pytest.fixture
def of(database: Database, invite: MakeInvitation) -> Participant:
    return let_in(database, invite(None))


@pytest.fixture
def votes(database: Database, of: Participant) -> list[Vote]:
    return [vote_on(trial, of.token) for trial in serve_trials(database, of, 6)]


def submit(writer: VoteWriter, votes: Sequence[Vote]) -> list[Future[KeptVote]]:
    return [writer.submit(vote) for vote in votes]


def are_new(answers: Sequence[Future[KeptVote]]) -> bool:
    return all(answer.result(TIMEOUT_S).is_new for answer in answers)


@contextmanager
def watched_commits(database: Database, watch: Callable[[], None]) -> Iterator[None]:
    def on_commit(_connection: object) -> None:
        watch()

    event.listen(database.engine, "commit", on_commit)
    yield
    event.remove(database.engine, "commit", on_commit)


def test_all_that_wait_are_kept_by_one_commit_and_answered_after_it(database: Database, votes: list[Vote]) -> None:
    writer = VoteWriter(database)
    answers = submit(writer, votes)
    assert writer.n_waiting == 6
    were_open: list[bool] = []  # at each commit
    with watched_commits(database, lambda: were_open.append(not any(answer.done() for answer in answers))), writer:
        assert are_new(answers)
    assert were_open == [True]
    assert n_votes(database) == 6


def test_votes_that_arrive_during_a_commit_share_the_next(database: Database, votes: list[Vote]) -> None:
    has_begun, may_end, n_commits = threading.Event(), threading.Event(), 0

    def hold() -> None:
        nonlocal n_commits
        n_commits += 1
        has_begun.set()
        assert may_end.wait(TIMEOUT_S)

    with watched_commits(database, hold), VoteWriter(database) as writer:
        first = submit(writer, votes[:1])
        assert has_begun.wait(TIMEOUT_S)
        others = submit(writer, votes[1:])
        may_end.set()
        assert are_new(first + others)
    assert n_commits == 2


def test_a_row_that_no_database_takes_fails_alone(database: Database, votes: list[Vote]) -> None:
    votes[2] = replace(votes[2], choice="neither")  # type: ignore[arg-type]  # refused by a CHECK, or too long
    writer = VoteWriter(database)
    answers = submit(writer, votes)
    with writer:
        assert [answer.exception(TIMEOUT_S) is None for answer in answers] == [True] * 2 + [False] + [True] * 3
    assert n_votes(database) == 5


def test_who_comes_to_a_full_queue_is_told_to_come_again(database: Database, votes: list[Vote]) -> None:
    writer = VoteWriter(database, most_waiting=2)
    waiting = submit(writer, votes[:2])
    with pytest.raises(UnavailableError, match="sent again"):
        writer.submit(votes[2])
    with writer:
        assert are_new(waiting)
        assert are_new(submit(writer, votes[2:3]))


def test_what_waits_at_the_end_is_kept_and_later_votes_are_refused(database: Database, votes: list[Vote]) -> None:
    with VoteWriter(database) as writer:
        answers = submit(writer, votes)
    assert n_votes(database) == 6
    assert are_new(answers)
    with pytest.raises(UnavailableError):
        writer.submit(votes[0])


def test_a_vote_whose_sender_went_away_is_kept_and_no_trouble_to_others(database: Database, votes: list[Vote]) -> None:
    """As a request that is cancelled, and one whose event loop ends, leave their answers."""
    writer = VoteWriter(database)

    async def ask_and_leave() -> None:
        answer = asyncio.wrap_future(writer.submit(votes[0]))
        answer.cancel()
        await checkpoint()
        asyncio.wrap_future(writer.submit(votes[1]))

    with ThreadPoolExecutor(1) as pool:  # the browser tests leave an event loop in this one
        pool.submit(asyncio.run, ask_and_leave()).result()
    answers = submit(writer, votes[2:])
    with writer:
        assert are_new(answers)
    assert n_votes(database) == 6

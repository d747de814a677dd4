"""One writer, one commit for all that wait, and no answer before it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from anyio.from_thread import BlockingPortal, start_blocking_portal
from anyio.lowlevel import checkpoint
from sqlalchemy import event

from app.errors import UnavailableError
from app.store import vote_writer
from app.store.engine import Database
from app.store.invitations import Invitation
from app.store.vote_records import Ballot, KeptVote
from app.store.vote_writer import Answer, VoteWriter
from tests.app.store.voting import Participant, ballot_of, let_in, n_votes, serve_trials

MakeInvitation = Callable[[int | None], Invitation]
TIMEOUT_S = 10


@pytest.fixture
def of(database: Database, invite: MakeInvitation) -> Participant:
    return let_in(database, invite(None))


@pytest.fixture
def ballots(database: Database, of: Participant) -> list[Ballot]:
    return [ballot_of(of, trial) for trial in serve_trials(database, of, 6)]


@pytest.fixture
def loop() -> Iterator[BlockingPortal]:
    """Where those who send votes wait for their answers."""
    with start_blocking_portal() as portal:
        yield portal


async def submit(writer: VoteWriter, ballots: list[Ballot]) -> list[Answer]:
    return [writer.submit(ballot) for ballot in ballots]


async def outcomes(answers: list[Answer]) -> list[KeptVote | BaseException]:
    return await asyncio.wait_for(asyncio.gather(*answers, return_exceptions=True), TIMEOUT_S)


def are_new(votes: list[KeptVote | BaseException]) -> bool:
    return all(isinstance(vote, KeptVote) and vote.is_new for vote in votes)


def test_all_that_wait_are_kept_by_one_commit_and_answered_after_it(
    database: Database, ballots: list[Ballot], loop: BlockingPortal
) -> None:
    writer = VoteWriter(database)
    answers = loop.call(submit, writer, ballots)
    assert writer.n_waiting == 6
    were_open: list[bool] = []  # at each commit

    def note(_connection: object) -> None:
        were_open.append(not any(answer.done() for answer in answers))

    event.listen(database.engine, "commit", note)
    with writer:
        assert are_new(loop.call(outcomes, answers))
    event.remove(database.engine, "commit", note)
    assert were_open == [True]
    assert n_votes(database) == 6


def test_a_row_that_no_database_takes_fails_alone(
    database: Database, ballots: list[Ballot], loop: BlockingPortal
) -> None:
    ballots[2] = replace(ballots[2], sent=replace(ballots[2].sent, choice="neither"))  # refused by a CHECK, or too long
    writer = VoteWriter(database)
    answers = loop.call(submit, writer, ballots)
    with writer:
        found = loop.call(outcomes, answers)
    assert [isinstance(outcome, KeptVote) for outcome in found] == [True] * 2 + [False] + [True] * 3
    assert n_votes(database) == 5


def test_who_comes_to_a_full_queue_is_told_to_come_again(
    database: Database, ballots: list[Ballot], loop: BlockingPortal
) -> None:
    writer = VoteWriter(database, most_waiting=2)
    waiting = loop.call(submit, writer, ballots[:2])
    with pytest.raises(UnavailableError, match="sent again"):
        loop.call(submit, writer, ballots[2:3])
    with writer:
        assert are_new(loop.call(outcomes, waiting))
        assert are_new(loop.call(outcomes, loop.call(submit, writer, ballots[2:3])))


def test_what_waits_at_the_end_is_kept_and_later_votes_are_refused(
    database: Database, ballots: list[Ballot], loop: BlockingPortal
) -> None:
    with VoteWriter(database) as writer:
        answers = loop.call(submit, writer, ballots)
    assert n_votes(database) == 6
    assert are_new(loop.call(outcomes, answers))
    with pytest.raises(UnavailableError):
        loop.call(submit, writer, ballots[:1])


def test_who_went_away_is_no_trouble_to_others(database: Database, ballots: list[Ballot], loop: BlockingPortal) -> None:
    writer = VoteWriter(database)
    first, second = loop.call(submit, writer, ballots[:2])
    assert loop.call(first.cancel)
    with writer:
        assert are_new(loop.call(outcomes, [second]))
    assert n_votes(database) == 2


def test_a_loop_that_has_ended_is_no_trouble_to_others(
    database: Database, ballots: list[Ballot], loop: BlockingPortal
) -> None:
    writer = VoteWriter(database)

    def submit_and_end() -> None:
        brief = asyncio.new_event_loop()
        brief.run_until_complete(submit(writer, ballots[:1]))
        brief.close()

    with ThreadPoolExecutor(1) as pool:
        pool.submit(submit_and_end).result()
    answers = loop.call(submit, writer, ballots[1:])
    with writer:
        assert are_new(loop.call(outcomes, answers))
    assert n_votes(database) == 6


def test_votes_that_arrive_at_once_share_a_commit_also_while_the_writer_is_idle(
    database: Database, ballots: list[Ballot], loop: BlockingPortal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(vote_writer, "LONGEST_GATHERING_S", TIMEOUT_S)  # on a busy machine a turn may take long
    n_commits = 0

    def count(_connection: object) -> None:
        nonlocal n_commits
        n_commits += 1

    async def submit_in_turns() -> list[KeptVote | BaseException]:
        answers = []
        for ballot in ballots:
            answers.append(writer.submit(ballot))
            await checkpoint()  # the next one is read in the next turn of the loop
        return await outcomes(answers)

    with VoteWriter(database) as writer:
        event.listen(database.engine, "commit", count)
        assert are_new(loop.call(submit_in_turns))
        event.remove(database.engine, "commit", count)
    assert n_commits == 1

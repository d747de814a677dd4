"""The one writer of votes in a process: what arrives together, or while it writes, is kept in one transaction.

A sync of the disk costs the same for one vote as for hundreds, and nobody is answered before theirs is over. Writer and
event loop hinder each other when both run (one at a time holds the interpreter), so a batch begins when the loop has
read what there was to read: it waits for some turns of the loop, not for some time.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType
from typing import NamedTuple

from app.errors import UnavailableError
from app.store.engine import Database
from app.store.vote_records import Ballot, KeptVote, keep_votes

log = logging.getLogger(__name__)

MOST_WAITING = 2000  # some tenths of a second of work; whoever comes later is told to come again
LARGEST_BATCH = 256  # beyond it a transaction gains nothing, and a bad row costs more (bench/server.py)
FEW = 4  # votes in a batch: the next waits for no others, as a turn of a loop that sends video takes milliseconds
QUIET_TURNS = 2  # of an event loop: in the first a request is read, in the second its vote is queued
LONGEST_GATHERING_S = 0.01  # where votes never cease to arrive
RETURN_S = 0.001  # so long after an answer its participant's next vote may come, to be kept with those that wait

Answer = asyncio.Future[KeptVote]
Outcome = KeptVote | Exception


class _Waiting(NamedTuple):
    ballot: Ballot
    answer: Answer


class VoteWriter:
    """Keeps votes while the block runs; at its end those that wait are kept, later ones refused."""

    def __init__(self, database: Database, *, most_waiting: int = MOST_WAITING) -> None:
        self._database = database
        self._most_waiting = most_waiting
        self._waiting: deque[_Waiting] = deque()
        self._changed = threading.Condition()
        self._is_closed = False
        self._gathering: asyncio.AbstractEventLoop | None = None
        self._n_answered = 0
        self._thread = threading.Thread(target=self._run, name="vote-writer", daemon=True)

    def __enter__(self) -> VoteWriter:
        self._thread.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join()

    def submit(self, ballot: Ballot) -> Answer:
        """Queue a vote; the answer comes once it is on disk, or is the error of `keep_votes`.

        Whoever asks runs an event loop. A vote whose answer nobody waits for any more is kept all the same.

        Raises
        ------
        UnavailableError
            If too many wait, or the writer has ended.
        """
        loop = asyncio.get_running_loop()
        answer: Answer = loop.create_future()
        with self._changed:
            if self._is_closed or len(self._waiting) >= self._most_waiting:
                raise UnavailableError("Too much arrives at once. Your answer is kept in your browser and sent again.")
            self._waiting.append(_Waiting(ballot, answer))
            n_waiting, is_first = len(self._waiting), self._gathering is None or self._gathering.is_closed()
            if is_first:
                self._gathering = loop
        if is_first:
            n_turns = QUIET_TURNS if self._n_answered > FEW else 0
            loop.call_soon(self._gather, loop, n_waiting, n_turns, time.monotonic() + LONGEST_GATHERING_S)
        return answer

    @property
    def n_waiting(self) -> int:
        return len(self._waiting)

    def _gather(self, loop: asyncio.AbstractEventLoop, n_before: int, n_turns: int, until_s: float) -> None:
        """Let the writer begin once the event loop brings no further vote for some turns."""
        n_waiting = len(self._waiting)
        if n_turns:
            n_turns = n_turns - 1 if n_waiting == n_before else QUIET_TURNS
        if n_turns and n_waiting < LARGEST_BATCH and time.monotonic() < until_s:
            loop.call_soon(self._gather, loop, n_waiting, n_turns, until_s)
            return
        with self._changed:
            self._gathering = None
            self._changed.notify()

    def _run(self) -> None:
        while batch := self._next_batch():
            _deliver(list(zip(batch, self._outcomes([waiting.ballot for waiting in batch]), strict=True)))

    def _next_batch(self) -> list[_Waiting]:
        """What waits, as soon as anything does; nothing at the end."""
        with self._changed:
            self._changed.wait_for(self._has_gathered)
            if len(self._waiting) < self._n_answered:  # most are with those who have just been answered
                self._changed.wait_for(lambda: self._is_closed, RETURN_S)
                self._changed.wait_for(self._has_gathered)
            self._n_answered = len(self._waiting)
            return [self._waiting.popleft() for _ in range(min(len(self._waiting), LARGEST_BATCH))]

    def _has_gathered(self) -> bool:
        return self._is_closed or (bool(self._waiting) and self._gathering is None)

    def _outcomes(self, ballots: Sequence[Ballot]) -> Sequence[Outcome]:
        try:
            return keep_votes(self._database, ballots)
        except UnavailableError as error:
            return [error] * len(ballots)
        except Exception as error:  # a row that no database takes must not fail its neighbours
            if len(ballots) == 1:
                return [error]
            log.warning(
                "a vote cannot be kept (%s); its batch of %d is kept one by one", type(error).__name__, len(ballots)
            )
            return [outcome for ballot in ballots for outcome in self._outcomes([ballot])]


def _deliver(outcomes: Sequence[tuple[_Waiting, Outcome]]) -> None:
    """Wake each event loop once for all of its answers: waking it for every single one costs more than the vote."""
    of_loop: dict[asyncio.AbstractEventLoop, list[tuple[Answer, Outcome]]] = {}
    for waiting, outcome in outcomes:
        of_loop.setdefault(waiting.answer.get_loop(), []).append((waiting.answer, outcome))
    for loop, answers in of_loop.items():
        with suppress(RuntimeError):  # the loop is closed: nobody waits there
            loop.call_soon_threadsafe(_answer, answers)


def _answer(answers: Sequence[tuple[Answer, Outcome]]) -> None:
    for answer, outcome in answers:
        if answer.done():  # whoever asked went away
            continue
        if isinstance(outcome, KeptVote):
            answer.set_result(outcome)
        else:
            answer.set_exception(outcome)

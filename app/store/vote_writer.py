"""The one writer of votes in a process: what arrives while it writes is kept together in the next transaction.

A sync of the disk costs the same for one vote as for hundreds, and nobody is answered before theirs is over.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from types import TracebackType
from typing import NamedTuple

from app.errors import UnavailableError
from app.store.engine import Database
from app.store.votes import Ballot, KeptVote, keep_votes

log = logging.getLogger(__name__)

MOST_WAITING = 2000  # some tenths of a second of work; whoever comes later is told to come again
LARGEST_BATCH = 256  # beyond it a transaction gains nothing, and a bad row costs more (bench/server.py)


class _Waiting(NamedTuple):
    ballot: Ballot
    answer: Future[KeptVote]


class VoteWriter:
    """Keeps votes while the block runs; at its end those that wait are kept, later ones refused."""

    def __init__(self, database: Database, *, most_waiting: int = MOST_WAITING) -> None:
        self._database = database
        self._most_waiting = most_waiting
        self._waiting: deque[_Waiting] = deque()
        self._changed = threading.Condition()
        self._is_closed = False
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

    def submit(self, ballot: Ballot) -> Future[KeptVote]:
        """Queue a vote; the answer comes once it is on disk, or is the error of `keep_votes`.

        Raises
        ------
        UnavailableError
            If too many wait, or the writer has ended.
        """
        answer: Future[KeptVote] = Future()
        with self._changed:
            if self._is_closed or len(self._waiting) >= self._most_waiting:
                raise UnavailableError("Too much arrives at once. Your answer is kept in your browser and sent again.")
            self._waiting.append(_Waiting(ballot, answer))
            self._changed.notify()
        return answer

    @property
    def n_waiting(self) -> int:
        return len(self._waiting)

    def _run(self) -> None:
        while batch := self._next_batch():
            self._answer([waiting for waiting in batch if waiting.answer.set_running_or_notify_cancel()])

    def _next_batch(self) -> list[_Waiting]:
        """What waits, as soon as anything does; nothing at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._is_closed)
            return [self._waiting.popleft() for _ in range(min(len(self._waiting), LARGEST_BATCH))]

    def _answer(self, batch: Sequence[_Waiting]) -> None:
        for waiting, outcome in zip(batch, self._outcomes(batch), strict=True):
            if isinstance(outcome, KeptVote):
                waiting.answer.set_result(outcome)
            else:
                waiting.answer.set_exception(outcome)

    def _outcomes(self, batch: Sequence[_Waiting]) -> Sequence[KeptVote | Exception]:
        try:
            return keep_votes(self._database, [waiting.ballot for waiting in batch])
        except UnavailableError as error:
            return [error] * len(batch)
        except Exception as error:  # a row that no database takes must not fail its neighbours
            if len(batch) == 1:
                return [error]
            log.warning(
                "a vote cannot be kept (%s); its batch of %d is kept one by one", type(error).__name__, len(batch)
            )
            return [outcome for waiting in batch for outcome in self._outcomes([waiting])]

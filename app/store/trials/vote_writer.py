"""Write votes, by one writer in a process: whatever waits while it writes is kept together by its next transaction.

A sync of the disk costs the same for one vote as for hundreds, and nobody is answered before theirs is over.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from types import TracebackType

from app.errors import UnavailableError
from app.store.database.engine import Database
from app.store.trials.vote_records import KeptVote, Vote, keep_votes

log = logging.getLogger(__name__)

MOST_WAITING = 2000  # some seconds of work; whoever comes later is told to come again
LARGEST_BATCH = 256  # beyond it a transaction gains nothing, and a bad row costs more (bench/server.py)


class VoteWriter:
    """Keeps votes while the block runs; at its end it keeps those that wait and refuses later ones."""

    def __init__(self, database: Database, *, most_waiting: int = MOST_WAITING) -> None:
        self._database = database
        self._most_waiting = most_waiting
        self._waiting: deque[tuple[Vote, Future[KeptVote]]] = deque()
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

    def submit(self, vote: Vote) -> Future[KeptVote]:
        """Queue a vote; the answer comes once it is on disk, or is the error of `keep_votes`.

        Raises
        ------
        UnavailableError
            If too many wait, or the writer has ended.
        """
        answer: Future[KeptVote] = Future()
        answer.set_running_or_notify_cancel()  # a vote whose sender goes away is kept all the same
        with self._changed:
            if self._is_closed or len(self._waiting) >= self._most_waiting:
                raise UnavailableError("Too much arrives at once. Your answer is kept in your browser and sent again.")
            self._waiting.append((vote, answer))
            self._changed.notify()
        return answer

    @property
    def n_waiting(self) -> int:
        return len(self._waiting)

    def _run(self) -> None:
        while batch := self._next_batch():
            outcomes = self._outcomes([vote for vote, _ in batch])
            for (_, answer), outcome in zip(batch, outcomes, strict=True):
                if isinstance(outcome, KeptVote):
                    answer.set_result(outcome)
                else:
                    answer.set_exception(outcome)

    def _next_batch(self) -> list[tuple[Vote, Future[KeptVote]]]:
        """Wait for votes and take them; nothing comes after the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._is_closed)
            return [self._waiting.popleft() for _ in range(min(len(self._waiting), LARGEST_BATCH))]

    def _outcomes(self, votes: Sequence[Vote]) -> Sequence[KeptVote | Exception]:
        try:
            return keep_votes(self._database, votes)
        except UnavailableError as error:
            return [error] * len(votes)
        except Exception as error:  # a row that no database takes must not fail its neighbours
            if len(votes) == 1:
                return [error]
            log.warning("a vote cannot be kept (%s): its batch of %d goes one by one", type(error).__name__, len(votes))
            return [outcome for vote in votes for outcome in self._outcomes([vote])]

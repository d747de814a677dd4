"""Compute participants' flags (unusual votes) in a background thread, as many votes take seconds."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from types import TracebackType

from app.store.database.engine import Database
from app.store.trials.counted_votes import VoteState
from app.web.analyst.results import analysis_of, rows_of

AT_MOST_EVERY = timedelta(seconds=10)  # between computations for a study; votes come more often
PATIENCE_S = 0.5  # a page waits so long for flags, as it should appear within a second

LONG_AGO = datetime.min.replace(tzinfo=UTC)

FlagsOf = Mapping[str, tuple[str, ...]]


@dataclass
class _Known:
    """The flags of a study, and the votes from which they were computed."""

    flags: FlagsOf = field(default_factory=dict)
    votes: VoteState | None = None  # None: there is no computation, or it failed
    work: Future[FlagsOf] | None = None
    begun_at: datetime = LONG_AGO
    again_at: datetime = LONG_AGO


class Flags:
    """Flags by study, shared by all pages; studies are computed in turn, which leaves time for other requests."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._known: dict[int, _Known] = {}
        self._lock = threading.Lock()
        self._worker = ThreadPoolExecutor(1, "reconstudy-flags")

    def __enter__(self) -> Flags:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._worker.shutdown(cancel_futures=True)

    def of(self, study_id: int, votes: VoteState, now: datetime, patience_s: float = 0.0) -> FlagsOf:
        """Return the present flags by participant; compute newer ones if something has changed.

        Parameters
        ----------
        votes : their state now
        patience_s : how long to wait for newer flags
        """
        with self._lock:
            known = self._known.setdefault(study_id, _Known())
            self._compute_again(study_id, known, votes, now)
            work = known.work
        if work is not None:
            wait([work], patience_s)
        with self._lock:
            return self._finished(known, now)

    def is_computing(self, study_id: int) -> bool:
        """Are newer flags being computed?"""
        with self._lock:
            known = self._known.get(study_id)
            return known is not None and known.work is not None and not known.work.done()

    def _compute_again(self, study_id: int, known: _Known, votes: VoteState, now: datetime) -> None:
        if known.work is None and votes.n_votes and votes != known.votes and now >= known.again_at:
            known.votes, known.begun_at = votes, now
            known.work = self._worker.submit(_compute, self._database, study_id)

    def _finished(self, known: _Known, now: datetime) -> FlagsOf:
        if known.work is not None and known.work.done():
            work, known.work = known.work, None
            known.again_at = now + max(AT_MOST_EVERY, now - known.begun_at)  # then rest as long as the work took
            if work.exception() is not None:
                known.votes = None
            known.flags = work.result()
        return known.flags


def _compute(database: Database, study_id: int) -> FlagsOf:
    analysis = analysis_of(database, study_id)
    return {row["participant"]: tuple(row["flags"]) for row in rows_of(analysis or {}, "observers")}

"""Run long work that a form starts in a thread; the database stores its progress."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from app.errors import StudyError, UnavailableError
from app.ffmpeg import Progress
from app.store.audit import Actor, Entry, record_alone
from app.store.engine import Database
from app.store.jobs import BEATS_WITHIN, beat, begin_job, end_job, fail_job, tell_progress
from app.store.keys import utc_now

TELLS_EVERY_S = 0.5
BEATS_EVERY_S = BEATS_WITHIN.total_seconds() / 4

log = logging.getLogger(__name__)


def start_job(
    database: Database,
    actor: Actor,
    title: str,
    work: Callable[[Progress], str],
    *,
    subject: str | None = None,
) -> str:
    """Start work in a thread and return the job's id; the id of the running job if the same person has just started the
    same.

    Parameters
    ----------
    work : takes a function that reports progress; returns the address of the result
    subject : identifies equal work, as in `begin_job`

    Raises
    ------
    ConflictError
        If somebody else is doing the same now.
    """
    begun = begin_job(database, actor.name, title, actor.now, subject)
    if begun.is_new:
        arguments = (database, actor, title, begun.public_id, work)
        # A daemon: the server can stop at once; the next attempt reuses what the work has made.
        threading.Thread(target=_run, args=arguments, name=f"job-{begun.public_id}", daemon=True).start()
    return begun.public_id


def _run(database: Database, actor: Actor, title: str, public_id: str, work: Callable[[Progress], str]) -> None:
    last_s = 0.0

    def tell(what: str, done: int, total: int) -> None:
        nonlocal last_s
        if time.monotonic() - last_s >= TELLS_EVERY_S:
            last_s = time.monotonic()
            tell_progress(database, public_id, done, total, what, utc_now())

    try:
        with _beating(database, public_id):
            made = work(tell)
        end_job(database, public_id, made, utc_now())
    except (ValueError, OSError, StudyError) as error:
        _fail(database, actor, title, public_id, str(error))
    except Exception:
        log.exception("%s failed", title)
        _fail(database, actor, title, public_id, "Something went wrong here; the server's log says what.")


@contextmanager
def _beating(database: Database, public_id: str) -> Iterator[None]:
    """Report that a job is alive while the block runs: a single step, such as a long film, may take minutes."""
    has_ended = threading.Event()

    def run() -> None:
        while not has_ended.wait(BEATS_EVERY_S):
            try:
                beat(database, public_id, utc_now())
            except UnavailableError:  # already logged; the next beat may get through
                continue

    thread = threading.Thread(target=run, name=f"beat-{public_id}", daemon=True)
    thread.start()
    try:
        yield
    finally:
        has_ended.set()
        thread.join()


def _fail(database: Database, actor: Actor, title: str, public_id: str, reason: str) -> None:
    """Record the failure before the job shows it: whoever sees it then finds the entry."""
    record_alone(database, actor.name, Entry("work failed", subject=title, detail={"reason": reason}), utc_now())
    fail_job(database, public_id, reason, utc_now())

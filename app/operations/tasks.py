"""Do in a thread of the server what takes minutes, show its progress, and take it up again after a restart.

What can be taken up again keeps what it needs in the database: its kind, and values for the function of that kind.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from typing import Any

from app.errors import ConflictError, StudyError, UnavailableError, said_on_page
from app.ffmpeg import Progress
from app.store.database.engine import Database
from app.store.database.keys import utc_now
from app.store.database.server_tasks import (
    BEATS_WITHIN,
    LONGEST_DETAIL,
    ServerTask,
    beat,
    begin_task,
    claim_lost_task,
    end_task,
    fail_task,
    is_cancelled,
    tell_progress,
)
from app.store.studies.audit import Actor, Entry, record_alone
from ground.progress import Pace, duration

TELLS_EVERY_S = 0.5
BEATS_EVERY_S = BEATS_WITHIN.total_seconds() / 4
KIND = "kind"  # names the kind of a task that can be taken up again, among what it keeps
BACK = "back"  # names the page to go back to, should it fail
CANCELLED = "It was cancelled. What was finished is kept, and used when it is started again."

Kept = Mapping[str, Any]
Work = Callable[[Progress], str]  # takes a function that reports progress; returns the address of the result

log = logging.getLogger(__name__)


def start_task(
    database: Database,
    actor: Actor,
    title: str,
    work: Work,
    *,
    subject: str | None = None,
    kept: Kept | None = None,
) -> str:
    """Start work in a thread and return the task's id; that of the running task if the same person has just started it.

    Parameters
    ----------
    work : takes a function that reports progress; returns the address of the result
    subject : identifies equal work, as in `begin_task`
    kept : by which `resume_tasks` takes it up after a restart; None: it is not

    Raises
    ------
    ConflictError
        If somebody else is doing the same now.
    """
    begun = begin_task(database, actor.name, title, actor.now, subject, kept)
    if begun.is_new:
        _start(database, actor, title, begun.public_id, work)
    return begun.public_id


def resume_tasks(
    database: Database, works: Mapping[str, Callable[[ServerTask, Progress], str]], now: datetime, *, is_alone: bool
) -> list[str]:
    """Take up the tasks whose server was stopped, and return their titles.

    Parameters
    ----------
    works : by kind, the function that does a task again; it uses what an earlier attempt has made
    now : the time
    is_alone : does this process alone serve, and has it just begun? Then every running task is lost
    """
    titles = []
    while (lost := claim_lost_task(database, list(works), now, is_alone=is_alone)) is not None:
        assert lost.work is not None, "a task of a kind keeps it"
        function = works[str(lost.work[KIND])]
        actor = Actor(0, lost.actor, now)
        log.warning("%s is taken up: its server was stopped, or a job has left it", lost.title)
        _start(database, actor, lost.title, lost.public_id, lambda tell, f=function, t=lost: f(t, tell))  # type: ignore[misc]
        titles.append(lost.title)
    return titles


def wait_for_task(public_id: str, longest_s: float) -> None:
    """Wait for the end of a task of this process, but not longer."""
    for thread in threading.enumerate():
        if thread.name == f"task-{public_id}":
            thread.join(longest_s)


def _start(database: Database, actor: Actor, title: str, public_id: str, work: Work) -> None:
    arguments = (database, actor, title, public_id, work)
    # A daemon: the server can stop at once; the next attempt reuses what the work has made.
    threading.Thread(target=_run, args=arguments, name=f"task-{public_id}", daemon=True).start()


def _run(database: Database, actor: Actor, title: str, public_id: str, work: Callable[[Progress], str]) -> None:
    last_s, pace = 0.0, Pace()

    def tell(what: str, done: int, total: int) -> None:
        nonlocal last_s
        left_s = pace.left_s(done, total, time.monotonic())
        if done == 0 or time.monotonic() - last_s >= TELLS_EVERY_S:  # a step's first part may take minutes
            last_s = time.monotonic()
            if is_cancelled(database, public_id):
                raise ConflictError(CANCELLED)
            left = "" if left_s is None else f", about {duration(left_s)} left of this step"
            tell_progress(database, public_id, done, total, what + left, utc_now())

    try:
        with _beating(database, public_id):
            made = work(tell)
        end_task(database, public_id, made, utc_now())
    except (ValueError, StudyError) as error:
        _fail(database, actor, title, public_id, said_on_page(error))
    except OSError as error:  # whose text names a path on the server
        log.warning("%s failed: %s", title, error)
        _fail(database, actor, title, public_id, f"{error.strerror or error}. The server's log names the file.")
    except Exception:
        log.exception("%s failed", title)
        _fail(database, actor, title, public_id, "Something went wrong here; the server's log says what.")


@contextmanager
def _beating(database: Database, public_id: str) -> Iterator[None]:
    """Report that a task is alive while the block runs: a single step, such as a long film, may take minutes."""
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
    """Record the failure before the task shows it: whoever sees it then finds the entry."""
    told = {"reason": reason[:LONGEST_DETAIL]}
    record_alone(database, actor.name, Entry("work failed", subject=title, detail=told), utc_now())
    fail_task(database, public_id, reason, utc_now())

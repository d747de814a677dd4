"""Long work that a form starts: in a thread of its own, which tells the database how far it is."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from fastapi import Request

from app.errors import StudyError
from app.store.audit import Actor, Entry, record_alone
from app.store.engine import Database
from app.store.jobs import begin_job, end_job, fail_job, tell_progress
from app.store.keys import utc_now

TELLS_EVERY_S = 0.5

log = logging.getLogger(__name__)

Tell = Callable[[int, int, str], None]  # done, total, what


def start_job(request: Request, database: Database, actor: Actor, title: str, work: Callable[[Tell], str]) -> str:
    """Start some work and return the job's id.

    Parameters
    ----------
    work : is told with what to tell its progress; returns the address of what it made
    """
    public_id = begin_job(database, actor.name, title, actor.now)
    thread = threading.Thread(target=_run, args=(database, actor, title, public_id, work), name=f"job-{public_id}")
    thread.daemon = True  # a server that is told to stop stops; what the work made so far is taken up by the next try
    request.app.state.jobs.append(thread)
    thread.start()
    return public_id


def _run(database: Database, actor: Actor, title: str, public_id: str, work: Callable[[Tell], str]) -> None:
    last_s = 0.0

    def tell(done: int, total: int, what: str) -> None:
        nonlocal last_s
        if time.monotonic() - last_s >= TELLS_EVERY_S:
            last_s = time.monotonic()
            tell_progress(database, public_id, done, total, what, utc_now())

    try:
        end_job(database, public_id, work(tell), utc_now())
    except (ValueError, OSError, StudyError) as error:
        _fail(database, actor, title, public_id, str(error))
    except Exception:
        log.exception("%s failed", title)
        _fail(database, actor, title, public_id, "Something went wrong here; the server's log says what.")


def _fail(database: Database, actor: Actor, title: str, public_id: str, reason: str) -> None:
    """The entry comes first: who sees that the work failed finds it."""
    record_alone(database, actor.name, Entry("work failed", subject=title, detail={"reason": reason}), utc_now())
    fail_job(database, public_id, reason, utc_now())

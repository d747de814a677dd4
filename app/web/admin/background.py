"""Do what a form starts in a thread of the server, and show its progress, which the database stores."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from app.errors import NotFoundError, StudyError, UnavailableError
from app.ffmpeg import Progress
from app.store.database.engine import Database
from app.store.database.keys import utc_now
from app.store.database.server_tasks import (
    BEATS_WITHIN,
    LONGEST_DETAIL,
    STOPPED,
    beat,
    begin_task,
    end_task,
    fail_task,
    task_by_id,
    tell_progress,
)
from app.store.studies.audit import Actor, Entry, record_alone
from app.web.admin.layout import page, see
from app.web.gates import Store
from app.web.roles import Person

TELLS_EVERY_S = 0.5
BEATS_EVERY_S = BEATS_WITHIN.total_seconds() / 4

UPLOAD = "upload"  # begins the subject of a task that takes in an upload

router = APIRouter(prefix="/admin/jobs", include_in_schema=False)

log = logging.getLogger(__name__)


@router.get("/{task}")
def task_page(request: Request, task: Annotated[str, Path(max_length=32)], person: Person, database: Store) -> Response:
    with database.reading() as connection:
        known = task_by_id(connection, task)
    if known is None or (person.studies is not None and known.actor != person.name):
        raise NotFoundError("There is no such work in progress.")
    if known.state == "done" and known.result and "hx-request" not in request.headers:
        return see(known.result)
    is_upload = (known.subject or "").startswith(UPLOAD)
    return page(request, "task", person, {"task": known, "stopped": STOPPED, "is_upload": is_upload})


def start_task(
    database: Database,
    actor: Actor,
    title: str,
    work: Callable[[Progress], str],
    *,
    subject: str | None = None,
) -> str:
    """Start work in a thread and return the task's id; that of the running task if the same person has just started it.

    Parameters
    ----------
    work : takes a function that reports progress; returns the address of the result
    subject : identifies equal work, as in `begin_task`

    Raises
    ------
    ConflictError
        If somebody else is doing the same now.
    """
    begun = begin_task(database, actor.name, title, actor.now, subject)
    if begun.is_new:
        arguments = (database, actor, title, begun.public_id, work)
        # A daemon: the server can stop at once; the next attempt reuses what the work has made.
        threading.Thread(target=_run, args=arguments, name=f"task-{begun.public_id}", daemon=True).start()
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
        end_task(database, public_id, made, utc_now())
    except (ValueError, StudyError) as error:
        _fail(database, actor, title, public_id, str(error))
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

"""Keep the progress of tasks that the server does for experimenters in its threads; all its processes show it.

Commands on recordings and films are jobs instead, which worker processes run: `app.store.queue`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Connection, select, update

from app.errors import ConflictError
from app.store.database.engine import Database, insert_or_ignore
from app.store.database.keys import new_opaque_id
from app.store.database.tables import task

BEATS_WITHIN = timedelta(minutes=2)  # a task without a sign of life for longer has died with its process
LONGEST_DETAIL = 500
STOPPED = "The server was stopped while it did this. Start it again: what was finished is taken up."


@dataclass(frozen=True)
class ServerTask:
    public_id: str
    actor: str
    title: str
    subject: str | None
    state: str
    done: int
    total: int
    detail: str
    result: str | None
    started_at: datetime
    beat_at: datetime
    work: Mapping[str, Any] | None
    cancelled_at: datetime | None

    @property
    def goes_on(self) -> bool:
        """Is it taken up after a restart of the server?"""
        return self.work is not None and "kind" in self.work

    def is_lost(self, now: datetime) -> bool:
        """Whether the process that ran the task has died."""
        return self.state == "running" and now - self.beat_at > BEATS_WITHIN


@dataclass(frozen=True)
class Begun:
    """A running task; `is_new` unless it was running already."""

    public_id: str
    is_new: bool


def begin_task(
    database: Database,
    actor: str,
    title: str,
    now: datetime,
    subject: str | None = None,
    work: Mapping[str, Any] | None = None,
) -> Begun:
    """Begin a task, or return the actor's running task of the same subject.

    Parameters
    ----------
    subject : what it makes; two tasks never make the same at once. None: nothing that another task could make
    work : its kind and values, by which it is taken up after a restart; None: it is not

    Raises
    ------
    ConflictError
        If somebody else's task makes it now.
    """
    public_id = new_opaque_id()
    values: dict[str, Any] = {"public_id": public_id, "actor": actor, "title": title, "subject": subject}
    values |= {"state": "running", "work": work}
    counts = {"done": 0, "total": 0, "detail": "", "started_at": now, "beat_at": now}
    with database.writing() as connection:
        makes_it = (task.c.subject == subject) & (task.c.state == "running")
        is_lost = task.c.beat_at < now - BEATS_WITHIN
        connection.execute(update(task).where(makes_it & is_lost).values(state="failed", detail=STOPPED))
        if insert_or_ignore(connection, task, [values | counts], task.c.id):
            return Begun(public_id, is_new=True)
        runs = connection.execute(select(task.c.public_id, task.c.actor).where(makes_it)).one_or_none()
    if runs is None or runs.actor != actor:
        by = "Somebody" if runs is None else runs.actor
        raise ConflictError(f"{by} does this at the moment ({title}). Wait until it is done, or choose another name.")
    return Begun(runs.public_id, is_new=False)


def claim_lost_task(database: Database, kinds: Sequence[str], now: datetime, *, is_alone: bool) -> ServerTask | None:
    """Take over a task of some kinds whose process has died; None: there is none.

    Parameters
    ----------
    is_alone : is there no other process that could run one?
    """
    columns = [task.c[name] for name in ServerTask.__dataclass_fields__]
    with database.reading() as connection:  # who only looks takes no write lock
        rows = connection.execute(
            select(*columns).where(task.c.state == "running", task.c.work.is_not(None)).order_by(task.c.id)
        ).all()
    for row in rows:
        lost = ServerTask(**row._mapping)
        is_of_kind = lost.work is not None and lost.work.get("kind") in kinds
        if not is_of_kind or not (lost.is_lost(now) or (is_alone and lost.beat_at < now)):
            continue
        taken = update(task).where(task.c.public_id == lost.public_id, task.c.beat_at == lost.beat_at)
        with database.writing() as connection:
            if connection.execute(taken.values(beat_at=now)).rowcount:
                return lost
    return None


def leave_task(
    connection: Connection, actor: str, title: str, now: datetime, subject: str, work: Mapping[str, Any]
) -> bool:
    """Leave a task for the server to take up, which looks every few seconds; False: one of its subject runs."""
    values = {"public_id": new_opaque_id(), "actor": actor, "title": title, "subject": subject, "work": work}
    counts = {"done": 0, "total": 0, "detail": "", "started_at": now, "beat_at": now - 2 * BEATS_WITHIN}
    return bool(insert_or_ignore(connection, task, [values | counts | {"state": "running"}], task.c.id))


def cancel_task(connection: Connection, public_id: str, now: datetime) -> bool:
    """Ask a running task to stop; return whether it runs, and was not asked before."""
    runs = (task.c.public_id == public_id, task.c.state == "running", task.c.cancelled_at.is_(None))
    return bool(connection.execute(update(task).where(*runs).values(cancelled_at=now)).rowcount)


def is_cancelled(database: Database, public_id: str) -> bool:
    with database.reading() as connection:
        return connection.scalar(select(task.c.cancelled_at).where(task.c.public_id == public_id)) is not None


def beat(database: Database, public_id: str, now: datetime) -> None:
    """Store a sign of life of a task."""
    _change(database, public_id, beat_at=now)


def tell_progress(database: Database, public_id: str, done: int, total: int, detail: str, now: datetime) -> None:
    values = {"done": done, "total": total, "detail": detail[:LONGEST_DETAIL], "beat_at": now}
    _change(database, public_id, **values)


def end_task(database: Database, public_id: str, result: str, now: datetime) -> None:
    _change(database, public_id, state="done", result=result, beat_at=now)


def fail_task(database: Database, public_id: str, reason: str, now: datetime) -> None:
    _change(database, public_id, state="failed", detail=reason[:LONGEST_DETAIL], beat_at=now)


def task_by_id(connection: Connection, public_id: str) -> ServerTask | None:
    return next(iter(_tasks(connection, task.c.public_id == public_id)), None)


def running_tasks(connection: Connection, now: datetime) -> list[ServerTask]:
    """Return what runs now, the oldest first."""
    return _tasks(connection, (task.c.state == "running") & (task.c.beat_at >= now - BEATS_WITHIN))


def _tasks(connection: Connection, where: ColumnElement[bool]) -> list[ServerTask]:
    columns = [task.c[name] for name in ServerTask.__dataclass_fields__]
    return [ServerTask(**row._mapping) for row in connection.execute(select(*columns).where(where).order_by(task.c.id))]


def _change(database: Database, public_id: str, **values: object) -> None:
    with database.writing() as connection:
        connection.execute(update(task).where(task.c.public_id == public_id).values(**values))

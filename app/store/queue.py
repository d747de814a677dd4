"""Keep the queue of jobs that worker processes run, and the workers that are alive.

A job is queued, running, and then done, failed or cancelled. Only its worker changes a running job; a worker that has
shown no sign of life for a while has died, and its jobs are queued again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, Select, case, delete, func, insert, select, update

from app.errors import ConflictError, NotFoundError
from app.store.database.engine import Database, insert_or_ignore
from app.store.database.keys import new_opaque_id
from app.store.database.tables import queued_job, worker

JobState = Literal["queued", "running", "done", "failed", "cancelled"]
STATES: tuple[JobState, ...] = ("queued", "running", "done", "failed", "cancelled")
OPEN: tuple[JobState, ...] = ("queued", "running")
LOST_AFTER = timedelta(minutes=1)  # a worker that is silent for longer has died
LONGEST_DETAIL, LONGEST_STEP = 500, 100  # as the table has them


@dataclass(frozen=True)
class NewJob:
    """A job to queue.

    Parameters
    ----------
    kind : what is done, for example "reconstruct"
    arguments : checked values by field
    output : the entry of a shelf that it makes or changes; two jobs never change the same at once
    """

    kind: str
    arguments: Mapping[str, Any]
    output: str


@dataclass(frozen=True)
class QueuedJob:
    """A job as it stands; what each column means is told with the table."""

    public_id: str
    actor: str
    kind: str
    arguments: dict[str, Any]
    output: str
    state: JobState
    worker: str | None
    attempt: int
    is_cancelling: bool
    step: str
    done: int
    total: int
    left_s: float | None
    detail: str
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None

    @property
    def is_open(self) -> bool:
        """Whether it waits or runs."""
        return self.state in OPEN


@dataclass(frozen=True)
class JobProgress:
    """How far a running job is: its step, how much of it is done, and the estimate of the seconds that are left."""

    step: str = ""
    done: int = 0
    total: int = 0
    left_s: float | None = None


@dataclass(frozen=True)
class Worker:
    """A worker process.

    Parameters
    ----------
    name : of the machine and the process
    kinds : of jobs that it can run
    n_at_once : how many it runs at a time
    """

    name: str
    kinds: tuple[str, ...]
    n_at_once: int
    started_at: datetime
    beat_at: datetime


def enqueue(connection: Connection, new: NewJob, actor: str, now: datetime) -> str:
    """Put a job at the end of the queue and return its id.

    Raises
    ------
    ConflictError
        If another job that waits or runs makes the same thing.
    """
    values = {
        "public_id": new_opaque_id(),
        "actor": actor,
        "kind": new.kind,
        "arguments": dict(new.arguments),
        "output": new.output,
        "state": "queued",
        "attempt": 0,
        "is_cancelling": False,
        "detail": "",
        "created_at": now,
        **vars(JobProgress()),
    }
    if not insert_or_ignore(connection, queued_job, [values], queued_job.c.id):
        _refuse_second(connection, new.output)
    return str(values["public_id"])


def job_by_id(connection: Connection, public_id: str) -> QueuedJob:
    """Find a job.

    Raises
    ------
    NotFoundError
        If there is none of this id.
    """
    row = connection.execute(_jobs().where(queued_job.c.public_id == public_id)).one_or_none()
    if row is None:
        raise NotFoundError("There is no such job.")
    return QueuedJob(**row._mapping)


def list_jobs(
    connection: Connection, *, states: Collection[JobState] = STATES, limit: int | None = None, offset: int = 0
) -> list[QueuedJob]:
    """List jobs: those that run, those that wait in their order, then those that ended, the latest first."""
    rank = case((queued_job.c.state == "running", 0), (queued_job.c.state == "queued", 1), else_=2)
    waits = case((queued_job.c.state == "queued", queued_job.c.id), else_=0)
    rows = _jobs().where(queued_job.c.state.in_(states)).order_by(rank, waits, queued_job.c.ended_at.desc())
    rows = rows.order_by(queued_job.c.id.desc()).limit(limit).offset(offset)
    return [QueuedJob(**row._mapping) for row in connection.execute(rows)]


def n_jobs(connection: Connection) -> dict[JobState, int]:
    """Count jobs by state."""
    counted = connection.execute(select(queued_job.c.state, func.count().label("n")).group_by(queued_job.c.state))
    numbers = {row.state: row.n for row in counted}
    return {state: numbers.get(state, 0) for state in STATES}


def n_before(connection: Connection, job: QueuedJob) -> int:
    """Count the queued jobs that will be begun before a queued one."""
    its_id = select(queued_job.c.id).where(queued_job.c.public_id == job.public_id).scalar_subquery()
    earlier = select(func.count()).where(queued_job.c.state == "queued", queued_job.c.id < its_id)
    return connection.execute(earlier).scalar_one()


def cancel_job(connection: Connection, public_id: str, now: datetime) -> QueuedJob:
    """Cancel a job: at once if it waits; else its worker stops it.

    Raises
    ------
    NotFoundError, ConflictError
        If there is no such job, or it has ended.
    """
    its = queued_job.c.public_id == public_id
    waits = update(queued_job).where(its, queued_job.c.state == "queued")
    if not connection.execute(waits.values(state="cancelled", ended_at=now)).rowcount:
        runs = update(queued_job).where(its, queued_job.c.state == "running")
        if not connection.execute(runs.values(is_cancelling=True)).rowcount:
            ended = job_by_id(connection, public_id)
            raise ConflictError(f"This job is {ended.state} already; there is nothing to cancel.")
    return job_by_id(connection, public_id)


def retry_job(connection: Connection, public_id: str) -> QueuedJob:
    """Queue a failed or cancelled job again; its command takes up what was finished.

    Raises
    ------
    NotFoundError, ConflictError
        If there is no such job, it has not failed or been cancelled, or another job makes the same thing now.
    """
    known = job_by_id(connection, public_id)
    if known.state not in ("failed", "cancelled"):
        raise ConflictError(f"This job is {known.state}; only a failed or cancelled job can be queued again.")
    if connection.scalar(select(queued_job.c.id).where(queued_job.c.output == known.output, _is_open())):
        _refuse_second(connection, known.output)
    its = update(queued_job).where(queued_job.c.public_id == public_id, queued_job.c.state == known.state)
    connection.execute(its.values(**_back_in_queue()))
    return job_by_id(connection, public_id)


def is_made_since(connection: Connection, job: QueuedJob) -> bool:
    """Whether another job has made the same thing since this one was queued."""
    made = select(queued_job.c.id).where(queued_job.c.output == job.output, queued_job.c.state == "done")
    return connection.scalar(made.where(queued_job.c.ended_at > job.created_at).limit(1)) is not None


def take_job(
    database: Database,
    name: str,
    kinds: Collection[str],
    now: datetime,
    must_wait: Callable[[QueuedJob, QueuedJob], bool] = lambda _job, _earlier: False,
) -> QueuedJob | None:
    """Give a worker the job that has waited longest among those it can run now; None if there is none.

    Two workers never take the same job.

    Parameters
    ----------
    name, kinds : of the worker, and of the jobs that it can run
    must_wait : whether a job cannot begin before an earlier one has ended
    """
    with database.reading() as connection:  # an idle worker takes no write lock
        jobs = list_jobs(connection, states=OPEN)
    begun = {"state": "running", "worker": name, "started_at": now, "ended_at": None, "detail": ""}
    for place, job in enumerate(jobs):
        if job.state == "running" or job.kind not in kinds or any(must_wait(job, other) for other in jobs[:place]):
            continue
        still_waits = update(queued_job).where(queued_job.c.public_id == job.public_id, queued_job.c.state == "queued")
        values = begun | {"attempt": queued_job.c.attempt + 1} | vars(JobProgress())
        with database.writing() as connection:
            if connection.execute(still_waits.values(values)).rowcount:
                return job_by_id(connection, job.public_id)
    return None


def jobs_of(connection: Connection, name: str) -> dict[str, bool]:
    """Return the jobs that a worker runs, by id, and whether each is to be stopped."""
    mine = select(queued_job.c.public_id, queued_job.c.is_cancelling).where(_runs_by(name))
    return {row.public_id: row.is_cancelling for row in connection.execute(mine)}


def tell_progress(database: Database, name: str, public_id: str, progress: JobProgress) -> None:
    """Store how far a worker's job is."""
    _change(database, name, public_id, vars(progress) | {"step": progress.step[:LONGEST_STEP]})


def end_job(
    database: Database,
    name: str,
    public_id: str,
    state: JobState,
    detail: str,
    now: datetime,
    also: Callable[[Connection], str] = lambda _connection: "",
) -> None:
    """Store how a worker's job ended; a job that was taken from the worker stays as it is.

    Parameters
    ----------
    also : what is done in the same transaction; it returns more of the detail
    """
    its = update(queued_job).where(queued_job.c.public_id == public_id, _runs_by(name))
    ended = {"state": state, "detail": detail[:LONGEST_DETAIL], "ended_at": now, "is_cancelling": False}
    with database.writing() as connection:
        if connection.execute(its.values(**ended)).rowcount and (more := also(connection)):
            this = update(queued_job).where(queued_job.c.public_id == public_id)
            connection.execute(this.values(detail=f"{detail} {more}".strip()[:LONGEST_DETAIL]))


def beat(database: Database, me: Worker, now: datetime) -> None:
    """Store a worker's sign of life, and queue the jobs of dead workers again.

    A dead worker's job that was to be cancelled is cancelled. A worker that was taken for dead is back with this, but
    its jobs may be others' by then: `jobs_of` tells.
    """
    with database.writing() as connection:
        its = update(worker).where(worker.c.name == me.name)
        if not connection.execute(its.values(beat_at=now)).rowcount:
            connection.execute(insert(worker).values(**vars(me) | {"kinds": list(me.kinds), "beat_at": now}))
        connection.execute(delete(worker).where(worker.c.beat_at < now - LOST_AFTER))
        _put_back(connection, queued_job.c.worker.not_in(select(worker.c.name)), now)


def leave(database: Database, name: str, now: datetime) -> None:
    """Store that a worker ends; jobs that it has not ended are queued again."""
    with database.writing() as connection:
        _put_back(connection, queued_job.c.worker == name, now)
        connection.execute(delete(worker).where(worker.c.name == name))


def give_back(database: Database, name: str, public_ids: Collection[str], now: datetime) -> None:
    """Queue jobs again that a worker has but does not run; those that were to be cancelled are."""
    with database.writing() as connection:
        _put_back(connection, (queued_job.c.worker == name) & queued_job.c.public_id.in_(public_ids), now)


def workers(connection: Connection, now: datetime) -> list[Worker]:
    """List the workers that are alive."""
    columns = [worker.c[name] for name in Worker.__dataclass_fields__]
    rows = connection.execute(select(*columns).where(worker.c.beat_at >= now - LOST_AFTER).order_by(worker.c.id))
    return [Worker(**{**row._mapping, "kinds": tuple(row.kinds)}) for row in rows]


def _jobs() -> Select[Any]:
    return select(*(queued_job.c[name] for name in QueuedJob.__dataclass_fields__))


def _is_open() -> ColumnElement[bool]:
    return queued_job.c.state.in_(OPEN)


def _runs_by(name: str) -> ColumnElement[bool]:
    return (queued_job.c.worker == name) & (queued_job.c.state == "running")


def _change(database: Database, name: str, public_id: str, values: Mapping[str, Any]) -> None:
    """Change a job that a worker runs; one that was taken from it stays as it is."""
    its = update(queued_job).where(queued_job.c.public_id == public_id, _runs_by(name))
    with database.writing() as connection:
        connection.execute(its.values(**values))


def _back_in_queue() -> dict[str, Any]:
    return {"state": "queued", "is_cancelling": False, "ended_at": None, "detail": "", **vars(JobProgress())}


def _put_back(connection: Connection, is_left: ColumnElement[bool], now: datetime) -> None:
    """End the running jobs of workers that are gone: cancelled if they were to be, else queued again."""
    left = (queued_job.c.state == "running") & is_left
    cancelled = {"state": "cancelled", "is_cancelling": False, "ended_at": now}
    connection.execute(update(queued_job).where(left, queued_job.c.is_cancelling).values(**cancelled))
    connection.execute(update(queued_job).where(left).values(**_back_in_queue()))


def _refuse_second(connection: Connection, output: str) -> None:
    open_job = connection.execute(
        select(queued_job.c.actor, queued_job.c.state).where(queued_job.c.output == output, _is_open())
    ).one_or_none()
    who = "Somebody" if open_job is None else open_job.actor
    raise ConflictError(
        f"{who} has a job that makes or changes {output!r}, and it has not ended. Wait for it, cancel it, or choose "
        "another name."
    )

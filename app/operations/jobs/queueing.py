"""Queue, cancel and retry jobs, from the dashboard or over REST; the audit log says who did."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import takewhile

from app.errors import ConflictError
from app.operations.jobs.kinds import KINDS, title_of
from app.store.database.engine import Database, Transaction
from app.store.queue import (
    OPEN,
    NewJob,
    QueuedJob,
    cancel_job,
    enqueue,
    is_made_since,
    job_by_id,
    list_jobs,
    retry_job,
)
from app.store.studies.audit import Actor


def queue_job(database: Database, new: NewJob, actor: Actor) -> QueuedJob:
    """Put a job at the end of the queue.

    Raises
    ------
    ConflictError
        If another job that waits or runs makes the same thing.
    """
    with database.writing() as connection:
        job = job_by_id(connection, enqueue(connection, new, actor.name, actor.now))
        actor.note(connection, "job queued", subject=job.output, job=job.public_id, kind=job.kind)
    return job


def cancel(database: Database, public_id: str, actor: Actor) -> QueuedJob:
    """Cancel a job, see `cancel_job`."""
    with database.writing() as connection:
        job = cancel_job(connection, public_id, actor.now)
        actor.note(connection, "job cancelled", subject=job.output, job=public_id, kind=job.kind)
    return job


def retry(database: Database, public_id: str, actor: Actor) -> QueuedJob:
    """Queue a failed or cancelled job again, see `retry_job`.

    Raises
    ------
    NotFoundError, ConflictError
        As `retry_job`, or if it would overwrite what another job has made since.
    """
    with database.writing() as connection:
        job = retry_job(connection, public_id)
        kind = KINDS.get(job.kind)
        if kind is not None and kind.makes_new and is_made_since(connection, job):
            raise ConflictError(
                f"Another job has made {job.output!r} since, which this one would overwrite. Start a new job like "
                "this one."
            )
        actor.note(connection, "job queued again", subject=job.output, job=public_id, kind=job.kind)
    return job


def uses(job: QueuedJob) -> set[str]:
    """Return the entries that a job reads, makes or changes, as "SHELF/NAME"."""
    kind = KINDS.get(job.kind)
    return {job.output} | (kind.reads(job.arguments) if kind else set())


def refuse_while_used(connection: Transaction, place: str) -> None:
    """Check that no job that waits or runs reads, makes or changes an entry, "SHELF/NAME".

    Raises
    ------
    ConflictError
        If one does.
    """
    for job in list_jobs(connection, states=OPEN):
        if place in uses(job):
            raise ConflictError(
                f"A job works on {place.partition('/')[2]} now: {title_of(job.kind)}. Cancel it, or wait for its end."
            )


def must_wait(job: QueuedJob, earlier: QueuedJob) -> bool:
    """Whether an earlier job changes what this one reads, or reads what this one changes."""
    return earlier.output in uses(job) or job.output in uses(earlier)


def waits_for(job: QueuedJob, open_jobs: Iterable[QueuedJob]) -> QueuedJob | None:
    """Return the first of the open jobs before a queued one that it must wait for."""
    before = takewhile(lambda other: other.public_id != job.public_id, open_jobs)
    return next((other for other in before if must_wait(job, other)), None)

"""Queue, cancel and retry jobs, from the dashboard or over REST; the audit log says who did."""

from __future__ import annotations

from app.store.audit import Actor
from app.store.engine import Database
from app.store.queue import NewJob, QueuedJob, cancel_job, enqueue, job_by_id, retry_job


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
    """Queue a failed or cancelled job again, see `retry_job`."""
    with database.writing() as connection:
        job = retry_job(connection, public_id)
        actor.note(connection, "job queued again", subject=job.output, job=public_id, kind=job.kind)
    return job

"""Estimate how long a whole job still takes: as one of its kind took that was done before, at the pace of this one."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime

from app.operations.jobs.command import job_folder, step_ends
from app.settings import Settings
from app.store.queue import QueuedJob


def whole_left_s(job: QueuedJob, known: Iterable[QueuedJob], settings: Settings, now: datetime) -> float | None:
    """Return about how many seconds a running job still takes; None while nothing tells.

    A job that goes on where an earlier attempt was stopped tells no pace, so it has no estimate.

    Parameters
    ----------
    job : has an estimate of its present step, else there is none of the whole
    known : jobs that are done, the latest first; the one that was asked most alike tells how long the steps take
    settings : where the jobs' folders lie
    now : the present
    """
    if job.started_at is None or job.left_s is None or job.attempt > 1:
        return None
    until_s = (now - job.started_at).total_seconds() + job.left_s
    alike = [other for other in known if other.kind == job.kind and other.attempt == 1]
    for other in sorted(alike, key=lambda other: -_n_equal(job, other)):
        other_until_s = step_ends(job_folder(settings, other.public_id)).get(job.step)
        if other_until_s and other.started_at and other.ended_at:
            later_s = (other.ended_at - other.started_at).total_seconds() - other_until_s
            return job.left_s + max(0.0, later_s) * until_s / other_until_s
    return None


def _n_equal(job: QueuedJob, other: QueuedJob) -> int:
    """Count the fields in which two jobs were asked the same."""
    return sum(other.arguments.get(name) == value for name, value in job.arguments.items())

"""Go on after a job by itself: queue the next job of its chain, or leave the study at the end to the server."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from app.errors import StudyError
from app.operations.jobs.fields import Entries
from app.operations.jobs.kind import JobKind
from app.operations.jobs.kinds import KINDS, job_kind
from app.operations.jobs.shared_fields import GOALS, NOTHING
from app.operations.tasks import KIND
from app.settings import Settings
from app.store.database.engine import Transaction
from app.store.database.server_tasks import leave_task
from app.store.queue import NewJob, QueuedJob, enqueue
from app.store.studies.audit import Entry as Noted
from app.store.studies.audit import record

STUDY_OF_SET = "study of a set"  # kind of the task that makes a study at the end of a chain


def go_on(settings: Settings, connection: Transaction, job: QueuedJob, now: datetime) -> str:
    """Begin what was asked to follow a job that is done, in the transaction of its end.

    Returns
    -------
    a sentence where it cannot be; empty: it goes on, or nothing was to follow
    """
    kind = KINDS.get(job.kind)
    if kind is None or kind.then is None or job.arguments.get("then", NOTHING) == NOTHING:
        return ""
    try:
        if kind.then:
            new = _next_job(settings, job, kind)
            following = enqueue(connection, new, job.actor, now)
            detail = {"job": following, "kind": new.kind, "after": job.public_id}
            record(connection, job.actor, Noted("job queued", subject=new.output, detail=detail), now)
        else:
            _leave_study(connection, job, kind, now)
    except StudyError as error:
        return f"It did not go on: {error.detail}"
    return ""


def _next_job(settings: Settings, job: QueuedJob, kind: JobKind) -> NewJob:
    """Return the job that begins with what another one has made."""
    assert kind.then, "its caller has looked"
    following = job_kind(kind.then[0])
    goal = job.arguments["then"]
    field = following.first_entry
    shelf, name = kind.output(job.arguments)
    value = field.value_for(settings, shelf, name)
    if value is None:
        raise field.refuse(name, f"something to {following.title.lower()}")
    given: dict[str, Any] = {
        field.name: [value] if isinstance(field, Entries) else value,
        "then": NOTHING if GOALS[following.name] == goal else goal,
        **{key: job.arguments.get(key) for key in ("study_name", "study_preset")},
    }
    return following.read(given, settings)


def _leave_study(connection: Transaction, job: QueuedJob, kind: JobKind, now: datetime) -> None:
    _, name = kind.output(job.arguments)
    work: dict[str, Any] = {KIND: STUDY_OF_SET, "set": name, "by": job.actor}
    work |= {key: job.arguments.get(key) for key in ("study_name", "study_preset")}
    leave_task(connection, job.actor, f"Creating a study of {name}", now, f"study of {name}"[:200], work)

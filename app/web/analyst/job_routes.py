"""Serve jobs over REST: list, start, cancel and retry what worker processes do with recordings and films."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query
from fastapi.responses import JSONResponse, PlainTextResponse, Response
from pydantic import BaseModel, ConfigDict, Field

from app.operations.jobs import queueing
from app.operations.jobs.command import job_folder, log_tail
from app.operations.jobs.fields import Choice, Choices, Entry
from app.operations.jobs.fields import Field as JobField
from app.operations.jobs.kinds import KINDS, job_kind
from app.settings import Settings
from app.store.access.rights import JOBS
from app.store.queue import STATES, JobState, QueuedJob, job_by_id, list_jobs
from app.store.studies.audit import Actor
from app.web.analyst import columns
from app.web.analyst.formats import ChosenFormat, json_bytes, json_object, table
from app.web.analyst.openapi import object_answers, table_answers
from app.web.analyst.openapi_examples import JOB, JOB_KINDS
from app.web.gates import Store, settings
from app.web.roles import may_change, may_read

router = APIRouter(prefix="/api/v1/jobs", tags=["jobs"])
SEEING = [Depends(may_read(JOBS))]
JobManager = Annotated[Actor, Depends(may_change(JOBS))]
JobId = Annotated[str, Path(max_length=32, description="id of the job")]
Here = Annotated[Settings, Depends(settings)]
MOST_LINES = 2000


class JobBody(BaseModel):
    """A job to start: its kind, and the fields of its form."""

    model_config = ConfigDict(extra="forbid", strict=True)

    kind: str = Field(max_length=40)
    arguments: dict[str, str | bool | float | list[str] | None] = Field(default={}, max_length=40)


@router.get("", responses=table_answers(columns.JOBS), dependencies=SEEING)
def jobs(
    database: Store,
    chosen: ChosenFormat,
    state: Annotated[JobState | None, Query(description="only these")] = None,
) -> Response:
    """List jobs: those that run, those that wait, then those that ended, the latest first."""
    with database.reading() as connection:
        rows = [_row(job) for job in list_jobs(connection, states=STATES if state is None else (state,))]
    return table(rows, columns.JOBS, chosen, "jobs")


@router.get("/kinds", responses=object_answers(JOB_KINDS), dependencies=SEEING)
def kinds(here: Here, chosen: ChosenFormat) -> Response:
    """Describe all kinds of jobs, with their fields and what can be chosen now."""
    listed = [
        {
            "kind": kind.name,
            "title": kind.title,
            "help": kind.help,
            "fields": [_described(field, here) for field in kind.fields],
        }
        for kind in KINDS.values()
    ]
    return json_object({"kinds": listed}, chosen)


@router.get("/{job}", responses=object_answers(JOB), dependencies=SEEING)
def show(job: JobId, database: Store, chosen: ChosenFormat) -> Response:
    """Show a job: its state, and how far it is."""
    with database.reading() as connection:
        return json_object(_row(job_by_id(connection, job)), chosen)


@router.get("/{job}/log", dependencies=SEEING, response_class=PlainTextResponse)
def log(
    job: JobId,
    database: Store,
    here: Here,
    lines: Annotated[int, Query(ge=1, le=MOST_LINES, description="how many, from the end")] = 200,
) -> Response:
    """Send the last lines of a job's log; nothing before it has begun."""
    with database.reading() as connection:
        known = job_by_id(connection, job)
    return PlainTextResponse("".join(f"{line}\n" for line in log_tail(job_folder(here, known.public_id), lines)))


@router.post("", status_code=201, responses={201: object_answers(JOB)[200]})
def start(body: JobBody, actor: JobManager, database: Store, here: Here) -> Response:
    """Queue a job; a worker begins it when those before it have ended."""
    new = job_kind(body.kind).read(body.arguments, here)
    return _shown(queueing.queue_job(database, new, actor), 201)


@router.post("/{job}/cancel", responses={200: object_answers(JOB)[200]})
def cancel(job: JobId, actor: JobManager, database: Store) -> Response:
    """Cancel a job; one that runs stops within seconds, and what it has finished is kept."""
    return _shown(queueing.cancel(database, job, actor))


@router.post("/{job}/retry", responses={200: object_answers(JOB)[200]})
def retry(job: JobId, actor: JobManager, database: Store) -> Response:
    """Queue a failed or cancelled job again; it goes on from what was finished."""
    return _shown(queueing.retry(database, job, actor))


def _shown(job: QueuedJob, status_code: int = 200) -> Response:
    return Response(json_bytes(_row(job)), status_code, media_type=JSONResponse.media_type)


def _row(job: QueuedJob) -> dict[str, Any]:
    row = asdict(job) | {"job": job.public_id}
    row |= {name: value.isoformat() for name, value in row.items() if isinstance(value, datetime)}
    return {name: row[name] for name in columns.JOBS}


def _described(field: JobField, here: Settings) -> dict[str, Any]:
    choices: list[str] | None = None
    if isinstance(field, Entry):
        choices = field.names(here)
    elif isinstance(field, Choice | Choices):
        choices = list(field.choices)
    return {
        "field": field.name,
        "type": type(field).__name__,
        "label": field.label,
        "help": field.help,
        "required": field.is_required,
        "default": field.default,
        "choices": choices,
    }

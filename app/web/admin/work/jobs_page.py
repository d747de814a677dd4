"""Show the jobs that worker processes run, and start, cancel and retry them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path as FilePath
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, Path, Request
from fastapi.responses import FileResponse, Response
from starlette.concurrency import run_in_threadpool

from app.errors import NotFoundError
from app.operations.extras import has_extra
from app.operations.jobs import queueing
from app.operations.jobs.command import LOG, job_folder, log_tail
from app.operations.jobs.estimate import whole_left_s
from app.operations.jobs.fields import SETS, Choices, Entries, Entry, Field, NewName, Switch, place
from app.operations.jobs.kind import JobKind
from app.operations.jobs.kinds import GROUPS, KINDS, title_of
from app.settings import Settings
from app.store.queue import (
    OPEN,
    JobState,
    QueuedJob,
    job_by_id,
    list_jobs,
    n_before,
    n_jobs,
    workers,
)
from app.web.admin.layout import page, see
from app.web.admin.listing import listing
from app.web.admin.live import live_part, render_part
from app.web.gates import FORM_TOKEN, Store, database, now, settings, takes_any_field
from app.web.roles import Acting, Looking
from ground.progress import duration

LOG_LINES = 200
DONE: tuple[JobState, ...] = ("done",)
JOBS_TO_LEARN_FROM = 100  # the latest that are done

JobId = Annotated[str, Path(max_length=32)]

router = APIRouter(prefix="/admin/work", include_in_schema=False)


@dataclass(frozen=True)
class ShownJob:
    """A job as the pages show it."""

    job: QueuedJob
    title: str
    name: str
    took: str
    left: str
    result: str | None


def shown_job(job: QueuedJob, moment: datetime) -> ShownJob:
    """Return what pages show of a job."""
    took = (job.ended_at or moment) - job.started_at if job.started_at else None
    return ShownJob(
        job,
        title_of(job.kind),
        job.output.rpartition("/")[2],
        "" if took is None else duration(took.total_seconds()),
        "" if job.left_s is None else duration(job.left_s),
        result_address(job),
    )


def result_address(job: QueuedJob) -> str | None:
    """Return where to look at what a job made; None before it has begun."""
    shelf, _, name = job.output.partition("/")
    if job.started_at is None:
        return None
    return "/admin/sets" if shelf == SETS else f"/admin/files/{shelf}/{quote(name)}"


def _output(job: QueuedJob, server: Settings) -> FilePath:
    """Return where what a job makes lies; a job that failed early has made nothing."""
    shelf, _, name = job.output.partition("/")
    return place(server, shelf) / name


@router.get("")
def work_page(request: Request, person: Looking) -> Response:
    return page(request, "work", person, {"groups": GROUPS, **missing_extra(), **_list_of(request)})


@router.get("/live")
async def live_list(request: Request, person: Looking) -> Response:  # noqa: ARG001 (the gate)
    """Send the list of jobs whenever it changes, as server-sent events."""
    return live_part(request, "work", lambda: _rendered(request, "_work_list", _list_of))


@router.get("/new/{kind}")
def new_job_page(request: Request, person: Looking, kind: Annotated[str, Path(max_length=40)]) -> Response:
    """Show the form of a kind of job; the address may hold values of its fields."""
    chosen = _kind(kind)
    given = {field.name: _given(field, request.query_params.getlist(field.name)) for field in chosen.fields}
    return page(request, "work_new", person, _form_of(chosen, given, settings(request)))


@takes_any_field
async def job_form(request: Request, kind: Annotated[str, Path(max_length=40)]) -> dict[str, Any]:
    """Read the fields of a job's form; a switch that was not sent is off."""
    form = await request.form()
    given: dict[str, Any] = {name: value for name, value in form.items() if name != FORM_TOKEN}  # also unknown ones
    for field in _kind(kind).fields:
        values = [value for value in form.getlist(field.name) if isinstance(value, str)]
        given[field.name] = bool(values) if isinstance(field, Switch) else _given(field, values)
    return given


@router.post("/new/{kind}")
def start(
    request: Request,
    actor: Acting,
    kind: Annotated[str, Path(max_length=40)],
    given: Annotated[dict[str, Any], Depends(job_form)],
    store: Store,
) -> Response:
    """Queue a job."""
    new = _kind(kind).read(given, settings(request))
    return see(f"/admin/work/{queueing.queue_job(store, new, actor).public_id}")


@router.get("/{job}")
def job_page(request: Request, person: Looking, job: JobId) -> Response:
    return page(request, "work_job", person, _job_of(request, job))


@router.get("/{job}/live")
async def live_job(request: Request, person: Looking, job: JobId) -> Response:  # noqa: ARG001 (the gate)
    """Send a job's state and the end of its log whenever they change, as server-sent events."""
    await run_in_threadpool(_job_of, request, job)  # which refuses an unknown one
    return live_part(request, "work", lambda: _rendered(request, "_work_job", lambda asked: _job_of(asked, job)))


@router.get("/{job}/log")
def job_log(request: Request, person: Looking, job: JobId, store: Store) -> Response:  # noqa: ARG001 (the gate)
    """Download the whole log."""
    with store.reading() as connection:
        known = job_by_id(connection, job)
    path = job_folder(settings(request), known.public_id) / LOG
    if not path.is_file():
        raise NotFoundError("This job has no log yet.")
    return FileResponse(path, media_type="text/plain; charset=utf-8", filename=f"{known.kind}-{known.public_id}.txt")


@router.post("/{job}/cancel")
def cancel(actor: Acting, job: JobId, store: Store) -> Response:
    queueing.cancel(store, job, actor)
    return see(f"/admin/work/{job}")


@router.post("/{job}/retry")
def retry(actor: Acting, job: JobId, store: Store) -> Response:
    """Queue a failed or cancelled job again; it resumes."""
    queueing.retry(store, job, actor)
    return see(f"/admin/work/{job}")


def missing_extra() -> dict[str, Any]:
    """Return the kinds of jobs that this installation cannot run."""
    return {"missing": [] if has_extra("recon") else [kind.title for kind in KINDS.values() if kind.needs_recon]}


def _given(field: Field, values: list[str]) -> Any:
    """Return a field's value from those of its name: a list where it takes several."""
    if isinstance(field, Entries | Choices):
        return values
    return values[-1] if values else None


def _kind(name: str) -> JobKind:
    if name not in KINDS:
        raise NotFoundError("There is no such kind of job.")
    return KINDS[name]


def _list_of(request: Request) -> dict[str, Any]:
    moment = now(request)
    with database(request).reading() as connection:
        counted = n_jobs(connection)
        shown = listing(request, sum(counted.values()))
        jobs = list_jobs(connection, limit=shown.size, offset=shown.offset)
        alive = workers(connection, moment)
    return {
        "jobs": [shown_job(job, moment) for job in jobs],
        "list": shown,
        "counted": counted,
        "workers": alive,
    }


def _job_of(request: Request, public_id: str) -> dict[str, Any]:
    moment = now(request)
    with database(request).reading() as connection:
        job = job_by_id(connection, public_id)
        ahead = n_before(connection, job) if job.state == "queued" else 0
        first = queueing.waits_for(job, list_jobs(connection, states=OPEN)) if job.state == "queued" else None
        is_possible = any(job.kind in worker.kinds for worker in workers(connection, moment))
        done = list_jobs(connection, states=DONE, limit=JOBS_TO_LEARN_FROM) if job.state == "running" else []
    kind = KINDS.get(job.kind)
    facts = [
        (field.label, _said(job.arguments[field.name]))
        for field in (kind.fields if kind else ())
        if job.arguments.get(field.name) not in (None, [])
    ]
    lines = log_tail(job_folder(settings(request), public_id), LOG_LINES)
    whole_s = whole_left_s(job, done, settings(request), moment)
    return {
        "shown": shown_job(job, moment),
        "whole_left": "" if whole_s is None else duration(whole_s),
        "has_output": _output(job, settings(request)).exists(),
        "job": job,
        "ahead": ahead,
        "first": first and shown_job(first, moment),
        "is_possible": is_possible,
        "facts": facts,
        "lines": lines,
        "again": _again(job, kind),
    }


def _again(job: QueuedJob, kind: JobKind | None) -> str:
    """Return the address of the form with a job's values, for a new name; empty for a kind that is no more."""
    if kind is None:
        return ""
    given = [
        f"{field.name}={quote(_written(value), safe='')}"
        for field in kind.fields
        if not isinstance(field, NewName)
        for value in _listed(job.arguments.get(field.name))
    ]
    return f"/admin/work/new/{kind.name}?{'&'.join(given)}"


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]


def _written(value: Any) -> str:
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


def _said(value: Any) -> str:
    return ", ".join(map(_written, _listed(value)))


def _form_of(kind: JobKind, given: Mapping[str, Any], server: Settings) -> dict[str, Any]:
    """Return what the form of a kind shows: each field with its type, its choices and its value."""
    rows = []
    for field in kind.fields:
        value = given.get(field.name)
        rows.append(
            {
                "field": field,
                "type": type(field).__name__,
                "value": field.default if value in (None, []) else value,
                "names": field.names(server) if isinstance(field, Entry) else [],
            }
        )
    return {"kind": kind, "rows": rows, **missing_extra()}


async def _rendered(request: Request, template: str, read: Callable[[Request], Mapping[str, Any]]) -> str:
    return await run_in_threadpool(lambda: render_part(request, template, read(request)))

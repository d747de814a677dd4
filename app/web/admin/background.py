"""Show the progress of a task, which a thread of the server does, and cancel it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from app.errors import NotFoundError
from app.store.database.server_tasks import STOPPED, cancel_task, task_by_id
from app.web.admin.layout import page, see
from app.web.gates import Store
from app.web.roles import Acting, Person
from app.web.uploads import UPLOAD

router = APIRouter(prefix="/admin", include_in_schema=False)


def task_address(task: str) -> str:
    """Return the address of a task's page."""
    return f"/admin/tasks/{task}"


@router.get("/tasks/{task}")
@router.get("/jobs/{task}")  # its address in 1.0
def task_page(request: Request, task: Annotated[str, Path(max_length=32)], person: Person, database: Store) -> Response:
    with database.reading() as connection:
        known = task_by_id(connection, task)
    if known is None or (person.studies is not None and known.actor != person.name):
        raise NotFoundError("There is no such work in progress.")
    if known.state == "done" and known.result and "hx-request" not in request.headers:
        return see(known.result)
    is_upload = (known.subject or "").startswith(UPLOAD)
    return page(request, "task", person, {"task": known, "stopped": STOPPED, "is_upload": is_upload})


@router.post("/tasks/{task}/cancel")
@router.post("/jobs/{task}/cancel")
def cancel(task: Annotated[str, Path(max_length=32)], actor: Acting, person: Person, database: Store) -> Response:
    """Stop a task as soon as the step is done that runs now."""
    with database.writing() as connection:
        known = task_by_id(connection, task)
        if known is None or (person.studies is not None and known.actor != person.name):
            raise NotFoundError("There is no such work in progress.")
        if cancel_task(connection, task, actor.now):
            actor.note(connection, "work cancelled", subject=known.title)
    return see(task_address(task))

"""List, send, fetch, attach and delete entries of the intake folder over REST, as the Files page does."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path, Request
from fastapi.responses import FileResponse, JSONResponse, Response
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError, NotFoundError
from app.intake.contents import read_contents
from app.intake.part_uploads import Standing, standing
from app.intake.shelves import KINDS, ShelfEntry, entries, file_in
from app.store.access.rights import JOBS, STUDIES
from app.store.studies.audit import Actor
from app.web.analyst import columns
from app.web.analyst.formats import ChosenFormat, CompressedRoute, json_object, table
from app.web.analyst.openapi import file_body, object_answers, table_answers
from app.web.analyst.openapi_examples import FILE
from app.web.analyst.study_routes import WAIT_S, Body, TaskView, Wait, accepted, waited_task
from app.web.analyst.upload_routes import ACCEPTED
from app.web.gates import Store, settings
from app.web.roles import may_change, may_read, study_called
from app.web.uploads import (
    NewUpload,
    add_part,
    begin_attaching_entry,
    begin_part_upload,
    delete_entry,
    discard_part_upload,
    entry_of,
)

router = APIRouter(prefix="/api/v1", tags=["files"], route_class=CompressedRoute)

SEEING = [Depends(may_read(JOBS))]
FileManager = Annotated[Actor, Depends(may_change(JOBS))]
StudyEditor = Annotated[Actor, Depends(may_change(STUDIES))]
Kind = Annotated[str, Path(max_length=40, description="the shelf")]
Name = Annotated[str, Path(max_length=120, description="of the entry")]
UploadId = Annotated[str, Path(max_length=40)]


class UploadView(BaseModel):
    upload: str = Field(description="address of the upload")
    offset: int = Field(description="bytes that are there: where the next part begins")
    size: int


class AttachBody(Body):
    study: Annotated[str, Field(max_length=100, description="the study's name in addresses")]


@router.get("/files", responses=table_answers(columns.FILES), dependencies=SEEING)
def files(request: Request, chosen: ChosenFormat) -> Response:
    """List recordings, films, tables and what jobs made, as the Files page does."""
    intake = settings(request).intake_dir
    rows = [_row(entry) for kind in KINDS for entry in entries(intake, kind)]
    return table(rows, columns.FILES, chosen, "files")


@router.get("/files/{kind}/{name}", responses=object_answers(FILE), dependencies=SEEING)
def entry(request: Request, kind: Kind, name: Name, chosen: ChosenFormat) -> Response:
    """Describe an entry, with the bytes of every file in it."""
    server = settings(request)
    contents = read_contents(entry_of(server, kind, name))
    row = next(_row(entry) for entry in entries(server.intake_dir, kind) if entry.name == name)
    return json_object({**row, "files": contents.sizes}, chosen)


@router.get(
    "/files/{kind}/{name}/{place:path}",
    dependencies=SEEING,
    response_class=Response,
    responses={200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}},
)
def file(request: Request, kind: Kind, name: Name, place: Annotated[str, Path(max_length=1000)]) -> Response:
    """Send a file of an entry."""
    try:
        path = file_in(settings(request).intake_dir, kind, name, place)
    except InvalidError as error:
        raise NotFoundError(error.detail) from error
    return FileResponse(path, filename=path.name, media_type="application/octet-stream")


@router.delete("/files/{kind}/{name}", status_code=204, response_class=Response)
def delete(request: Request, kind: Kind, name: Name, actor: FileManager, database: Store) -> Response:
    """Delete an entry for good, unless a job uses it (409)."""
    delete_entry(settings(request), database, actor, kind, name)
    return Response(status_code=204)


@router.post("/files/{kind}/{name}/attach", response_model=TaskView, responses=ACCEPTED)
def attach(
    body: AttachBody,
    request: Request,
    kind: Kind,
    name: Name,
    actor: StudyEditor,
    database: Store,
    wait_s: Wait = WAIT_S,
) -> Response:
    """Attach a report or a table of measures on a shelf to a study."""
    study = study_called(request, body.study)
    task = begin_attaching_entry(settings(request), database, actor, kind, name, study)
    return accepted(waited_task(database, task, wait_s, "Nothing was attached"))


@router.post(
    "/uploads",
    status_code=201,
    response_model=UploadView,
    responses={200: {"model": UploadView, "description": "It was begun before; go on at its offset"}},
)
def begin(body: NewUpload, request: Request, actor: FileManager, database: Store) -> Response:
    """Begin to send a file to a shelf, or go on: PATCH its address with what follows `offset`, whole or in parts."""
    begun = begin_part_upload(settings(request), database, actor, body)
    return _shown(begun, 201 if begun.offset == 0 else 200)


@router.get("/uploads/{upload}", response_model=UploadView, dependencies=SEEING)
def ask(request: Request, upload: UploadId) -> Response:
    """Say how much of an upload is there."""
    return _shown(standing(settings(request).intake_dir, upload))


@router.patch(
    "/uploads/{upload}",
    response_model=UploadView,
    responses={202: {"model": TaskView, "description": "All is there: the task that checks it"}},
    openapi_extra=file_body(),
)
async def add(
    request: Request,
    upload: UploadId,
    actor: FileManager,
    database: Store,
    offset: Annotated[int, Header(alias="Upload-Offset", ge=0, description="at which this part begins")],
    wait_s: Wait = WAIT_S,
) -> Response:
    """Add a part to an upload; after the last one comes the task that checks the file and shelves it."""
    now, task = await add_part(request, database, actor, upload, offset)
    if task is None:
        return _shown(now)
    begun = await run_in_threadpool(waited_task, database, task, wait_s, "The file was not taken in")
    return JSONResponse(begun.model_dump(), 202)


@router.delete("/uploads/{upload}", status_code=204, response_class=Response)
def discard(request: Request, upload: UploadId, actor: FileManager, database: Store) -> Response:
    """Discard what was sent of an upload."""
    discard_part_upload(settings(request), database, actor, upload)
    return Response(status_code=204)


def _row(entry: ShelfEntry) -> dict[str, Any]:
    return {**vars(entry), "changed_at": entry.changed_at.isoformat()}


def _shown(known: Standing, status_code: int = 200) -> Response:
    view = UploadView(upload=f"{router.prefix}/uploads/{known.upload.id}", offset=known.offset, size=known.upload.size)
    return JSONResponse(view.model_dump(), status_code)

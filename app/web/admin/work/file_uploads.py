"""Take files of any size in parts: begin an upload, add a part, ask how far it is, discard it.

A lost connection costs the part that was under way, not the file. Whoever sends the same file again goes on where it
stopped. When all is there, a task of the server checks it and puts it on its shelf, see `app/intake/arrivals.py`.
"""

from __future__ import annotations

import logging
import shutil
from contextlib import AbstractContextManager, suppress
from pathlib import Path as FilePath
from typing import IO, Annotated

from fastapi import APIRouter, Header, Path, Request
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.errors import InvalidError, TooLargeError, UnavailableError
from app.ffmpeg import Progress
from app.intake.arrivals import EXPECTED, Limits, shelve
from app.intake.bounds import in_bounds
from app.intake.part_uploads import (
    PartUpload,
    Standing,
    appending,
    begin_upload,
    bytes_to_come,
    checking,
    discard,
    note_task,
    remove_expired,
    standing,
    upload_id,
    work_folder,
)
from app.intake.shelves import free_path
from app.intake.zips import MB
from app.operations.tasks import start_task
from app.settings import Settings
from app.store.database.engine import Database
from app.store.studies.audit import Actor, Entry, record_alone
from app.web.admin.background import UPLOAD, task_address
from app.web.admin.layout import see
from app.web.gates import Store, settings
from app.web.limits.turns import in_turn
from app.web.roles import Acting, Looking
from app.web.uploads import UploadingActor

UploadId = Annotated[str, Path(max_length=40)]

router = APIRouter(prefix="/admin/files/upload", include_in_schema=False)

log = logging.getLogger(__name__)


class NewUpload(BaseModel):
    """What the browser says of a file before it sends it; `modified` in ms since 1970."""

    model_config = ConfigDict(extra="forbid")

    kind: Annotated[str, Field(max_length=40)]
    name: Annotated[str, Field(max_length=200)]
    file: Annotated[str, Field(max_length=300)]
    size: Annotated[int, Field(ge=0, lt=2**53)]
    modified: Annotated[int, Field(ge=-(2**53), lt=2**53)] = 0


@router.post("")
def begin(request: Request, actor: UploadingActor, wanted: NewUpload, database: Store) -> Response:
    """Begin an upload, or go on with the same one: the answer says where, and from which byte."""
    server = settings(request)
    name = wanted.name.strip()
    facts = (wanted.kind, name, wanted.file, wanted.size)
    upload = PartUpload(upload_id(actor.id, *facts, wanted.modified), *facts, by=actor.name)
    remove_expired(server.intake_dir, actor.now)
    _check_wanted(server, wanted, name, bytes_to_come(server.intake_dir, upload.id, wanted.size))
    begun = begin_upload(server.intake_dir, upload)
    if begun.offset == 0:
        entry = Entry("upload begun", subject=f"{wanted.kind}/{name}", detail={"bytes": wanted.size})
        record_alone(database, actor.name, entry, actor.now)
    return JSONResponse(_told(begun), 201 if begun.offset == 0 else 200)


@router.get("/{upload}")
def ask(request: Request, _person: Looking, upload: UploadId) -> Response:
    """Say how far an upload is."""
    return JSONResponse(_told(standing(settings(request).intake_dir, upload)))


@router.patch("/{upload}")
async def add_part(
    request: Request,
    actor: UploadingActor,
    upload: UploadId,
    database: Store,
    offset: Annotated[int, Header(alias="Upload-Offset", ge=0)],
) -> Response:
    """Add a part that begins at `Upload-Offset`; what arrives of it counts, even if the connection is lost."""
    server = settings(request)
    known = (await run_in_threadpool(standing, server.intake_dir, upload)).upload
    with suppress(ClientDisconnect), appending(server.intake_dir, upload, offset) as file:
        await _receive(request, file, known.size - offset)  # whoever was cut off asks how far it came, and goes on
    told = await run_in_threadpool(standing, server.intake_dir, upload)
    if told.offset == known.size:
        task = await run_in_threadpool(_start_shelving, server, database, actor, known)
        return JSONResponse({**_told(told), "task": task}, 202)
    return JSONResponse(_told(told))


@router.post("/{upload}/discard")
def discard_upload(request: Request, actor: Acting, upload: UploadId, database: Store) -> Response:
    intake = settings(request).intake_dir
    known = standing(intake, upload).upload
    discard(intake, upload)
    entry = Entry("upload discarded", subject=f"{known.kind}/{known.name}", detail={"begun by": known.by})
    record_alone(database, actor.name, entry, actor.now)
    return see("/admin/files")


def _check_wanted(server: Settings, wanted: NewUpload, name: str, to_come: int) -> None:
    """Refuse before a byte is sent what could not be kept; it will take `to_come` bytes more on the disk."""
    if wanted.kind not in EXPECTED:
        raise InvalidError(f"Nothing can be uploaded to {wanted.kind!r}; expected one of {', '.join(EXPECTED)}.")
    free_path(server.intake_dir, wanted.kind, name)
    if wanted.size == 0:
        raise InvalidError("The file is empty. Choose another one.")
    if wanted.size > server.largest_intake_mb * MB:
        raise TooLargeError(
            f"The file has {wanted.size // MB} MB; this server takes {server.largest_intake_mb} MB at most. An "
            "administrator can raise RECONSTUDY_LARGEST_INTAKE_MB, or copy the folder to the server by hand."
        )
    server.intake_dir.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(server.intake_dir).free
    if to_come > free:
        raise TooLargeError(
            f"The file has {wanted.size // MB} MB and needs about twice that to unpack; the server's disk has "
            f"{free // MB} MB free. Delete entries that nobody needs, then repeat."
        )


async def _receive(request: Request, file: IO[bytes], most: int) -> None:
    async for chunk in request.stream():
        most -= len(chunk)
        if most < 0:
            raise InvalidError("More bytes came than the file has; it has changed. Choose it again to begin anew.")
        await run_in_threadpool(_write, file, chunk)


def _write(file: IO[bytes], chunk: bytes) -> None:
    file.write(chunk)
    file.flush()  # so that a killed server has lost nothing of it


def _told(known: Standing) -> dict[str, object]:
    upload = known.upload
    address = f"/admin/files/upload/{upload.id}"
    return {"upload": address, "offset": known.offset, "size": upload.size, "task": upload.task}


def _start_shelving(server: Settings, database: Database, actor: Actor, upload: PartUpload) -> str:
    """Start the task that checks and keeps a complete upload; return its address."""
    intake, limits = server.intake_dir, Limits(server.largest_intake_mb, server.most_intake_files)
    title = f"Checking the upload {upload.name}"

    def work(progress: Progress) -> str:
        turn = in_turn(server.data_dir, actor.name, progress)
        try:
            place = _checked(intake, upload, limits, turn)
        except OSError as error:
            log.warning("%s failed: %s", title, error)
            raise UnavailableError(
                f"{error.strerror or error}. The server's log names the file. What was sent is kept for a day: once "
                "this is put right, choose the same file again under the same name, and it is checked again at once."
            ) from error
        entry = Entry("file uploaded", subject=f"{upload.kind}/{place.name}", detail={"bytes": upload.size})
        record_alone(database, actor.name, entry, actor.now)
        return f"/admin/files/{upload.kind}/{place.name}"

    task = task_address(start_task(database, actor, title, work, subject=f"{UPLOAD} {upload.id}"))
    note_task(intake, upload, task)
    return task


def _checked(intake: FilePath, upload: PartUpload, limits: Limits, turn: AbstractContextManager[None]) -> FilePath:
    """Put a complete upload on its shelf and return its place there; nothing that was unpacked besides is left."""
    folder = work_folder(intake, upload.id)
    with checking(intake, upload.id) as received, turn:
        shutil.rmtree(folder, ignore_errors=True)  # of an attempt that was killed
        try:
            return in_bounds(shelve, intake, upload.kind, upload.name, received, folder, limits)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

"""Take in, attach and delete entries of the intake folder, for the Files page and REST.

A file of any size comes in parts, so that a lost connection costs the part that was under way, not the file. Whoever
sends the same file again goes on where it stopped. When all is there, a task of the server checks it and puts it on its
shelf, see `app/intake/arrivals.py`.
"""

from __future__ import annotations

import logging
import shutil
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import IO, Annotated

from fastapi import Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.errors import InvalidError, NotFoundError, TooLargeError, UnavailableError
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
from app.intake.shelves import entry_path, free_path, remove_entry
from app.intake.zips import MB
from app.operations.jobs.queueing import refuse_while_used
from app.operations.studies.attach import attach
from app.operations.tasks import start_task
from app.settings import Settings
from app.store.database.engine import Database
from app.store.studies.audit import Actor, Entry, record_alone
from app.store.studies.studies import Study
from app.web.gates import settings
from app.web.limits.turns import in_turn

UPLOAD = "upload"  # begins the subject of a task that takes in an upload

log = logging.getLogger(__name__)


class NewUpload(BaseModel):
    """What is said of a file before it is sent; `modified` in ms since 1970."""

    model_config = ConfigDict(extra="forbid")

    kind: Annotated[str, Field(max_length=40, description="the shelf")]
    name: Annotated[str, Field(max_length=200, description="of the new entry")]
    file: Annotated[str, Field(max_length=300, description="its name where it comes from")]
    size: Annotated[int, Field(ge=0, lt=2**53, description="bytes")]
    modified: Annotated[int, Field(ge=-(2**53), lt=2**53, description="its last change, ms since 1970")] = 0


def begin_part_upload(server: Settings, database: Database, actor: Actor, wanted: NewUpload) -> Standing:
    """Begin an upload, or go on with the same one.

    Raises
    ------
    InvalidError, TooLargeError
        If what comes could not be kept.
    """
    name = wanted.name.strip()
    facts = (wanted.kind, name, wanted.file, wanted.size)
    upload = PartUpload(upload_id(actor.name, *facts, wanted.modified), *facts, by=actor.name)
    remove_expired(server.intake_dir, actor.now)
    _check_wanted(server, wanted, name, bytes_to_come(server.intake_dir, upload.id, wanted.size))
    begun = begin_upload(server.intake_dir, upload)
    if begun.offset == 0:
        entry = Entry("upload begun", subject=f"{wanted.kind}/{name}", detail={"bytes": wanted.size})
        record_alone(database, actor.name, entry, actor.now)
    return begun


async def add_part(
    request: Request, database: Database, actor: Actor, upload: str, offset: int
) -> tuple[Standing, str | None]:
    """Add the request's body, which begins at `offset`, to an upload; what arrives of it counts, even if it is cut off.

    Returns
    -------
    How far it is, and the id of the task that checks it once it is complete; None before.
    """
    server = settings(request)
    known = (await run_in_threadpool(standing, server.intake_dir, upload)).upload
    with suppress(ClientDisconnect), appending(server.intake_dir, upload, offset) as file:
        await _receive(request, file, known.size - offset)  # whoever was cut off asks how far it came, and goes on
    now = await run_in_threadpool(standing, server.intake_dir, upload)
    if now.offset < known.size:
        return now, None
    return now, await run_in_threadpool(_start_shelving, server, database, actor, known)


def discard_part_upload(server: Settings, database: Database, actor: Actor, upload: str) -> None:
    """Discard an upload; NotFoundError if there is none."""
    known = standing(server.intake_dir, upload).upload
    discard(server.intake_dir, upload)
    entry = Entry("upload discarded", subject=f"{known.kind}/{known.name}", detail={"begun by": known.by})
    record_alone(database, actor.name, entry, actor.now)


def entry_of(server: Settings, kind: str, name: str) -> Path:
    """Return the path of an entry that an address names.

    Raises
    ------
    NotFoundError
        If there is none.
    ForbiddenError
        If the server's user may not read it.
    """
    try:
        return entry_path(server.intake_dir, kind, name)
    except InvalidError as error:
        raise NotFoundError(error.detail) from error


def begin_attaching_entry(
    server: Settings, database: Database, actor: Actor, kind: str, name: str, study: Study
) -> str:
    """Attach a report or a table of measures to a study, in the background; return the task's id."""
    path = entry_of(server, kind, name)

    def work(_tell: Progress) -> str:
        try:
            attach(server, database, study, [path], by=actor.name, now=actor.now)
        except ValueError as error:  # names the path on the server
            raise InvalidError(str(error).replace(str(path), name)) from error
        return f"/admin/studies/{study.slug}/objective"

    return start_task(database, actor, f"Attaching {name} to {study.name}", work)


def delete_entry(server: Settings, database: Database, actor: Actor, kind: str, name: str) -> None:
    """Delete an entry for good, unless a job uses it."""
    entry_of(server, kind, name)
    with database.reading() as connection:
        refuse_while_used(connection, f"{kind}/{name}")
    remove_entry(server.intake_dir, kind, name)
    with database.writing() as connection:
        actor.note(connection, "file deleted", subject=f"{kind}/{name}")


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


def _start_shelving(server: Settings, database: Database, actor: Actor, upload: PartUpload) -> str:
    """Start the task that checks and keeps a complete upload; return its id."""
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

    task = start_task(database, actor, title, work, subject=f"{UPLOAD} {upload.id}")
    note_task(intake, upload, task)
    return task


def _checked(intake: Path, upload: PartUpload, limits: Limits, turn: AbstractContextManager[None]) -> Path:
    """Put a complete upload on its shelf and return its place there; nothing that was unpacked besides is left."""
    folder = work_folder(intake, upload.id)
    with checking(intake, upload.id) as received, turn:
        shutil.rmtree(folder, ignore_errors=True)  # of an attempt that was killed
        try:
            return in_bounds(shelve, intake, upload.kind, upload.name, received, folder, limits)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

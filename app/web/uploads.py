"""Receive uploaded files, in one request up to a limit or in parts, and begin the work on them.

A file for a shelf comes in parts, so that a lost connection costs the part that was under way, not the file. Whoever
sends the same file again goes on where it stopped. When all is there, a task of the server checks it and puts it on its
shelf, see `app/intake/arrivals.py`. The Files page and REST do the same.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import partial
from pathlib import Path
from typing import IO, Annotated, Any
from urllib.parse import quote

from fastapi import Depends, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.errors import InvalidError, NotFoundError, TooLargeError, UnavailableError
from app.ffmpeg import Progress
from app.files import WorkFolder
from app.intake.arrivals import EXPECTED, Limits, arrived_results, check_results, shelve, without_places
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
from app.intake.stimuli import read_manifest
from app.intake.zips import MB, check_zip
from app.operations.jobs.queueing import refuse_while_used
from app.operations.studies.attach import attach
from app.operations.studies.forecast import forecast
from app.operations.studies.receive_films import install_set
from app.operations.tasks import BACK, start_task
from app.operations.upkeep.travel import check_study_zip, import_study
from app.settings import Settings
from app.store.database.engine import Database
from app.store.studies.audit import Actor, Entry, record_alone
from app.store.studies.studies import Study
from app.study.options.options import StudyOptions
from app.web.gates import settings
from app.web.limits.turns import in_turn
from app.web.roles import acting_by_header

log = logging.getLogger(__name__)

UPLOAD = "upload"  # begins the subject of a task that takes in an upload
UploadingActor = Annotated[Actor, Depends(acting_by_header("experimenter"))]
CheckUpload = Callable[[Path, int], None]  # a module's function; takes what was received and the limit in MB


async def begin_attaching(request: Request, server: Settings, actor: Actor, database: Database, study: Study) -> str:
    """Receive results to attach to a study, and begin to check them; return the task's id."""
    parent, limit_mb = server.data_dir / "uploads", server.largest_upload_mb
    folder, received = await receive(request, actor, database, parent, limit_mb, check_results)

    def work(progress: Progress) -> str:
        place = Path(folder.name)
        with folder, in_turn(server.data_dir, actor.name, progress):
            try:
                paths = arrived_results(received, place, limit_mb)
                attached = attach(server, database, study, paths, by=actor.name, now=actor.now)
            except ValueError as error:  # names paths on the server
                raise InvalidError(without_places(str(error), place)) from error
        return f"/admin/studies/{study.slug}/{'objective' if attached['reports'] else 'models'}"

    return await run_in_threadpool(start_task, database, actor, "Checking the uploaded results", work)


async def begin_installing(
    request: Request,
    server: Settings,
    actor: Actor,
    database: Database,
    name: str,
    *,
    is_conformed: bool,
    untagged_range: str,
    is_for_study: bool = False,
) -> str:
    """Receive films or a stimulus set, and begin to look at them; return the task's id.

    Parameters
    ----------
    is_for_study : the task leads on to the form of a study of them, and a name that is taken gets a number
    """
    folder, packed = await receive(request, actor, database, server.sets_dir, server.largest_upload_mb, check_zip)

    def work(progress: Progress) -> str:
        with folder, in_turn(server.data_dir, actor.name, progress):
            unpacked = Path(folder.name) / "unpacked"
            told: dict[str, Any] = {
                "is_wish": is_for_study,
                "is_conformed": is_conformed,
                "untagged_range": untagged_range,
            }
            made = install_set(server, packed, unpacked, progress, name=name, **told)
        record_alone(database, actor.name, Entry("stimulus set uploaded", subject=made), actor.now)
        if is_for_study:  # whose form shows it: it is measured once
            forecast(server, read_manifest(server.sets_dir / made), StudyOptions(), None)
        return f"/admin/studies/new?stimulus_set={quote(made)}" if is_for_study else f"/admin/sets/{quote(made)}"

    begin = partial(start_task, kept={BACK: "/admin/studies/new" if is_for_study else "/admin/sets#upload"})
    return await run_in_threadpool(begin, database, actor, "Looking at the uploaded films", work)


async def begin_importing(request: Request, server: Settings, actor: Actor, database: Database, name: str) -> str:
    """Receive a whole study, and begin to bring it in; return the task's id."""
    parent, limit_mb = server.data_dir / "uploads", server.largest_upload_mb
    folder, packed = await receive(request, actor, database, parent, limit_mb, check_study_zip)

    def work(progress: Progress) -> str:
        with folder, in_turn(server.data_dir, actor.name, progress):
            made = import_study(server, database, packed, Path(folder.name), actor, name=name, progress=progress)
        return f"/admin/studies/{made['slug']}"

    return await run_in_threadpool(start_task, database, actor, "Bringing in the study", work)


async def receive(
    request: Request, actor: Actor, database: Database, parent: Path, largest_mb: int, check: CheckUpload
) -> tuple[WorkFolder, Path]:
    """Receive an upload into a temporary folder, which the caller removes, and check it.

    Parameters
    ----------
    parent : where the folder is made

    Raises
    ------
    InvalidError, TooLargeError
        If `check` refuses it, or it is larger than the limit; the audit log then records it.
    """
    folder = WorkFolder(".upload-", parent)
    received = Path(folder.name) / "upload"
    try:
        _check_announced(request, largest_mb)
        await _receive(request, received, largest_mb)
        await run_in_threadpool(in_bounds, check, received, largest_mb)
    except BaseException as error:
        await run_in_threadpool(folder.cleanup)
        if not isinstance(error, InvalidError | TooLargeError):  # the connection was lost, for example
            raise
        entry = Entry("upload refused", subject=request.url.path, detail={"reason": error.detail})
        await run_in_threadpool(record_alone, database, actor.name, entry, actor.now)
        raise
    return folder, received


def _check_announced(request: Request, largest_mb: int) -> None:
    announced = request.headers.get("content-length", "0")
    if announced.isdigit() and int(announced) > largest_mb * MB:
        raise TooLargeError(f"The upload has {int(announced) // MB} MB; this server takes {largest_mb} MB at most.")


async def _receive(request: Request, path: Path, largest_mb: int) -> None:
    n_received = 0
    with path.open("wb") as file:
        async for chunk in request.stream():
            n_received += len(chunk)
            if n_received > largest_mb * MB:
                raise TooLargeError(f"The upload has more than {largest_mb} MB, which is all this server takes.")
            await run_in_threadpool(file.write, chunk)


class NewUpload(BaseModel):
    """What is said of a file before it is sent; `modified` in ms since 1970."""

    model_config = ConfigDict(extra="forbid", strict=True)

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
        await _receive_part(request, file, known.size - offset)  # whoever was cut off asks how far it came, and goes on
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


async def _receive_part(request: Request, file: IO[bytes], most: int) -> None:
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

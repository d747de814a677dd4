"""Receive uploaded files in one request, up to a limit, and begin the work on them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import Depends, Request
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError, TooLargeError
from app.ffmpeg import Progress
from app.files import WorkFolder
from app.intake.arrivals import arrived_results, check_results, without_places
from app.intake.bounds import in_bounds
from app.intake.stimuli import read_manifest
from app.intake.zips import MB, check_zip
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
from app.web.limits.turns import in_turn
from app.web.roles import acting_by_header

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

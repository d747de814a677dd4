"""Receive uploaded files in one request, up to a limit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError, TooLargeError
from app.files import WorkFolder
from app.intake.bounds import in_bounds
from app.intake.zips import MB
from app.store.database.engine import Database
from app.store.studies.audit import Actor, Entry, record_alone
from app.web.roles import acting_by_header

UploadingActor = Annotated[Actor, Depends(acting_by_header("experimenter"))]
CheckUpload = Callable[[Path, int], None]  # a module's function; takes what was received and the limit in MB


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

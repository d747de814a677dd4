"""Receive uploaded files safely: limits on packed and unpacked size, number of files and names."""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import IO, Annotated

from fastapi import Depends, Request
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError, TooLargeError
from app.store.audit import Actor, Entry, record_alone
from app.store.engine import Database
from app.web.gates import acting_by_header

MB = 1024 * 1024
MOST_FILES = 2000  # in an upload
MOST_RATIO = 200  # unpacked to packed; films and models hardly compress
PLAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,99}")
CHUNK = 1024 * 1024
DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError)  # the last: encrypted, or an unknown compression

UploadingActor = Annotated[Actor, Depends(acting_by_header("experimenter"))]
CheckFile = Callable[[Path, str], None]  # takes an unpacked file and its name in the upload
CheckUpload = Callable[[Path, int], None]  # takes what was received and the limit in MB


async def receive(
    request: Request, actor: Actor, database: Database, parent: Path, largest_mb: int, check: CheckUpload
) -> tuple[TemporaryDirectory[str], Path]:
    """Receive an upload into a temporary folder, which the caller removes, and check it.

    Parameters
    ----------
    parent : where the folder is made

    Raises
    ------
    InvalidError, TooLargeError
        If `check` refuses it, or it is larger than the limit; the audit log then records it.
    """
    parent.mkdir(parents=True, exist_ok=True)
    folder = TemporaryDirectory(prefix=".upload-", dir=parent)
    received = Path(folder.name) / "upload"
    try:
        _check_announced(request, largest_mb)
        await _receive(request, received, largest_mb)
        await run_in_threadpool(check, received, largest_mb)
    except BaseException as error:
        await run_in_threadpool(folder.cleanup)
        if not isinstance(error, InvalidError | TooLargeError):  # the connection was lost, for example
            raise
        entry = Entry("upload refused", subject=request.url.path, detail={"reason": error.detail})
        await run_in_threadpool(record_alone, database, actor.name, entry, actor.now)
        raise
    return folder, received


def check_zip(packed: Path, largest_mb: int) -> None:
    """Check an upload before unpacking any of it.

    Raises
    ------
    InvalidError
        If it is not a zip file of plain names: names the file in it.
    TooLargeError
        If it would unpack to more than the limit.
    """
    try:
        with zipfile.ZipFile(packed) as archive:
            _check_entries([entry for entry in archive.infolist() if not entry.is_dir()], largest_mb)
    except zipfile.BadZipFile as error:
        raise InvalidError("This is not a zip file.") from error


def unpack(packed: Path, out: Path, limit: int, check: CheckFile) -> None:
    """Unpack below `out`; the sizes in the headers are not trusted.

    Raises
    ------
    InvalidError
        If the zip file is damaged or encrypted, or `check` refuses a file.
    TooLargeError
        If it unpacks to more than `limit` bytes.
    """
    try:
        with zipfile.ZipFile(packed) as archive:
            _unpack(archive, out, limit, check)
    except DAMAGED as error:
        raise InvalidError(f"The zip file is damaged or encrypted: {error}. Pack it again, then repeat.") from error


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


def _check_entries(entries: list[zipfile.ZipInfo], largest_mb: int) -> None:
    if not 1 <= len(entries) <= MOST_FILES:
        raise InvalidError(f"The zip file holds {len(entries)} files; expected 1 to {MOST_FILES}.")
    for entry in entries:
        parts = PurePosixPath(entry.filename).parts
        if not all(PLAIN_NAME.fullmatch(part) for part in parts) or len(parts) > 5:
            raise InvalidError(f"The name {entry.filename[:120]!r} in the zip file is not plain letters and digits.")
        if entry.file_size > MOST_RATIO * max(entry.compress_size, 1) + MB:
            raise InvalidError(f"{entry.filename} unpacks to {entry.file_size // MB} MB, far more than such files do.")
    if (total := sum(entry.file_size for entry in entries)) > largest_mb * MB:
        raise TooLargeError(f"The zip file unpacks to {total // MB} MB; this server takes {largest_mb} MB at most.")


def _unpack(archive: zipfile.ZipFile, out: Path, limit: int, check: CheckFile) -> None:
    entries = [entry for entry in archive.infolist() if not entry.is_dir()]
    left = limit
    for entry in entries:
        path = out.joinpath(*PurePosixPath(entry.filename).parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(entry) as source, path.open("xb") as target:
            for chunk in _chunks(source):
                left -= len(chunk)
                if left < 0:
                    raise TooLargeError(f"The zip file unpacks to more than {limit // MB} MB.")
                target.write(chunk)
        check(path, entry.filename)


def _chunks(source: IO[bytes]) -> Iterator[bytes]:
    while chunk := source.read(CHUNK):
        yield chunk

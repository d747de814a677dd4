"""Stimulus sets on the server: those in its folder, and new ones as uploaded zip files.

A name from outside never becomes a path: sets are chosen from what is there, and files of an upload are named by us
wherever their own name is not plain.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import IO, Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import JSONResponse, Response
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError, NotFoundError, StimuliError, TooLargeError
from app.operate import slugify
from app.settings import Settings
from app.stimuli import MANIFEST, read_stimulus_set
from app.store.audit import Actor, Entry, record_alone
from app.web.admin.jobs import Tell, start_job
from app.web.admin.shell import page
from app.web.gates import Person, Store, acting_by_header, settings

MB = 1024 * 1024
MOST_FILES = 2000  # in an upload
MOST_RATIO = 200  # unpacked to packed; films hardly pack at all
PLAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,99}")
CHUNK = 1024 * 1024

router = APIRouter(prefix="/admin", include_in_schema=False)
UploadingActor = Annotated[Actor, Depends(acting_by_header("experimenter"))]


@dataclass(frozen=True)
class KnownSet:
    """A stimulus set that a study can be made of."""

    name: str
    title: str
    n_datasets: int
    n_conditions: int
    n_stimuli: int
    size: str


def known_sets(of: Settings) -> list[KnownSet]:
    """The stimulus sets in the server's folder, by name; what is not readable is left out."""
    folders = sorted(of.sets_dir.iterdir()) if of.sets_dir.is_dir() else []
    return [found for folder in folders if (found := _known_set(folder)) is not None]


def set_folder(of: Settings, name: str) -> Path:
    """The folder of a known set.

    Raises
    ------
    NotFoundError
        If there is no set of this name.
    """
    if name not in {known.name for known in known_sets(of)}:
        raise NotFoundError("There is no stimulus set of this name on the server.")
    return of.sets_dir / name


@router.get("/sets")
def sets_page(request: Request, person: Person) -> Response:
    own = settings(request)
    return page(request, "sets", person, {"sets": known_sets(own), "largest_mb": own.largest_upload_mb})


@router.put("/stimuli/upload")
async def upload(request: Request, actor: UploadingActor, database: Store) -> Response:
    """Take a zipped stimulus set; it is unpacked and checked in the background."""
    own = settings(request)
    own.sets_dir.mkdir(parents=True, exist_ok=True)
    folder = TemporaryDirectory(prefix=".upload-", dir=own.sets_dir)
    packed = Path(folder.name) / "upload.zip"
    try:
        _check_announced(request, own.largest_upload_mb)
        await _receive(request, packed, own.largest_upload_mb)
        await run_in_threadpool(check_zip, packed, own.largest_upload_mb)
    except BaseException as error:
        await run_in_threadpool(folder.cleanup)
        if not isinstance(error, InvalidError | TooLargeError):  # the connection was lost, for example
            raise
        entry = Entry("upload refused", detail={"reason": error.detail})
        await run_in_threadpool(record_alone, database, actor.name, entry, actor.now)
        raise

    def work(tell: Tell) -> str:
        with folder:
            name = install_set(own, packed, Path(folder.name) / "unpacked", tell)
        record_alone(database, actor.name, Entry("stimulus set uploaded", subject=name), actor.now)
        return "/admin/sets"

    job = await run_in_threadpool(start_job, request, database, actor, "Checking the uploaded stimulus set", work)
    return JSONResponse({"job": f"/admin/jobs/{job}"}, 202)


def check_zip(packed: Path, largest_mb: int) -> None:
    """Check an upload before anything of it is unpacked.

    Raises
    ------
    InvalidError
        If it is not a zip file of a stimulus set: names the file in it.
    TooLargeError
        If it would unpack to more than the limit.
    """
    try:
        with zipfile.ZipFile(packed) as archive:
            _check_entries([entry for entry in archive.infolist() if not entry.is_dir()], largest_mb)
    except zipfile.BadZipFile as error:
        raise InvalidError("This is not a zip file.") from error


def install_set(of: Settings, packed: Path, unpacked: Path, tell: Tell) -> str:
    """Unpack an upload, check it as any stimulus set, and give it its place; its name.

    Raises
    ------
    ValueError, TooLargeError
        If it is not a whole stimulus set, or there is one of its name.
    """
    with zipfile.ZipFile(packed) as archive:
        _unpack(archive, unpacked, of.largest_upload_mb * MB)
    found = read_stimulus_set(unpacked, tell)
    name = slugify(found.name)
    if (of.sets_dir / name).exists():
        raise StimuliError(f"there is a stimulus set {name!r} already; give this one another name in its manifest")
    unpacked.rename(of.sets_dir / name)
    return name


def _known_set(folder: Path) -> KnownSet | None:
    if folder.name.startswith(".") or not folder.is_dir():
        return None
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        stimuli = manifest["stimuli"]
        datasets, conditions = ({str(one[key]) for one in stimuli} for key in ("dataset", "approach"))
        first = stimuli[0]
        size = f"{first['width']}×{first['height']}, {first['n_frames'] / first['fps']:g} s"
        return KnownSet(folder.name, str(manifest["name"]), len(datasets), len(conditions), len(stimuli), size)
    except (OSError, ValueError, KeyError, TypeError, IndexError, ZeroDivisionError):
        return None


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
            raise InvalidError(f"{entry.filename} unpacks to {entry.file_size // MB} MB, far more than films do.")
    if (total := sum(entry.file_size for entry in entries)) > largest_mb * MB:
        raise TooLargeError(f"The zip file unpacks to {total // MB} MB; this server takes {largest_mb} MB at most.")


def _unpack(archive: zipfile.ZipFile, out: Path, limit: int) -> None:
    """Unpack below `out`, without the folder that all may lie in; what headers say of sizes is not believed."""
    entries = [entry for entry in archive.infolist() if not entry.is_dir()]
    heads = {PurePosixPath(entry.filename).parts[0] for entry in entries}
    skip = 1 if len(heads) == 1 and all("/" in entry.filename for entry in entries) else 0
    left = limit
    for entry in entries:
        path = out.joinpath(*PurePosixPath(entry.filename).parts[skip:])
        path.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(entry) as source, path.open("xb") as target:
            for chunk in _chunks(source):
                left -= len(chunk)
                if left < 0:
                    raise TooLargeError(f"The zip file unpacks to more than {limit // MB} MB.")
                target.write(chunk)
        _check_content(path, entry.filename)


def _chunks(source: IO[bytes]) -> Iterator[bytes]:
    while chunk := source.read(CHUNK):
        yield chunk


def _check_content(path: Path, name: str) -> None:
    """Believe a file's content, not its name."""
    with path.open("rb") as file:
        head = file.read(16)
    if path.suffix.lower() in (".mp4", ".mov") and head[4:8] != b"ftyp":
        raise InvalidError(f"{name} is not an MP4 film, whatever its name says.")
    if path.suffix.lower() not in (".mp4", ".mov", ".mkv", ".webm", ".json", ".csv", ".txt", ".md"):
        raise InvalidError(f"{name} is no part of a stimulus set; expected films, manifest.json and texts.")

"""List the server's stimulus sets, and upload new ones as zip files.

A name from outside never becomes a path: sets are chosen from the list, and names in an upload must be plain.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError, NotFoundError, StimuliError
from app.ffmpeg import Progress
from app.intake.stimuli import MANIFEST, read_stimulus_set
from app.operations.create import slugify
from app.settings import Settings
from app.store.audit import Entry, record_alone
from app.web.admin.jobs import start_job
from app.web.admin.layout import page
from app.web.admin.uploads import MB, UploadingActor, check_zip, receive, unpack
from app.web.gates import Person, Store, settings

router = APIRouter(prefix="/admin", include_in_schema=False)


@dataclass(frozen=True)
class KnownSet:
    """A stimulus set on the server, to make studies of."""

    name: str
    title: str
    datasets: tuple[str, ...]
    n_conditions: int
    n_stimuli: int
    size: str


def known_sets(server: Settings) -> list[KnownSet]:
    """Return the stimulus sets in the server's folder, by name; unreadable ones are left out."""
    folders = sorted(server.sets_dir.iterdir()) if server.sets_dir.is_dir() else []
    return [known for folder in folders if (known := _known_set(folder)) is not None]


def set_folder(server: Settings, name: str) -> Path:
    """Return the folder of a known set.

    Raises
    ------
    NotFoundError
        If no set has this name.
    """
    if name not in {known.name for known in known_sets(server)}:
        raise NotFoundError("There is no stimulus set of this name on the server.")
    return server.sets_dir / name


@router.get("/sets")
def sets_page(request: Request, person: Person) -> Response:
    server = settings(request)
    return page(request, "sets", person, {"sets": known_sets(server), "largest_mb": server.largest_upload_mb})


@router.put("/stimuli/upload")
async def upload(request: Request, actor: UploadingActor, database: Store) -> Response:
    """Take a zipped stimulus set; it is unpacked and checked in the background."""
    server = settings(request)
    folder, packed = await receive(request, actor, database, server.sets_dir, server.largest_upload_mb, check_zip)

    def work(progress: Progress) -> str:
        with folder:
            name = install_set(server, packed, Path(folder.name) / "unpacked", progress)
        record_alone(database, actor.name, Entry("stimulus set uploaded", subject=name), actor.now)
        return "/admin/sets"

    job = await run_in_threadpool(start_job, database, actor, "Checking the uploaded stimulus set", work)
    return JSONResponse({"job": f"/admin/jobs/{job}"}, 202)


def install_set(server: Settings, packed: Path, unpacked: Path, progress: Progress) -> str:
    """Unpack an upload, check it like any stimulus set, move it to its place, and return its name.

    Raises
    ------
    ValueError, TooLargeError
        If it is not a complete stimulus set, or its name is taken.
    """
    unpack(packed, unpacked, server.largest_upload_mb * MB, _check_content)
    inside = list(unpacked.iterdir())
    folder = inside[0] if len(inside) == 1 and inside[0].is_dir() else unpacked  # a zip file may hold one folder
    stimulus_set = read_stimulus_set(folder, progress)
    name = slugify(stimulus_set.name)
    if (server.sets_dir / name).exists():
        raise StimuliError(f"there is a stimulus set {name!r} already; give this one another name in its manifest")
    folder.rename(server.sets_dir / name)
    return name


def _known_set(folder: Path) -> KnownSet | None:
    if folder.name.startswith(".") or not folder.is_dir():
        return None
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        stimuli = manifest["stimuli"]
        datasets, conditions = (
            tuple(dict.fromkeys(str(stimulus[key]) for stimulus in stimuli)) for key in ("dataset", "approach")
        )
        first = stimuli[0]
        size = f"{first['width']}×{first['height']}, {first['n_frames'] / first['fps']:g} s"
        return KnownSet(folder.name, str(manifest["name"]), datasets, len(conditions), len(stimuli), size)
    except (OSError, ValueError, KeyError, TypeError, IndexError, ZeroDivisionError):
        return None


def _check_content(path: Path, name: str) -> None:
    """Refuse a file whose content does not belong to a stimulus set, whatever its name."""
    with path.open("rb") as file:
        head = file.read(16)
    if path.suffix.lower() in (".mp4", ".mov") and head[4:8] != b"ftyp":
        raise InvalidError(f"{name} is not an MP4 film, whatever its name says.")
    if path.suffix.lower() not in (".mp4", ".mov", ".mkv", ".webm", ".json", ".csv", ".txt", ".md"):
        raise InvalidError(f"{name} is no part of a stimulus set; expected films, manifest.json and texts.")

"""Show what lies in the server's intake folder, and what jobs made of it; delete entries."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated
from urllib.parse import quote

from anyio import CapacityLimiter, to_thread
from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import FileResponse, Response

from app.errors import ForbiddenError, InvalidError, NotFoundError, StimuliError, said_on_page
from app.files import read_json
from app.films.strips import write_picture
from app.intake.arrivals import EXPECTED
from app.intake.captures import CaptureOutline, picture_path, read_outline
from app.intake.contents import PLAYABLE, read_contents
from app.intake.part_uploads import unfinished
from app.intake.reports import REPORT, TABLE
from app.intake.shelves import KINDS, ShelfEntry, entries, entry_path, file_in
from app.intake.summaries import ANALYSIS, SUMMARIES
from app.intake.treatment import preview_of
from app.operations.jobs.kinds import kinds_for
from app.operations.jobs.queueing import uses
from app.settings import Settings
from app.store.database.engine import Database
from app.store.queue import OPEN, QueuedJob, list_jobs
from app.store.studies.studies import Study, all_studies
from app.web.admin.background import task_address
from app.web.admin.layout import page, see, viewing
from app.web.gates import Store, settings
from app.web.media import SANDBOX
from app.web.roles import Acting, Person, study_called
from app.web.uploads import begin_attaching_entry, delete_entry, entry_of

TITLES = {
    "captures": "Captures and other recordings",
    "calibration": "Pictures of calibration boards",
    "models": "Models by other programs",
    "films": "Films",
    "clouds": "Clouds",
    "measures": "Tables of measures",
    "votes": "Tables of votes and ratings",
    "runs": "What jobs made",
}
SHOWN_TYPES = {  # of files that a page may show; others are downloaded
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".webp": "image/webp",
    ".svg": "image/svg+xml",
    ".mp4": "video/mp4",
    ".webm": "video/webm",
    ".html": "text/html; charset=utf-8",
    ".ply": "application/octet-stream",
}
MOST_THUMBNAILS = 12  # of a camera
THUMBNAIL_WIDTH = 240  # pixels
LISTED_FILES = 500
PICTURES = CapacityLimiter(4)  # pictures at once; decoding takes seconds, and no other request may wait for it

Kind = Annotated[str, Path(max_length=40)]
Name = Annotated[str, Path(max_length=120)]

router = APIRouter(prefix="/admin/files", include_in_schema=False)


@router.get("")
def files_page(request: Request, person: Person) -> Response:
    server = settings(request)
    shelves = {kind: _listed(server.intake_dir, kind) for kind in KINDS}
    context = {
        "shelves": {kind: listed for kind, (listed, _) in shelves.items()},
        "faults": [fault for _, fault in shelves.values() if fault],
        "titles": TITLES,
        "expected": EXPECTED,
        "unfinished": unfinished(server.intake_dir),
        "intake": server.intake_dir.absolute(),
        "largest_mb": server.largest_intake_mb,
    }
    return page(request, "files", person, context)


@router.get("/{kind}/{name}")
def entry_page(request: Request, person: Person, kind: Kind, name: Name, store: Store) -> Response:
    """Show an entry: thumbnails of a capture, and the films, pictures, models, reports and tables in it."""
    path = entry_of(settings(request), kind, name)
    base = entry_address(kind, name)
    contents = read_contents(path)
    outline, fault = (None, "") if kind != "captures" else _outline(path)
    models = [
        {**asdict(model), "error_limit_mm": None, "url": _file_address(base, model.place)} for model in contents.models
    ]
    context = {
        "kind": kind,
        "name": name,
        "title": TITLES[kind],
        "base": base,
        "summary": SUMMARIES[kind](path),
        "contents": contents,
        "pictures": [] if outline else contents.pictures,
        "models": models,
        "datasets": list(dict.fromkeys(model["dataset"] for model in models)),
        "outline": outline,
        "fault": fault,
        "frames": _spread(outline.n_frames) if outline else [],
        "studies": _studies(store) if kind != "votes" and _is_attachable(path) else [],
        "jobs": _open_jobs(store, kind, name),
        "starts": []
        if any((path / made).is_file() for made in (REPORT, ANALYSIS))
        else kinds_for(settings(request), kind, name),
        "listed": list(contents.sizes.items())[:LISTED_FILES],
        "address": lambda place: _file_address(base, place),
        "film_address": lambda place: _film_address(base, place),
        "preview_address": lambda place: f"{base}/preview/{quote(place)}",
    }
    return viewing(page(request, "file_entry", person, context), models)


@router.get("/{kind}/{name}/file/{place:path}")
def entry_file(
    request: Request, _person: Person, kind: Kind, name: Name, place: Annotated[str, Path(max_length=1000)]
) -> Response:
    """Serve a file of an entry: shown where a browser can do no harm with it, else as a download."""
    try:
        path = file_in(settings(request).intake_dir, kind, name, place)
    except InvalidError as error:
        raise NotFoundError(error.detail) from error
    media_type = SHOWN_TYPES.get(path.suffix.lower())
    headers = {
        "Cache-Control": "private, no-cache",
        "Content-Security-Policy": SANDBOX,
        "X-Frame-Options": "SAMEORIGIN",
    }
    if media_type is None:
        return FileResponse(path, filename=path.name, media_type="application/octet-stream", headers=headers)
    return FileResponse(path, media_type=media_type, headers=headers)


@router.get("/{kind}/{name}/preview/{place:path}")
async def preview(
    request: Request, _person: Person, kind: Kind, name: Name, place: Annotated[str, Path(max_length=1000)]
) -> Response:
    """Show the beginning of a film that browsers do not play, encoded for them."""
    path = await to_thread.run_sync(partial(_preview, settings(request), kind, name, place), limiter=PICTURES)
    headers = {"Cache-Control": "private, max-age=3600", "Content-Security-Policy": SANDBOX}
    return FileResponse(path, media_type="video/mp4", headers=headers)


def _preview(server: Settings, kind: str, name: str, place: str) -> FilePath:
    try:
        source = file_in(server.intake_dir, kind, name, place)
    except InvalidError as error:
        raise NotFoundError(error.detail) from error
    try:
        return preview_of(source, server.data_dir / "stills")
    except StimuliError as error:
        reason = said_on_page(error).replace(f"{source}", source.name)
        raise InvalidError(f"{place} cannot be shown: {reason}") from error


@router.get("/captures/{name}/pictures/{sensor}/{side}/{frame}.jpg")
async def picture(
    request: Request,
    _person: Person,
    name: Name,
    sensor: Annotated[str, Path(max_length=40)],
    side: Annotated[str, Path(max_length=10)],
    frame: Annotated[str, Path(max_length=8)],
    small: bool = False,
) -> Response:
    """Show a picture of a capture as JPEG, in full size or as a thumbnail."""
    make = partial(_picture, settings(request), name, sensor, side, frame, small=small)
    path = await to_thread.run_sync(make, limiter=PICTURES)
    return FileResponse(path, media_type="image/jpeg", headers={"Cache-Control": "private, max-age=3600"})


def _picture(server: Settings, name: str, sensor: str, side: str, frame: str, *, small: bool) -> FilePath:
    try:
        folder = entry_path(server.intake_dir, "captures", name)
        outline = read_outline(folder)
        camera, number = outline.camera(sensor, side), outline.frame(frame)
        place = picture_path(folder, camera, number).relative_to(folder).as_posix()
        source = file_in(server.intake_dir, "captures", name, place)
    except InvalidError as error:
        raise NotFoundError(error.detail) from error
    fact = source.stat()
    width = THUMBNAIL_WIDTH if small else camera.width
    told = f"{source} {fact.st_mtime_ns} {fact.st_size} {number} {width}"
    path = server.data_dir / "stills" / f"capture-{hashlib.sha256(told.encode()).hexdigest()[:32]}.jpg"
    if not path.is_file():
        try:
            write_picture(source, path, frame=number if camera.is_video else 0, width=width)
        except StimuliError as error:
            raise InvalidError(f"{place} cannot be shown: it is damaged, too large, or ends before.") from error
    return path


@router.post("/{kind}/{name}/attach")
def attach_to_study(
    request: Request,
    actor: Acting,
    kind: Kind,
    name: Name,
    store: Store,
    study: Annotated[str, Form(max_length=100)],
) -> Response:
    """Attach a report or a table of measures to a study, in the background."""
    chosen = study_called(request, study)
    return see(task_address(begin_attaching_entry(settings(request), store, actor, kind, name, chosen)))


@router.post("/{kind}/{name}/delete")
def delete(
    request: Request,
    actor: Acting,
    kind: Kind,
    name: Name,
    store: Store,
    again: Annotated[str, Form(max_length=120)],
) -> Response:
    entry_of(settings(request), kind, name)
    if again.strip() != name:
        raise InvalidError(f"Nothing was deleted: type {name} to delete it for good.")
    delete_entry(settings(request), store, actor, kind, name)
    return see("/admin/files")


def entry_address(kind: str, name: str) -> str:
    """Return the address of an entry's page."""
    return f"/admin/files/{kind}/{quote(name)}"


def _listed(folder: FilePath, kind: str) -> tuple[list[ShelfEntry], str]:
    """Return the entries of a shelf, or why they cannot be listed."""
    try:
        return entries(folder, kind), ""
    except ForbiddenError as error:
        return [], error.detail


def _is_attachable(path: FilePath) -> bool:
    """Tell a table of measures and what `reconstudy validate` wrote from other entries."""
    if path.suffix.lower() == ".csv" or (path / TABLE).is_file():
        return True
    try:
        return "measures" in read_json(path / REPORT)
    except ValueError:
        return False


def _studies(store: Database) -> list[Study]:
    with store.reading() as connection:
        return [study for study in all_studies(connection) if study.standing != "archived"]


def _open_jobs(store: Database, kind: str, name: str) -> list[QueuedJob]:
    """Return the jobs that wait or run and read, make or change an entry."""
    with store.reading() as connection:
        jobs = list_jobs(connection, states=OPEN)
    return [job for job in jobs if f"{kind}/{name}" in uses(job)]


def _file_address(base: str, place: str) -> str:
    return f"{base}/file/{quote(place)}"


def _film_address(base: str, place: str) -> str:
    """Return where a browser finds a film that it plays: the file, or a preview."""
    is_playable = place.lower().endswith(PLAYABLE)
    return _file_address(base, place) if is_playable else f"{base}/preview/{quote(place)}"


def _outline(folder: FilePath) -> tuple[CaptureOutline | None, str]:
    """Return a capture's outline, or why it has none."""
    try:
        return read_outline(folder), ""
    except InvalidError as error:
        return None, error.detail


def _spread(n_frames: int) -> list[int]:
    """Return up to twelve frames, from the first to the last."""
    n_shown = min(n_frames, MOST_THUMBNAILS)
    return [round(index * (n_frames - 1) / max(n_shown - 1, 1)) for index in range(n_shown)]

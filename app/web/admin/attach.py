"""Upload zipped reports of objective evaluation and models, as `reconstudy study attach` takes them."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError
from app.ffmpeg import Progress
from app.intake.models import FOLDERS
from app.intake.reports import REPORT
from app.operations.attach import attach
from app.web.admin.jobs import start_job
from app.web.admin.uploads import MB, UploadingActor, receive_zip, unpack
from app.web.gates import AStudy, Store, settings

STARTS = {  # how a file of each kind begins
    ".ply": (b"ply\n",),
    ".png": (b"\x89PNG\r\n\x1a\n",),
    ".pdf": (b"%PDF-",),
    ".svg": (b"<svg", b"<?xml"),
    ".json": (b"",),
    ".csv": (b"",),
    ".html": (b"",),  # a report's page, which is not kept
    ".txt": (b"",),
}

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)


@router.put("/upload")
async def upload_results(request: Request, actor: UploadingActor, study: AStudy, database: Store) -> Response:
    """Take zipped reports and models; they are unpacked, checked and attached in the background."""
    server = settings(request)
    folder, packed = await receive_zip(request, actor, database, server.data_dir / "uploads", server.largest_upload_mb)

    def work(_tell: Progress) -> str:
        unpacked = Path(folder.name) / "unpacked"
        with folder:
            unpack(packed, unpacked, server.largest_upload_mb * MB, check_content)
            try:
                attached = attach(server, database, study, result_folders(unpacked), by=actor.name, now=actor.now)
            except ValueError as error:  # names paths on the server
                raise InvalidError(
                    str(error).replace(f"{unpacked}/", "").replace(str(unpacked), "the zip file")
                ) from error
        return f"/admin/studies/{study.slug}/{'objective' if attached['reports'] else 'models'}"

    job = await run_in_threadpool(start_job, database, actor, "Checking the uploaded results", work)
    return JSONResponse({"job": f"/admin/jobs/{job}"}, 202)


def result_folders(folder: Path) -> list[Path]:
    """Return the folders of reports and of models, at any depth of an upload.

    Raises
    ------
    ValueError
        If there is none, or a folder holds both.
    """
    reports = {path.parent for path in folder.rglob(REPORT)}
    models = {path.parent for name in FOLDERS.values() for path in folder.rglob(name) if path.is_dir()}
    if both := reports & models:
        raise ValueError(f"{min(both)}: holds a report and models; put them into two folders")
    if not reports | models:
        raise ValueError(
            f"{folder}: holds neither a report ({REPORT}) nor models (meshes/DATASET/CONDITION.ply); pack the folders "
            "that `reconstudy validate` and `reconstudy models` wrote"
        )
    return sorted(reports | models)


def check_content(path: Path, name: str) -> None:
    """Refuse a file whose content belongs to neither reports nor models, whatever its name.

    Raises
    ------
    InvalidError
        If it is nothing that belongs to reports or models.
    """
    starts = STARTS.get(path.suffix)
    if starts is None:
        raise InvalidError(f"{name} is no part of reports or models; expected {', '.join(STARTS)}.")
    with path.open("rb") as file:
        head = file.read(16)
    if not head.startswith(starts):
        raise InvalidError(f"{name} is no {path.suffix[1:].upper()} file, whatever its name says.")
    if path.suffix == ".svg" and b"<script" in path.read_bytes().lower():
        raise InvalidError(f"{name} holds a script, which a figure needs not; leave it out.")

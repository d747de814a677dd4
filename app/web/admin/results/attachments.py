"""Upload tables of measures, and zipped reports and models, as `reconstudy study attach` takes them."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError
from app.ffmpeg import Progress
from app.intake.bounds import in_bounds
from app.intake.models import FOLDERS
from app.intake.reports import REPORT, TABLE
from app.intake.zips import MB, check_zip, is_zip, unpack
from app.operations.studies.attach import attach
from app.operations.tasks import start_task
from app.web.admin.uploads import UploadingActor, receive
from app.web.gates import Store, settings
from app.web.roles import AStudy

BELONGING = (".ply", ".png", ".pdf", ".svg", ".json", ".csv", ".html", ".txt")  # a report's page is not kept
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # how such a text begins

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)


@router.put("/upload")
async def upload_results(request: Request, actor: UploadingActor, study: AStudy, database: Store) -> Response:
    """Take a table of measures, or zipped reports and models; they are checked and attached in the background."""
    server = settings(request)
    parent, limit_mb = server.data_dir / "uploads", server.largest_upload_mb
    folder, received = await receive(request, actor, database, parent, limit_mb, check_results)

    def work(_tell: Progress) -> str:
        unpacked, table = Path(folder.name) / "unpacked", Path(folder.name) / "table.csv"
        with folder:
            if is_zip(received):
                in_bounds(unpack, received, unpacked, limit_mb * MB, BELONGING, "reports or models")
            else:
                received.rename(table)
            try:
                paths = [table] if table.exists() else results_in(unpacked)
                attached = attach(server, database, study, paths, by=actor.name, now=actor.now)
            except ValueError as error:  # names paths on the server
                told = str(error).replace(f"{unpacked}/", "").replace(str(unpacked), "the zip file")
                raise InvalidError(told.replace(str(table), "the table")) from error
        return f"/admin/studies/{study.slug}/{'objective' if attached['reports'] else 'models'}"

    task = await run_in_threadpool(start_task, database, actor, "Checking the uploaded results", work)
    return JSONResponse({"job": f"/admin/jobs/{task}"}, 202)


def check_results(path: Path, largest_mb: int) -> None:
    """Check an upload of results before any of it is unpacked or read.

    Raises
    ------
    InvalidError, TooLargeError
        If it is neither a table nor a zip file of plain names that unpacks to less than the limit.
    """
    if is_zip(path):
        check_zip(path, largest_mb)
        return
    with path.open("rb") as file:
        head = file.read(1024)
    if b"\0" in head and not head.startswith(UTF_16):
        raise InvalidError("This is neither a zip file nor a table in CSV.")


def results_in(folder: Path) -> list[Path]:
    """Return the folders of reports and of models, and tables of measures outside them, at any depth of an upload.

    Raises
    ------
    ValueError
        If there is none, or a folder holds both.
    """
    reports = {path.parent for path in folder.rglob(REPORT)}
    tables = {path for path in folder.rglob(TABLE) if path.parent not in reports}
    models = {path.parent for name in FOLDERS.values() for path in folder.rglob(name) if path.is_dir()}
    if both := reports & models:
        raise ValueError(f"{min(both)}: holds a report and models; put them into two folders")
    if not reports | models | tables:
        raise ValueError(
            f"{folder}: holds neither a report ({REPORT}), nor a table of measures ({TABLE}), nor models "
            "(meshes/DATASET/CONDITION.ply); pack the folders that `reconstudy validate` and `reconstudy models` wrote"
        )
    return sorted(reports | models | tables)

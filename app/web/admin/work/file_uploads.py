"""Take files of any size in parts: begin an upload, add a part, ask how far it is, discard it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Path, Request
from fastapi.responses import JSONResponse, Response

from app.intake.part_uploads import Standing, standing
from app.web.admin.background import task_address
from app.web.admin.layout import see
from app.web.gates import Store, settings
from app.web.roles import Acting, Looking
from app.web.uploads import NewUpload, UploadingActor, add_part, begin_part_upload, discard_part_upload

UploadId = Annotated[str, Path(max_length=40)]

router = APIRouter(prefix="/admin/files/upload", include_in_schema=False)


@router.post("")
def begin(request: Request, actor: UploadingActor, wanted: NewUpload, database: Store) -> Response:
    """Begin an upload, or go on with the same one: the answer says where, and from which byte."""
    begun = begin_part_upload(settings(request), database, actor, wanted)
    return JSONResponse(_told(begun), 201 if begun.offset == 0 else 200)


@router.get("/{upload}")
def ask(request: Request, _person: Looking, upload: UploadId) -> Response:
    """Say how far an upload is."""
    return JSONResponse(_told(standing(settings(request).intake_dir, upload)))


@router.patch("/{upload}")
async def add(
    request: Request,
    actor: UploadingActor,
    upload: UploadId,
    database: Store,
    offset: Annotated[int, Header(alias="Upload-Offset", ge=0)],
) -> Response:
    """Add a part that begins at `Upload-Offset`."""
    now, task = await add_part(request, database, actor, upload, offset)
    return JSONResponse({**_told(now), "task": task_address(task)}, 202) if task else JSONResponse(_told(now))


@router.post("/{upload}/discard")
def discard_upload(request: Request, actor: Acting, upload: UploadId, database: Store) -> Response:
    discard_part_upload(settings(request), database, actor, upload)
    return see("/admin/files")


def _told(known: Standing) -> dict[str, object]:
    upload = known.upload
    address = f"/admin/files/upload/{upload.id}"
    task = task_address(upload.task) if upload.task else None
    return {"upload": address, "offset": known.offset, "size": upload.size, "task": task}

"""Upload tables of measures, and zipped reports and models, as `reconstudy study attach` takes them."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response

from app.web.admin.background import task_address
from app.web.gates import Store, settings
from app.web.roles import AStudy
from app.web.uploads import UploadingActor, begin_attaching

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)


@router.put("/upload")
async def upload_results(request: Request, actor: UploadingActor, study: AStudy, database: Store) -> Response:
    """Take a table of measures, or zipped reports and models; they are checked and attached in the background."""
    task = await begin_attaching(request, settings(request), actor, database, study)
    return JSONResponse({"task": task_address(task)}, 202)

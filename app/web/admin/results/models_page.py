"""Show a study's models in 3D: two approaches side by side, turned together, coloured by their error."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Request
from fastapi.responses import FileResponse, Response

from app.errors import NotFoundError
from app.operations.studies.attach import model_file
from app.store.studies.attached_models import model_records
from app.web.admin.layout import study_page, viewing
from app.web.gates import Store, settings
from app.web.media import FOREVER, SANDBOX, is_known
from app.web.roles import AStudy, Looking

router = APIRouter(prefix="/admin/studies/{slug}/models", include_in_schema=False)


@router.get("")
def models_page(request: Request, person: Looking, study: AStudy, database: Store) -> Response:
    with database.reading() as connection:
        models = model_records(connection, study.id)
    shown = [_shown(row, f"/admin/studies/{study.slug}/models") for row in models]
    datasets = list(dict.fromkeys(row["dataset"] for row in models))
    context = {"models": shown, "datasets": datasets, "largest_mb": settings(request).largest_upload_mb}
    return viewing(study_page(request, "models", person, study, context), models)


@router.get("/{sha256}.ply")
def model(
    request: Request,
    _person: Looking,
    study: AStudy,
    sha256: Annotated[str, Path(max_length=64)],
    database: Store,
) -> Response:
    with database.reading() as connection:
        is_there = sha256 in {row["sha256"] for row in model_records(connection, study.id)}
    path = model_file(settings(request), sha256)
    if not is_there or not path.is_file():
        raise NotFoundError("This study has no such model.")
    headers = {"ETag": f'"{sha256}"', "Cache-Control": FOREVER, "Content-Security-Policy": SANDBOX}
    if is_known(request.headers.get("if-none-match", ""), sha256):
        return Response(status_code=304, headers=headers)
    return FileResponse(path, headers=headers, media_type="application/octet-stream")


def _shown(row: dict[str, Any], base: str) -> dict[str, Any]:
    facts = ("dataset", "condition", "kind", "n_points", "n_faces", "error_limit_mm")
    return {**{name: row[name] for name in facts}, "url": f"{base}/{row['sha256']}.ply"}

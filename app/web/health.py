"""Whether the server lives, and whether it can do its work."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from sqlalchemy.exc import SQLAlchemyError

from app.store.migrate import newest_version, version_of
from app.web.gates import Store, settings
from app.web.problems import problem

router = APIRouter(include_in_schema=False)


@router.get("/healthz")
def healthz() -> dict[str, str]:
    return {"status": "ok"}


@router.get("/readyz", response_model=None)
def readyz(request: Request, database: Store) -> JSONResponse:
    try:
        version = version_of(database)
    except SQLAlchemyError as error:
        return problem(503, f"The database does not answer: {type(error).__name__}.")
    if version != newest_version():
        return problem(503, f"The database is at version {version}; run `reconstudy db upgrade`.")
    if not settings(request).media_dir.is_dir():
        return problem(503, "The folder of pair videos is not there.")
    return JSONResponse({"status": "ready"})

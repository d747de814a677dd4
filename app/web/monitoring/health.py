"""Health checks: is the server alive, and is it ready to work?"""

from __future__ import annotations

import shutil
from contextlib import suppress

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response

from app.errors import UnavailableError
from app.store.database.migrate import why_not_ready
from app.store.failing_films import failing_films_of_all
from app.web.gates import Store, settings
from app.web.monitoring.metrics import Metrics, failing_films_text
from app.web.problems import problem

LEAST_FREE_MB = 16  # votes take kilobytes, and SQLite writes each twice

router = APIRouter(include_in_schema=False)


@router.get("/healthz")
def healthz() -> dict[str, str]:
    return {"status": "ok"}


@router.get("/readyz", response_model=None)
def readyz(request: Request, database: Store) -> JSONResponse:
    if reason := why_not_ready(database):
        return problem(503, reason)
    server = settings(request)
    if not server.media_dir.is_dir():
        return problem(503, "The folder of pair videos is not there.")
    free = shutil.disk_usage(server.data_dir).free
    if free < LEAST_FREE_MB * 2**20:
        return problem(503, f"The disk of the data folder has {free // 2**20} MB free, expected {LEAST_FREE_MB}.")
    return JSONResponse({"status": "ready"})


@router.get("/metrics")
def metrics(request: Request, database: Store) -> Response:
    """Counts for Prometheus; hide this address from the outside (deploy/nginx.conf)."""
    counts: Metrics = request.app.state.metrics
    text, media_type = counts.text()
    with suppress(UnavailableError), database.reading() as connection:  # without a database the other counts still help
        text += failing_films_text(failing_films_of_all(connection))
    return Response(text, media_type=media_type)

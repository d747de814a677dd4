"""Health checks: is the server alive, and is it ready to work?"""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response

from app.store.database.migrate import why_not_ready
from app.web.gates import Store, settings
from app.web.monitoring.metrics import Metrics
from app.web.problems import problem

router = APIRouter(include_in_schema=False)


@router.get("/healthz")
def healthz() -> dict[str, str]:
    return {"status": "ok"}


@router.get("/readyz", response_model=None)
def readyz(request: Request, database: Store) -> JSONResponse:
    if reason := why_not_ready(database):
        return problem(503, reason)
    if not settings(request).media_dir.is_dir():
        return problem(503, "The folder of pair videos is not there.")
    return JSONResponse({"status": "ready"})


@router.get("/metrics")
def metrics(request: Request) -> Response:
    """Counts for Prometheus; hide this address from the outside (deploy/nginx.conf)."""
    counts: Metrics = request.app.state.metrics
    text, media_type = counts.text()
    return Response(text, media_type=media_type)

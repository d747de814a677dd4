"""A study's results, live as votes come in, with every figure as a file."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import Response

from app.errors import NotFoundError
from app.web.admin.results_view import results_view
from app.web.admin.shell import study_page
from app.web.gates import AStudy, Person, Store
from app.web.results import FIGURE_TYPES, figure, figures_of, snapshot_of

KEPT = "private, max-age=31536000, immutable"  # the address of a figure holds the digest of its votes

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)

Everybody = Annotated[bool, Query(description="count those who are excluded, too")]


@router.get("/results")
def results_page(
    request: Request,
    person: Person,
    study: AStudy,
    database: Store,
    everybody: Everybody = False,
    seen: Annotated[str, Query(max_length=64)] = "",
) -> Response:
    """`seen` is the digest of what a page shows already: 204 if nothing is new."""
    snapshot = snapshot_of(database, study.id, with_excluded=everybody)
    if seen == snapshot.digest:
        return Response(status_code=204)
    analysis = snapshot.analysis
    context = {
        "everybody": everybody,
        "digest": snapshot.digest,
        "figures": [one for one in figures_of(analysis) if not one[0].startswith("measure_")] if analysis else [],
        "results": results_view(analysis) if analysis else None,
        "n_excluded": analysis["votes"]["excluded"] if analysis else 0,
    }
    return study_page(request, "results", person, study, context)


@router.get("/figures/{name}.{kind}")
def figure_file(
    _person: Person,
    study: AStudy,
    name: Annotated[str, Path(max_length=200)],
    kind: Annotated[str, Path(max_length=10)],
    database: Store,
    everybody: Everybody = False,
    digest: Annotated[str, Query(max_length=64)] = "",
) -> Response:
    snapshot = snapshot_of(database, study.id, with_excluded=everybody)
    content = None
    if snapshot.analysis is not None and kind in (*FIGURE_TYPES, "vega"):
        content = figure(snapshot.analysis, name, kind)
    if content is None:
        raise NotFoundError("There is no such figure of these votes yet.")
    headers = {"Cache-Control": KEPT if digest == snapshot.digest else "no-store"}
    if kind in ("png", "pdf", "csv"):
        headers["Content-Disposition"] = f'attachment; filename="{study.slug}-{name}.{kind}"'
    return Response(content, media_type=FIGURE_TYPES.get(kind, "application/json"), headers=headers)

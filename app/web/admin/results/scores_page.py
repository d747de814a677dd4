"""Show a study's results, updated as votes come in, with every figure as a file."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import Response

from app.errors import NotFoundError
from app.store.studies.studies import Study
from app.web.admin.layout import attachment, study_page
from app.web.admin.listing import POLLED
from app.web.admin.results.scores_view import OF_MEASURES, groups_view, results_view
from app.web.analyst.results import (
    FIGURE_TYPES,
    Results,
    code_of,
    figure,
    figures_of,
    grouped_results_of,
    results_of,
    results_soon,
)
from app.web.gates import Store
from app.web.media import FOREVER
from app.web.roles import AStudy, Looking, Person

PATIENCE_S = 0.6  # the page should appear within a second

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)

FigureName = Annotated[str, Path(max_length=200)]
FigureKind = Annotated[str, Path(max_length=10)]
Digest = Annotated[str, Query(max_length=64)]
Everybody = Annotated[bool, Query(description="also count excluded participants")]


@router.get("/results")
def results_page(
    request: Request,
    person: Person,
    study: AStudy,
    database: Store,
    everybody: Everybody = False,
    seen: Annotated[str, Query(max_length=64)] = "",
) -> Response:
    """Show the results; `seen` is the digest of the results that the page shows: 204 if nothing is new.

    Where newer votes take longer to analyse, the page shows the latest results there are, and asks again.
    """
    results, is_newest = results_soon(database, study.id, PATIENCE_S, with_excluded=everybody)
    digest = results.digest if results else "none yet"
    if seen == digest:
        return Response(status_code=204)
    analysis = results.analysis if results else None
    figures = figures_of(results) if results else []
    context = {
        "everybody": everybody,
        "query": urlencode([item for item in request.query_params.multi_items() if item[0] != POLLED]),
        "digest": digest,
        "is_newest": is_newest,
        "figures": [
            (name, caption, code_of(results, name))
            for name, caption in figures
            if results and not name.startswith("measure")
        ],
        "analysis": analysis,
        "warnings": [text for text in analysis["warnings"] if not text.startswith(OF_MEASURES)] if analysis else [],
        **(results_view(request, analysis) if analysis else {}),
    }
    return study_page(request, "results", person, study, context)


@router.get("/results/groups")
def groups_page(request: Request, person: Looking, study: AStudy, database: Store) -> Response:
    """Compare the scores of groups of participants; their interview answers make the groups."""
    results = grouped_results_of(database, study)
    analysis = results.analysis
    context = {
        "digest": results.digest,
        "groupings": groups_view(analysis) if analysis else [],
        "figures": dict(figures_of(results)),
    }
    return study_page(request, "groups", person, study, context)


@router.get("/results/groups/{name}.{kind}")
def group_figure_file(
    _person: Looking, study: AStudy, name: FigureName, kind: FigureKind, database: Store, digest: Digest = ""
) -> Response:
    return _figure_answer(grouped_results_of(database, study), study, name, kind, digest)


@router.get("/figures/{name}.{kind}")
def figure_file(
    _person: Person,
    study: AStudy,
    name: FigureName,
    kind: FigureKind,
    database: Store,
    everybody: Everybody = False,
    digest: Digest = "",
) -> Response:
    results = results_of(database, study.id, with_excluded=everybody)
    return _figure_answer(results, study, name, kind, digest)


def _figure_answer(results: Results, study: Study, name: str, kind: str, digest: str) -> Response:
    content = figure(results, name, kind) if kind in (*FIGURE_TYPES, "vega") else None
    if content is None:
        raise NotFoundError("There is no such figure of these votes yet.")
    # a figure's address contains the digest of its votes
    headers = {"Cache-Control": FOREVER if digest == results.digest else "no-store"}
    if kind in ("png", "pdf", "csv"):
        headers["Content-Disposition"] = attachment(f"{study.slug}-{name}.{kind}")
    return Response(content, media_type=FIGURE_TYPES.get(kind, "application/json"), headers=headers)

"""Show a study's objective results: attached reports with their figures, and their measures against the scores."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import FileResponse, Response

from app.errors import NotFoundError
from app.operations.studies.attach import ATTACHED, report_folder
from app.store.studies.attached_reports import report_records
from app.store.studies.audit import audit_records
from app.store.studies.measurements import measurement_records
from app.web.admin.layout import attachment, study_page
from app.web.admin.listing import listed
from app.web.admin.results.objective_view import (
    attachment_notes,
    beside_scores,
    comparison_lines,
    measure_lines,
    readable,
    report_view,
)
from app.web.admin.results.scores_view import OF_MEASURES
from app.web.analyst.results import FIGURE_TYPES, figures_of, results_of
from app.web.gates import Store, settings
from app.web.media import FOREVER, SANDBOX
from app.web.roles import AStudy, Person

MEASURE_COLUMNS = ("measure", "dataset", "approach", "value", "unit", "source")
MOST_FIGURES = 9  # on the page: the ranking, and the best measures; links lead to the others

router = APIRouter(prefix="/admin/studies/{slug}/objective", include_in_schema=False)


@router.get("")
def objective_page(request: Request, person: Person, study: AStudy, database: Store) -> Response:
    with database.reading() as connection:
        records = report_records(connection, study.id)
        measures = measurement_records(connection, study.id)
        latest = audit_records(connection, study_id=study.id, search=ATTACHED, limit=1)
    context = {
        "reports": [report_view(row, report_folder(settings(request), row["digest"])) for row in records],
        "readable": readable,
        "measures": listed(request, measures, MEASURE_COLUMNS, prefix="measures_"),
        "notes": attachment_notes(latest[0]["detail"]) if latest else [],
        "largest_mb": settings(request).largest_upload_mb,
    }
    return study_page(request, "objective", person, study, context)


@router.get("/scores")
def against_scores_page(request: Request, person: Person, study: AStudy, database: Store) -> Response:
    """Compare the objective measures with the scores."""
    from app.analysis.objective.against_scores import score_unit

    with database.reading() as connection:
        measures = measurement_records(connection, study.id)
    results = results_of(database, study.id)
    analysis = results.analysis
    figures = [
        (name, caption) for name, caption in figures_of(results) if name == "rates" or name.startswith("measure")
    ]
    context = {
        "digest": results.digest,
        "has_votes": analysis is not None,
        "unit": score_unit(analysis) if analysis else "",
        "lines": measure_lines(analysis["measures"]) if analysis else [],
        "comparisons": comparison_lines(analysis["measure_comparisons"]) if analysis else [],
        "warnings": [text for text in analysis["warnings"] if text.startswith(OF_MEASURES)] if analysis else [],
        "beside": beside_scores(analysis, measures) if analysis else [],
        "figures": figures[:MOST_FIGURES],
        "more_figures": figures[MOST_FIGURES:],
    }
    return study_page(request, "against_scores", person, study, context)


@router.get("/{digest}/{name}")
def report_file(
    request: Request,
    _person: Person,
    study: AStudy,
    digest: Annotated[str, Path(max_length=64)],
    name: Annotated[str, Path(max_length=100)],
    database: Store,
) -> Response:
    with database.reading() as connection:
        is_there = digest in {row["digest"] for row in report_records(connection, study.id)}
    folder = report_folder(settings(request), digest)
    if not is_there or name not in {path.name for path in folder.glob("*")}:
        raise NotFoundError("This study has no such file of a report.")
    kind = name.rsplit(".", 1)[1]
    headers = {"Cache-Control": FOREVER, "Content-Security-Policy": SANDBOX}
    if kind in ("pdf", "csv"):
        headers["Content-Disposition"] = attachment(f"{study.slug}-{name}")
    return FileResponse(folder / name, headers=headers, media_type=FIGURE_TYPES[kind])

"""Results over REST, for analysts with a bearer token and for signed-in experimenters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query
from fastapi.responses import JSONResponse, Response

from app.store.designs import conditions_of, datasets_of
from app.store.engine import Database
from app.store.measurements import measurement_records
from app.store.screening import screening_records
from app.store.studies import Study, all_studies, progress_of
from app.store.tokens import READ
from app.store.trials import trial_records
from app.store.votes import vote_records
from app.web.answers import ChosenFormat, flattened, table
from app.web.gates import AStudy, Store, may_read
from app.web.results import analysis_of

VOTES = (
    "participant",
    "dataset",
    "item_a",
    "item_b",
    "choice",
    "first_shown",
    "trial",
    "response_ms",
    "practice",
    "excluded",
    "reason",
    "role",
)
TRIALS = (
    "trial",
    "session",
    "participant",
    "number",
    "attempt",
    "dataset",
    "item_a",
    "item_b",
    "first_shown",
    "role",
    "served_at",
    "voided_at",
    "void_reason",
    "voted_at",
    "choice",
    "shown_ms",
    "response_ms",
    "n_switches",
    "viewing",
)
SCREENING = (
    "participant",
    "session",
    "test",
    "verdict",
    "logmar",
    "low",
    "high",
    "limit",
    "smallest",
    "pixel_mm",
    "distance_mm",
    "distance_source",
    "n_answered",
    "started_at",
    "finished_at",
    "details",
)
SCORES = (
    "comparison",
    "dataset",
    "item",
    "score",
    "se",
    "se_participant",
    "ci_low",
    "ci_high",
    "n_votes",
    "wins",
    "losses",
    "ties",
    "status",
)
TRIADS = (
    "participant",
    "dataset",
    "n_items",
    "complete",
    "circular",
    "circular_expected_ties",
    "circular_max",
    "zeta",
    "p_value",
)
MEASUREMENTS = ("dataset", "approach", "measure", "value", "direction", "unit", "attached_at")
STUDIES = (
    "slug",
    "name",
    "state",
    "exposure_s",
    "created_at",
    "n_datasets",
    "n_conditions",
    "n_pairs",
    "n_started",
    "n_finished",
    "n_votes",
)
EMPTY_ANALYSIS: dict[str, Any] = {
    "schema_version": 1,
    **{
        key: []
        for key in (
            "scores",
            "models",
            "triads",
            "triads_pooled",
            "agreement",
            "observers",
            "checks",
            "pairs",
            "measures",
        )
    },
    "warnings": ["there are no votes yet"],
    "settings": {},
}
CSV_TOO: dict[int | str, dict[str, Any]] = {200: {"content": {"text/csv": {"schema": {"type": "string"}}}}}

router = APIRouter(prefix="/api/v1", tags=["results"], dependencies=[Depends(may_read(READ))])


@router.get("/studies", responses=CSV_TOO)
def studies(database: Store, chosen: ChosenFormat) -> Response:
    """All studies, the newest first."""
    with database.reading() as connection:
        rows = [_summary(database, study) for study in all_studies(connection)]
    return table(rows, STUDIES, chosen, "studies")


@router.get("/studies/{slug}")
def study(of: AStudy, database: Store) -> JSONResponse:
    """One study: what it compares, and how far it is."""
    with database.reading() as connection:
        conditions = [{"item": name, "levels": levels} for name, levels in conditions_of(connection, of.id).items()]
        datasets = datasets_of(connection, of.id)
    return JSONResponse(
        {**_summary(database, of), "datasets": datasets, "conditions": conditions, "factors": of.factors}
    )


@router.get("/studies/{slug}/votes", responses=CSV_TOO)
def votes(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """All votes; `item_a` is what was labelled A in that trial."""
    with database.reading() as connection:
        return table(vote_records(connection, of.id), VOTES, chosen, f"{of.slug}-votes")


@router.get("/studies/{slug}/trials", responses=CSV_TOO)
def trials(
    of: AStudy,
    database: Store,
    chosen: ChosenFormat,
    session: Annotated[str | None, Query(max_length=32, description="of this session only")] = None,
) -> Response:
    """All planned trials, those without a vote too, with the viewing behaviour."""
    with database.reading() as connection:
        return table(trial_records(connection, of.id, session), TRIALS, chosen, f"{of.slug}-trials")


@router.get("/studies/{slug}/screening", responses=CSV_TOO)
def screening(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """What the screening found, a row for each participant and test. It is a screening, not a diagnosis."""
    with database.reading() as connection:
        return table(screening_records(connection, of.id), SCREENING, chosen, f"{of.slug}-screening")


@router.get("/studies/{slug}/scores", responses=CSV_TOO)
def scores(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Scores of the votes so far: natural log-odds that sum to zero in each comparison and dataset."""
    rows = _analysis(database, of)["scores"]
    return table(rows, _columns(SCORES, rows), chosen, f"{of.slug}-scores")


@router.get("/studies/{slug}/triads", responses=CSV_TOO)
def triads(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Circular triads by participant and dataset."""
    rows = _analysis(database, of)["triads"]
    return table(rows, _columns(TRIADS, rows), chosen, f"{of.slug}-triads")


@router.get("/studies/{slug}/validation", responses=CSV_TOO)
def validation(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Objective measures attached to the study, which the analysis compares with the scores."""
    with database.reading() as connection:
        return table(measurement_records(connection, of.id), MEASUREMENTS, chosen, f"{of.slug}-validation")


@router.get("/studies/{slug}/analysis", responses=CSV_TOO)
def analysis(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """The whole analysis of the votes so far; as CSV, one row for each value."""
    content = _analysis(database, of)
    if chosen == "csv":
        return table(flattened(content), ("key", "value"), chosen, f"{of.slug}-analysis")
    return JSONResponse(content)


def _columns(first: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The agreed columns, then what else the rows have."""
    return list(dict.fromkeys([*first, *(key for row in rows for key in row)]))


def _analysis(database: Database, of: Study) -> Mapping[str, Any]:
    found = analysis_of(database, of.id)
    return EMPTY_ANALYSIS if found is None else found


def _summary(database: Database, of: Study) -> dict[str, Any]:
    with database.reading() as connection:
        progress = progress_of(connection, of.id)
    return {
        "slug": of.slug,
        "name": of.name,
        "state": of.standing,
        "exposure_s": of.exposure_s,
        "created_at": of.created_at.isoformat(),
        **asdict(progress),
    }

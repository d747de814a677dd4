"""Results over REST, for analysts with a bearer token and for signed-in experimenters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from tempfile import SpooledTemporaryFile
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query
from fastapi.responses import Response

from app.store.audit import audit_records
from app.store.designs import conditions_of, datasets_of
from app.store.engine import Database
from app.store.measurements import measurement_records
from app.store.participants import participant_records, questionnaire_records
from app.store.screening import screening_records
from app.store.studies import Study, StudyCounts, all_studies, progress_by_study, progress_of
from app.store.tokens import AUDIT as AUDIT_SCOPE
from app.store.tokens import PERSONAL, READ
from app.store.trials import trial_records
from app.store.vote_records import vote_records
from app.web.analyst import columns
from app.web.analyst.archive import write_archive
from app.web.analyst.formats import IN_MEMORY, ChosenFormat, flattened, json_object, streamed, table
from app.web.analyst.openapi import object_answers, table_answers
from app.web.analyst.openapi_examples import ANALYSIS, STUDY
from app.web.analyst.results import analysis_of
from app.web.gates import AStudy, Store, may_read

EMPTY_ANALYSIS: dict[str, Any] = {
    "schema_version": 1,
    **{
        key: []
        for key in [
            "scores",
            "models",
            "triads",
            "triads_pooled",
            "agreement",
            "observers",
            "checks",
            "pairs",
            "measures",
        ]
    },
    "warnings": ["there are no votes yet"],
    "settings": {},
}

router = APIRouter(prefix="/api/v1", tags=["results"])
READING, PERSONAL_TOO, AUDITING = ([Depends(may_read(scope))] for scope in (READ, PERSONAL, AUDIT_SCOPE))

OfParticipant = Annotated[str | None, Query(alias="participant", max_length=40, description="of this one only")]
OfDataset = Annotated[str | None, Query(alias="dataset", max_length=200, description="of this one only")]


@router.get("/studies", responses=table_answers(columns.STUDIES), dependencies=READING)
def studies(database: Store, chosen: ChosenFormat) -> Response:
    """All studies, the newest first."""
    with database.reading() as connection:
        found = all_studies(connection)
        progress = progress_by_study(connection)  # afterwards: a study may come meanwhile
    rows = [_summary(study, progress[study.id]) for study in found]
    return table(rows, columns.STUDIES, chosen, "studies")


@router.get("/studies/{slug}", responses=object_answers(STUDY), dependencies=READING)
def study(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """One study: what it compares, and how far it is."""
    with database.reading() as connection:
        conditions = [{"item": name, "levels": levels} for name, levels in conditions_of(connection, of.id).items()]
        datasets = datasets_of(connection, of.id)
        progress = progress_of(connection, of.id)
    whole = {**_summary(of, progress), "datasets": datasets, "conditions": conditions, "factors": of.factors}
    return json_object(whole, chosen)


@router.get("/studies/{slug}/votes", responses=table_answers(columns.VOTES), dependencies=READING)
def votes(
    of: AStudy,
    database: Store,
    chosen: ChosenFormat,
    participant: OfParticipant = None,
    dataset: OfDataset = None,
) -> Response:
    """All votes; `item_a` is what was labelled A in that trial."""
    with database.reading() as connection:
        rows = _of(vote_records(connection, of.id), participant, dataset)
        return table(rows, columns.VOTES, chosen, f"{of.slug}-votes")


@router.get("/studies/{slug}/trials", responses=table_answers(columns.TRIALS), dependencies=READING)
def trials(
    of: AStudy,
    database: Store,
    chosen: ChosenFormat,
    session: Annotated[str | None, Query(max_length=32, description="of this session only")] = None,
    participant: OfParticipant = None,
    dataset: OfDataset = None,
) -> Response:
    """All planned trials, those without a vote too, with the viewing behaviour."""
    with database.reading() as connection:
        rows = _of(trial_records(connection, of.id, session), participant, dataset)
        return table(rows, columns.TRIALS, chosen, f"{of.slug}-trials")


@router.get("/studies/{slug}/participants", responses=table_answers(columns.PARTICIPANTS), dependencies=PERSONAL_TOO)
def participants(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Everybody who has begun, how far they are, and whether they count."""
    with database.reading() as connection:
        return table(participant_records(connection, of.id), columns.PARTICIPANTS, chosen, f"{of.slug}-participants")


@router.get("/studies/{slug}/screening", responses=table_answers(columns.SCREENING), dependencies=PERSONAL_TOO)
def screening(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """What the screening found, a row for each participant and test. It is a screening, not a diagnosis."""
    with database.reading() as connection:
        return table(screening_records(connection, of.id), columns.SCREENING, chosen, f"{of.slug}-screening")


@router.get("/studies/{slug}/questionnaire", responses=table_answers(columns.QUESTIONNAIRE), dependencies=PERSONAL_TOO)
def questionnaire(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """The answers of the interview, a row for each participant and question."""
    with database.reading() as connection:
        rows = questionnaire_records(connection, of.id)
    return table(rows, columns.QUESTIONNAIRE, chosen, f"{of.slug}-questionnaire")


@router.get("/studies/{slug}/scores", responses=table_answers(columns.SCORES), dependencies=READING)
def scores(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Scores of the votes so far: natural log-odds that sum to zero in each comparison and dataset."""
    rows = _analysis(database, of)["scores"]
    return table(rows, _columns(columns.SCORES, rows), chosen, f"{of.slug}-scores")


@router.get("/studies/{slug}/triads", responses=table_answers(columns.TRIADS), dependencies=READING)
def triads(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Circular triads by participant and dataset."""
    rows = _analysis(database, of)["triads"]
    return table(rows, _columns(columns.TRIADS, rows), chosen, f"{of.slug}-triads")


@router.get("/studies/{slug}/observers", responses=table_answers(columns.OBSERVERS), dependencies=READING)
def observers(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """What is unusual about each participant's votes, with the numbers behind it."""
    rows = _analysis(database, of)["observers"]
    return table(rows, _columns(columns.OBSERVERS, rows), chosen, f"{of.slug}-observers")


@router.get("/studies/{slug}/validation", responses=table_answers(columns.MEASUREMENTS), dependencies=READING)
def validation(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Objective measures attached to the study, which the analysis compares with the scores."""
    with database.reading() as connection:
        return table(measurement_records(connection, of.id), columns.MEASUREMENTS, chosen, f"{of.slug}-validation")


@router.get("/studies/{slug}/analysis", responses=object_answers(ANALYSIS, tables_too=True), dependencies=READING)
def analysis(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """The whole analysis of the votes so far; as CSV or Parquet, one row for each value."""
    content = _analysis(database, of)
    if chosen.format != "json":
        return table(flattened(content), ("key", "value"), chosen, f"{of.slug}-analysis")
    return json_object(content, chosen)


@router.get("/studies/{slug}/audit", responses=table_answers(columns.AUDIT), dependencies=AUDITING)
def audit_of_study(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """What experimenters did in a study, the latest first."""
    with database.reading() as connection:
        return table(audit_records(connection, study_id=of.id), columns.AUDIT, chosen, f"{of.slug}-audit")


@router.get("/audit", responses=table_answers(columns.AUDIT), dependencies=AUDITING)
def audit(
    database: Store,
    chosen: ChosenFormat,
    search: Annotated[str, Query(max_length=100, description="a part of the actor, action or subject")] = "",
) -> Response:
    """Everything that was done on this server and what was refused, the latest first."""
    with database.reading() as connection:
        return table(audit_records(connection, search=search), columns.AUDIT, chosen, "audit")


@router.get(
    "/studies/{slug}/archive.zip",
    dependencies=PERSONAL_TOO,
    responses={
        200: {"content": {"application/zip": {"schema": {"type": "string", "format": "binary"}}}},
        304: {"description": "As before"},
    },
    response_class=Response,
)
def archive(of: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Everything of a study in one file: tables, analysis, study file, data dictionary, checksums."""
    content = SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115 (closed when it has been sent)
    write_archive(content, database, of.id)
    headers = {"Content-Disposition": f'attachment; filename="{of.slug}.zip"'}
    return streamed(content, "application/zip", chosen, headers)


def _of(rows: Iterable[dict[str, Any]], participant: str | None, dataset: str | None) -> Iterator[dict[str, Any]]:
    wanted = {"participant": participant, "dataset": dataset}
    return (row for row in rows if all(value is None or row[key] == value for key, value in wanted.items()))


def _columns(first: Iterable[str], rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The agreed columns, then what else the rows have."""
    return list(dict.fromkeys([*first, *(key for row in rows for key in row)]))


def _analysis(database: Database, of: Study) -> Mapping[str, Any]:
    found = analysis_of(database, of.id)
    return EMPTY_ANALYSIS if found is None else found


def _summary(of: Study, progress: StudyCounts) -> dict[str, Any]:
    return {
        "slug": of.slug,
        "name": of.name,
        "state": of.standing,
        "exposure_s": of.exposure_s,
        "created_at": of.created_at.isoformat(),
        **asdict(progress),
    }

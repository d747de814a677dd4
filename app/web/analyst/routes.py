"""Serve results over REST to analysts with a bearer token and to signed-in experimenters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from tempfile import SpooledTemporaryFile
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query
from fastapi.responses import Response

from app.operations.manage import study_summary
from app.store.audit import audit_records
from app.store.designs import conditions_of, datasets_of
from app.store.engine import Database, Transaction
from app.store.measurements import measurement_records
from app.store.participants import participant_records, questionnaire_records
from app.store.screening import screening_records
from app.store.studies import Study, all_studies, progress_by_study, progress_of
from app.store.tokens import AUDIT as AUDIT_SCOPE
from app.store.tokens import PERSONAL, READ
from app.store.trials import trial_records
from app.store.vote_records import vote_records
from app.study.options import parse_options
from app.web.analyst import columns
from app.web.analyst.archive import write_archive
from app.web.analyst.formats import IN_MEMORY, ChosenFormat, TableRequest, flattened, json_object, streamed, table
from app.web.analyst.openapi import object_answers, table_answers
from app.web.analyst.openapi_examples import ANALYSIS, STUDY
from app.web.analyst.results import analysis_of, rows_of
from app.web.gates import AStudy, Store, may_read

EMPTY_TABLES = (
    "scores",
    "models",
    "triads",
    "triads_pooled",
    "agreement",
    "observers",
    "checks",
    "pairs",
    "measures",
    "measure_comparisons",
)
EMPTY_ANALYSIS: dict[str, Any] = {
    "schema_version": 1,
    **{name: [] for name in EMPTY_TABLES},
    "warnings": ["there are no votes yet"],
    "settings": {},
}

router = APIRouter(prefix="/api/v1", tags=["results"])
READING, PERSONAL_TOO, AUDITING = ([Depends(may_read(scope))] for scope in (READ, PERSONAL, AUDIT_SCOPE))

OfParticipant = Annotated[str | None, Query(alias="participant", max_length=40, description="only this participant")]
OfDataset = Annotated[str | None, Query(alias="dataset", max_length=200, description="only this dataset")]


@router.get("/studies", responses=table_answers(columns.STUDIES), dependencies=READING)
def studies(database: Store, chosen: ChosenFormat) -> Response:
    """List all studies, the newest first."""
    with database.reading() as connection:
        listed = all_studies(connection)
        progress = progress_by_study(connection)  # read second: it then covers every study listed
    rows = [study_summary(study, progress[study.id]) for study in listed]
    return table(rows, columns.STUDIES, chosen, "studies")


@router.get("/studies/{slug}", responses=object_answers(STUDY), dependencies=READING)
def study(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Describe a study: what it compares, and its progress."""
    with database.reading() as connection:
        conditions = [{"item": name, "levels": levels} for name, levels in conditions_of(connection, study.id).items()]
        datasets = datasets_of(connection, study.id)
        progress = progress_of(connection, study.id)
    options = parse_options(study.options)
    whole = {
        **study_summary(study, progress),
        "datasets": datasets,
        "conditions": conditions,
        "factors": study.factors,
        **{name: getattr(options, name) for name in ("protocol", "scale", "reference")},
        "lab_sheet": options.lab_sheet.as_json(),
    }
    return json_object(whole, chosen)


@router.get("/studies/{slug}/votes", responses=table_answers(columns.VOTES), dependencies=READING)
def votes(
    study: AStudy,
    database: Store,
    chosen: ChosenFormat,
    participant: OfParticipant = None,
    dataset: OfDataset = None,
) -> Response:
    """List all votes; `item_a` is the condition labelled A in that trial."""
    with database.reading() as connection:
        rows = _of(vote_records(connection, study.id), participant, dataset)
        return table(rows, columns.VOTES, chosen, f"{study.slug}-votes")


@router.get("/studies/{slug}/trials", responses=table_answers(columns.TRIALS), dependencies=READING)
def trials(
    study: AStudy,
    database: Store,
    chosen: ChosenFormat,
    session: Annotated[str | None, Query(max_length=32, description="only this session")] = None,
    participant: OfParticipant = None,
    dataset: OfDataset = None,
) -> Response:
    """List all planned trials, also those without a vote, with the viewing behaviour."""
    with database.reading() as connection:
        rows = _of(trial_records(connection, study.id, session), participant, dataset)
        return table(rows, columns.TRIALS, chosen, f"{study.slug}-trials")


@router.get("/studies/{slug}/participants", responses=table_answers(columns.PARTICIPANTS), dependencies=PERSONAL_TOO)
def participants(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List all participants who have begun, with progress and exclusions."""
    return _records(participant_records, database, study, chosen, "participants")


@router.get("/studies/{slug}/screening", responses=table_answers(columns.SCREENING), dependencies=PERSONAL_TOO)
def screening(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the screening's results, a row per participant and test. It is a screening, not a diagnosis."""
    return _records(screening_records, database, study, chosen, "screening")


@router.get("/studies/{slug}/questionnaire", responses=table_answers(columns.QUESTIONNAIRE), dependencies=PERSONAL_TOO)
def questionnaire(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the answers of the interview, a row per participant and question."""
    return _records(questionnaire_records, database, study, chosen, "questionnaire")


@router.get("/studies/{slug}/scores", responses=table_answers(columns.SCORES), dependencies=READING)
def scores(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Fit scores to the votes so far: natural log-odds that sum to zero in each comparison and dataset."""
    return _results(database, study, chosen, "scores")


@router.get("/studies/{slug}/ratings", responses=table_answers(columns.RATINGS), dependencies=READING)
def ratings(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List mean opinion scores, and qualities by the subject model of ITU-T P.910: of ACR, ACR-HR and DCR."""
    return _results(database, study, chosen, "ratings")


@router.get("/studies/{slug}/comparisons", responses=table_answers(columns.COMPARISONS), dependencies=READING)
def comparisons(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Fit scores to ratings of pairs (CCR), in steps of the scale; they sum to zero in each dataset."""
    return _results(database, study, chosen, "comparisons")


@router.get("/studies/{slug}/triads", responses=table_answers(columns.TRIADS), dependencies=READING)
def triads(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Count circular triads by participant and dataset."""
    return _results(database, study, chosen, "triads")


@router.get("/studies/{slug}/observers", responses=table_answers(columns.OBSERVERS), dependencies=READING)
def observers(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Flag what is unusual about each participant's votes, with the numbers behind it."""
    return _results(database, study, chosen, "observers")


@router.get("/studies/{slug}/validation", responses=table_answers(columns.MEASUREMENTS), dependencies=READING)
def validation(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the objective measures attached to the study, which the analysis compares with the scores."""
    return _records(measurement_records, database, study, chosen, "validation")


@router.get("/studies/{slug}/analysis", responses=object_answers(ANALYSIS, tables_too=True), dependencies=READING)
def analysis(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Analyse the votes so far; as CSV or Parquet, a row per value."""
    content = _analysis(database, study)
    if chosen.format != "json":
        return table(flattened(content), ("key", "value"), chosen, f"{study.slug}-analysis")
    return json_object(content, chosen)


@router.get("/studies/{slug}/audit", responses=table_answers(columns.AUDIT), dependencies=AUDITING)
def audit_of_study(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List what experimenters did in a study, the latest first."""
    with database.reading() as connection:
        return table(audit_records(connection, study_id=study.id), columns.AUDIT, chosen, f"{study.slug}-audit")


@router.get("/audit", responses=table_answers(columns.AUDIT), dependencies=AUDITING)
def audit(
    database: Store,
    chosen: ChosenFormat,
    search: Annotated[str, Query(max_length=100, description="part of the actor, action or subject")] = "",
) -> Response:
    """List everything that was done or refused on this server, the latest first."""
    with database.reading() as connection:
        return table(audit_records(connection, search=search), columns.AUDIT, chosen, "audit")


@router.get(
    "/studies/{slug}/archive.zip",
    dependencies=PERSONAL_TOO,
    responses={
        200: {"content": {"application/zip": {"schema": {"type": "string", "format": "binary"}}}},
        304: {"description": "Unchanged"},
    },
    response_class=Response,
)
def archive(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Download a study in one file: tables, analysis, study file, data dictionary, checksums."""
    content = SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115 (closed when it has been sent)
    write_archive(content, database, study.id)
    headers = {"Content-Disposition": f'attachment; filename="{study.slug}.zip"'}
    return streamed(content, "application/zip", chosen, headers)


def _of(rows: Iterable[dict[str, Any]], participant: str | None, dataset: str | None) -> Iterator[dict[str, Any]]:
    wanted = {"participant": participant, "dataset": dataset}
    return (row for row in rows if all(value is None or row[key] == value for key, value in wanted.items()))


def _records(
    read: Callable[[Transaction, int], Iterable[Mapping[str, Any]]],
    database: Database,
    study: Study,
    chosen: TableRequest,
    name: str,
) -> Response:
    with database.reading() as connection:
        return table(read(connection, study.id), columns.TABLES[name], chosen, f"{study.slug}-{name}")


def _results(database: Database, study: Study, chosen: TableRequest, name: str) -> Response:
    """Send rows of the analysis: the documented columns, then any others of the rows."""
    rows = rows_of(_analysis(database, study), name)
    names = dict.fromkeys([*columns.TABLES[name], *(key for row in rows for key in row)])
    return table(rows, names, chosen, f"{study.slug}-{name}")


def _analysis(database: Database, study: Study) -> Mapping[str, Any]:
    analysis = analysis_of(database, study.id)
    return EMPTY_ANALYSIS if analysis is None else analysis

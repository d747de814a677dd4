"""Serve results over REST to analysts with a bearer token and to signed-in experimenters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import cache
from tempfile import SpooledTemporaryFile
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import Response

from app.operations.studies.manage import study_summary
from app.store.access.rights import AUDIT as AUDIT_SCOPE
from app.store.access.rights import PERSONAL, READ
from app.store.database import tables
from app.store.database.engine import Database, Transaction
from app.store.database.table_state import Tables, table_state
from app.store.failing_films import failing_films
from app.store.participants.comments import comment_records, tag_names, tag_records
from app.store.participants.interviews import questionnaire_records
from app.store.participants.participants import n_participants, participant_records, session_state
from app.store.participants.screening import n_screening_records, screening_records
from app.store.studies.audit import audit_records, audit_state
from app.store.studies.measurements import measurement_records
from app.store.studies.studies import Study, all_studies, progress_by_study, progress_of
from app.store.trials.counted_votes import vote_state
from app.store.trials.demographics import demographic_records
from app.store.trials.designs import conditions_of, datasets_of, stimulus_names
from app.store.trials.trial_records import SoughtRows, rows_by_session, trial_page, trial_state
from app.store.trials.vote_records import vote_row
from app.study.options.options import parse_options
from app.web.analyst import columns
from app.web.analyst.archive import write_archive
from app.web.analyst.formats import (
    IN_MEMORY,
    ChosenFormat,
    CompressedRoute,
    Stored,
    TableRequest,
    flattened,
    is_known,
    json_object,
    stored_table,
    streamed,
    table,
    table_digest,
    unchanged,
)
from app.web.analyst.openapi import object_answers, table_answers
from app.web.analyst.openapi_examples import ANALYSIS, STUDY
from app.web.analyst.results import inputs_of, no_analysis, prepare_results, rows_of
from app.web.gates import Store
from app.web.roles import AStudy, is_seen, may_read

PEOPLE_AT_ONCE = 200
ENTRIES_AT_ONCE = 2000
ANSWERS = (tables.stage_record, tables.spoken_answer)  # what the table of answers follows from
COUNTING = (tables.session, tables.exclusion)  # who counts follows from these
PEOPLE = (*ANSWERS, *COUNTING)
TAGGED = (*PEOPLE, tables.trial_comment, tables.comment_tagging)
SCREENED = (
    *(tables.screening_display, tables.screening_test, tables.screening_item, tables.screening_entry),
    *COUNTING,
)

router = APIRouter(prefix="/api/v1", tags=["results"], route_class=CompressedRoute)
OBSERVERS = table_answers(columns.OBSERVERS, columns.FURTHER["observers"])
READING, PERSONAL_TOO, AUDITING = ([Depends(may_read(scope))] for scope in (READ, PERSONAL, AUDIT_SCOPE))

OfParticipant = Annotated[str | None, Query(alias="participant", max_length=40, description="only this participant")]
OfDataset = Annotated[str | None, Query(alias="dataset", max_length=200, description="only this dataset")]


@router.get("/studies", responses=table_answers(columns.STUDIES), dependencies=READING)
def studies(request: Request, database: Store, chosen: ChosenFormat) -> Response:
    """List all studies that the token may see, the newest first."""
    with database.reading() as connection:
        listed = [study for study in all_studies(connection) if is_seen(request, study)]
        progress = progress_by_study(connection)  # read second: it then covers every study listed
    rows = [study_summary(study, progress[study.id]) | {"created_at": study.created_at} for study in listed]
    return table(rows, columns.STUDIES, chosen, "studies")


@router.get("/studies/{slug}", responses=object_answers(STUDY), dependencies=READING)
def study(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Describe a study: what it compares, and its progress."""
    with database.reading() as connection:
        conditions = [{"item": name, "levels": levels} for name, levels in conditions_of(connection, study.id).items()]
        datasets = datasets_of(connection, study.id)
        stimuli = sorted(stimulus_names(connection, study.id).values())
        progress = progress_of(connection, study.id)
    options = parse_options(study.options)
    whole = {
        **study_summary(study, progress),
        "datasets": datasets,
        "conditions": conditions,
        "stimuli": [{"dataset": dataset, "item": item} for dataset, item in stimuli],
        "factors": study.factors,
        **{name: getattr(options, name) for name in ("protocol", "scale", "reference")},
        "revision": study.revision,
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
    sought = SoughtRows(participant, None, dataset)
    return _trial_table(database, study, chosen, sought, "votes")


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
    return _trial_table(database, study, chosen, SoughtRows(participant, session, dataset), "trials")


@router.get("/studies/{slug}/participants", responses=table_answers(columns.PARTICIPANTS), dependencies=PERSONAL_TOO)
def participants(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List all participants who have begun, with progress and exclusions."""
    with database.snapshot() as connection:
        votes_now = asdict(vote_state(connection, study.id))
        revision = [votes_now, trial_state(connection, study.id), session_state(connection, study.id)]

    def n_rows() -> int:
        with database.reading() as connection:
            return n_participants(connection, study.id)

    def read(offset: int, limit: int | None) -> Iterator[dict[str, Any]]:
        left = n_rows() if limit is None else limit
        while left > 0:
            with database.reading() as connection:
                people = participant_records(connection, study.id, limit=min(left, PEOPLE_AT_ONCE), offset=offset)
            yield from people
            left, offset = left - PEOPLE_AT_ONCE, offset + PEOPLE_AT_ONCE

    stored = Stored(revision, n_rows, read)
    return stored_table(stored, columns.PARTICIPANTS, chosen, f"{study.slug}-participants")


@router.get("/studies/{slug}/screening", responses=table_answers(columns.SCREENING), dependencies=PERSONAL_TOO)
def screening(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the screening's results, a row per participant and test. It is a screening, not a diagnosis."""
    return _records(screening_records, database, study, chosen, "screening", SCREENED, n_screening_records)


@router.get("/studies/{slug}/questionnaire", responses=table_answers(columns.QUESTIONNAIRE), dependencies=PERSONAL_TOO)
def questionnaire(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the answers of the interview, a row per participant and question."""
    return _records(questionnaire_records, database, study, chosen, "questionnaire", PEOPLE)


@router.get("/studies/{slug}/comments", responses=table_answers(columns.COMMENTS), dependencies=PERSONAL_TOO)
def comments(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List free answers of the questionnaire, notes of interviews and on trials, with their tags."""
    return _records(comment_records, database, study, chosen, "comments", TAGGED)


@router.get("/studies/{slug}/comment_tags", responses=table_answers(columns.COMMENT_TAGS), dependencies=PERSONAL_TOO)
def comment_tags(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Count the comments that bear each tag."""
    return _records(tag_records, database, study, chosen, "comment_tags", TAGGED)


@router.get("/studies/{slug}/demographics", responses=table_answers(columns.DEMOGRAPHICS), dependencies=PERSONAL_TOO)
def demographics(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Sum up who took part, by the closed questions of the questionnaire."""
    return _records(demographic_records, database, study, chosen, "demographics", PEOPLE)


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


@router.get("/studies/{slug}/observers", responses=OBSERVERS, dependencies=READING)
def observers(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Flag what is unusual about each participant's votes, with the numbers behind it."""
    return _results(database, study, chosen, "observers")


@router.get("/studies/{slug}/validation", responses=table_answers(columns.MEASUREMENTS), dependencies=READING)
def validation(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the objective measures attached to the study, which the analysis compares with the scores."""
    return _records(measurement_records, database, study, chosen, "validation", (tables.measurement,))


@router.get("/studies/{slug}/failures", responses=table_answers(columns.FAILURES), dependencies=READING)
def failures(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the films that browsers could not show: to whom, on what browser, and why; an alarm until it is noted."""
    return _records(failing_films, database, study, chosen, "failures", (tables.film_failure, *COUNTING))


@router.get("/studies/{slug}/analysis", responses=object_answers(ANALYSIS, tables_too=True), dependencies=READING)
def analysis(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Analyse the votes so far; as CSV or Parquet, a row per value."""
    with database.snapshot() as connection:
        inputs = inputs_of(connection, study.id)
        digest = table_digest(chosen, "analysis", inputs.digest)
        if is_known(chosen, digest):
            return unchanged(digest)
        prepared = prepare_results(connection, inputs)
    content = prepared.results().analysis or no_analysis(inputs.state)
    if chosen.format != "json":
        return table(flattened(content), ("key", "value"), chosen, f"{study.slug}-analysis", digest)
    return json_object(content, chosen, digest)


@router.get("/studies/{slug}/audit", responses=table_answers(columns.AUDIT), dependencies=AUDITING)
def audit_of_study(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List what experimenters did in a study, the latest first."""
    return _audit_table(database, chosen, f"{study.slug}-audit", study.id, "")


@router.get("/audit", responses=table_answers(columns.AUDIT), dependencies=AUDITING)
def audit(
    database: Store,
    chosen: ChosenFormat,
    search: Annotated[str, Query(max_length=100, description="part of the actor, action or subject")] = "",
) -> Response:
    """List everything that was done or refused on this server, the latest first."""
    return _audit_table(database, chosen, "audit", None, search)


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


def _trial_table(
    database: Database, study: Study, chosen: TableRequest, sought: SoughtRows, name: Literal["votes", "trials"]
) -> Response:
    """Send trials, or only those with a vote as votes."""
    is_voted = name == "votes"
    with database.snapshot() as connection:
        trials_now = () if is_voted else trial_state(connection, study.id)
        revision = [asdict(sought), asdict(vote_state(connection, study.id)), trials_now]

    @cache
    def counts() -> list[tuple[int, int]]:
        with database.reading() as connection:
            return rows_by_session(connection, study.id, sought, is_voted=is_voted)

    def read(offset: int, limit: int | None) -> Iterable[dict[str, Any]]:
        rows = trial_page(database, study.id, sought, counts(), is_voted=is_voted, offset=offset, limit=limit)
        return (vote_row(row) for row in rows) if is_voted else rows

    stored = Stored(revision, lambda: sum(n for _, n in counts()), read)
    return stored_table(stored, columns.TABLES[name], chosen, f"{study.slug}-{name}")


def _records(
    read: Callable[[Transaction, int], Iterable[Mapping[str, Any]]],
    database: Database,
    study: Study,
    chosen: TableRequest,
    name: str,
    sources: Tables,
    count: Callable[[Transaction, int], int] | None = None,
) -> Response:
    """Send the rows of a short table, unless the client has them and the stored tables behind them are as they were."""
    with database.snapshot() as connection:
        state = table_state(connection, study.id, sources)
        facts = [study.id, study.options, tag_names(connection, study.id), state]
        digest = table_digest(chosen, name, facts)
        if is_known(chosen, digest):
            return unchanged(digest)
        n_rows = count(connection, study.id) if count else None
        return table(read(connection, study.id), columns.TABLES[name], chosen, f"{study.slug}-{name}", digest, n_rows)


def _audit_table(database: Database, chosen: TableRequest, name: str, study_id: int | None, search: str) -> Response:
    """Send a page of the audit log, whose entries are never altered."""
    with database.reading() as connection:
        n, newest = audit_state(connection, study_id=study_id, search=search)

    def read(offset: int, limit: int | None) -> Iterator[dict[str, Any]]:
        end = n if limit is None else min(n, offset + limit)
        for first in range(offset, end, ENTRIES_AT_ONCE):
            size = min(ENTRIES_AT_ONCE, end - first)
            with database.reading() as connection:
                yield from audit_records(
                    connection, study_id=study_id, search=search, until=newest, limit=size, offset=first
                )

    stored = Stored([study_id, search, n, newest], lambda: n, read)
    return stored_table(stored, columns.AUDIT, chosen, name)


def _results(database: Database, study: Study, chosen: TableRequest, name: str) -> Response:
    """Send rows of the analysis: the documented columns, then any others of the rows. Scores are fitted alone."""
    with database.snapshot() as connection:
        inputs = inputs_of(connection, study.id)
        digest = table_digest(chosen, name, inputs.digest)
        if is_known(chosen, digest):
            return unchanged(digest)
        prepared = prepare_results(connection, inputs)
    rows = prepared.score_rows() if name == "scores" else rows_of(prepared.results().analysis or {}, name)
    return table(rows, columns.with_others(columns.TABLES[name], rows), chosen, f"{study.slug}-{name}", digest)

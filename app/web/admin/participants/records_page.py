"""Manage a study's participants: their data, exclusions with reasons, withdrawal and erasure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Form, Path, Query, Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse, Response
from pydantic import StringConstraints

from app.errors import InvalidError
from app.operations.upkeep.people import (
    enter_screening,
    erase_person,
    exclude_person,
    include_person,
    let_take_part_again,
    renew_code,
    withdraw_person,
)
from app.store.access.experimenters import Experimenter
from app.store.participants.comments import SoughtComments, comment_records
from app.store.participants.exclusions import AGAIN
from app.store.participants.participants import (
    SORTABLE,
    SoughtPeople,
    everything_of,
    exclusion_records,
    n_participants,
    participant_labelled,
    participant_record,
    participant_records,
    stage_records,
)
from app.store.participants.recruits import outside_ids_of, recruit_of, recruit_records
from app.store.participants.screening import screening_records, screening_verdicts
from app.store.studies.audit import Entry, record
from app.store.studies.film_failures import failures_by_person
from app.store.studies.studies import Study
from app.store.trials.counted_votes import vote_state
from app.study.options.options import parse_options
from app.study.options.wording import asked_questions
from app.study.questions.answers import WordedAnswer, worded_answers
from app.study.screening.screening import EnteredResult, TestName
from app.study.screening.verdicts import worded_result, worded_verdicts
from app.study.stages import ENDS, INTERVIEW, SCREENING
from app.web.admin.flags import PATIENCE_S, Flags
from app.web.admin.layout import attachment, see, study_page
from app.web.admin.listing import listing
from app.web.analyst.columns import OUTSIDE_IDS
from app.web.analyst.formats import csv_text
from app.web.gates import Now, Store, database, now, settings
from app.web.roles import Acting, AStudy, Looking

UNUSUAL = "unusual"  # a standing that the analysis knows, not the store

Label = Annotated[str, Path(max_length=40)]
Reason = Annotated[str, StringConstraints(strip_whitespace=True, min_length=3, max_length=500), Form()]
Again = Annotated[str, Form(max_length=40)]
Line = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200), Form()]

router = APIRouter(prefix="/admin/studies/{slug}/participants", include_in_schema=False)


@router.get("")
def participants_page(
    request: Request,
    person: Looking,
    study: AStudy,
    database: Store,
    search: Annotated[str, Query(max_length=40)] = "",
    standing: Annotated[str, Query(max_length=20)] = "",
) -> Response:
    options, unusual = parse_options(study.options), _unusual(request, study)
    flagged = frozenset(label for label, flags in unusual["flags"].items() if flags)
    sought = SoughtPeople(search.strip(), standing, flagged if standing == UNUSUAL else None)
    with database.reading() as connection:
        shown = listing(request, n_participants(connection, study.id, sought), SORTABLE)
        people = participant_records(
            connection, study.id, sought, sort=shown.sort, limit=shown.size, offset=shown.offset
        )
        labels = [row["participant"] for row in people]
        outside_ids = outside_ids_of(connection, study.id, labels)
        verdicts = screening_verdicts(connection, study.id, labels)
        failed = failures_by_person(connection, study.id)
    context = {
        "people": people,
        "list": shown,
        "outside_ids": outside_ids,
        "failed": failed,
        "screened": {label: worded_verdicts(by_test) for label, by_test in verdicts.items()},
        "chosen": {"search": search, "standing": standing},
        "has_recruits": options.outside.is_on,
        "has_groups": bool(options.groups),
        "is_screened": SCREENING in options.optional_stages or bool(verdicts),
        **unusual,
    }
    return study_page(request, "participants", person, study, context)


@router.get("/outside-ids.csv")
def export_outside_ids(person: Looking, study: AStudy, database: Store, moment: Now) -> Response:
    """Export everybody's outside id, state and completion code, to approve and pay them on the platform."""
    options = parse_options(study.options).outside
    with database.writing() as connection:
        rows = recruit_records(connection, study.id, options.code)
        record(connection, person.name, Entry("outside ids exported", study.id, study.slug), moment)
    headers = {"Content-Disposition": attachment(f"{study.slug}-outside-ids.csv")}
    return Response(csv_text(rows, list(OUTSIDE_IDS)), media_type="text/csv; charset=utf-8", headers=headers)


@router.get("/{label}")
def participant_page(request: Request, person: Looking, study: AStudy, label: Label) -> Response:
    return _participant_page(request, person, study, label)


@router.post("/{label}/resume-code")
def renew_resume_code(
    request: Request, person: Looking, actor: Acting, study: AStudy, label: Label, database: Store
) -> Response:
    """Make a new resume code for a participant who lost theirs, shown only once."""
    code = renew_code(database, study, label, actor)
    return _participant_page(request, person, study, label, code)


@router.post("/{label}/screening")
def enter_screening_result(
    actor: Acting,
    study: AStudy,
    label: Label,
    test: Annotated[TestName, Form()],
    instrument: Line,
    result: Line,
    verdict: Annotated[Literal["passed", "failed"], Form()],
    database: Store,
    logmar: Annotated[float | None, Form(ge=-1, le=3, allow_inf_nan=False)] = None,
) -> Response:
    """Enter the result of a test beside the screen, such as a printed chart; earlier ones stay."""
    entered = EnteredResult(test, instrument, result, verdict, logmar)
    enter_screening(database, study, label, entered, actor)
    return see(_address(study, label))


@router.post("/{label}/exclude")
def exclude_participant(actor: Acting, study: AStudy, label: Label, reason: Reason, database: Store) -> Response:
    exclude_person(database, study, label, reason, actor)
    return see(_address(study, label))


@router.post("/{label}/include")
def include_again(actor: Acting, study: AStudy, label: Label, database: Store) -> Response:
    include_person(database, study, label, actor)
    return see(_address(study, label))


@router.post("/{label}/again")
def let_again(actor: Acting, study: AStudy, label: Label, database: Store) -> Response:
    """Let a participant begin anew by the same link."""
    let_take_part_again(database, study, label, actor)
    return see(_address(study, label))


@router.post("/{label}/withdraw")
def withdraw_for_participant(actor: Acting, study: AStudy, label: Label, again: Again, database: Store) -> Response:
    """Withdraw a participant, which nothing undoes; typing the label again prevents accidents."""
    _check_typed("withdraw", label, again)
    withdraw_person(database, study, label, actor)
    return see(_address(study, label))


@router.post("/{label}/erase")
def erase_participant(
    request: Request, actor: Acting, study: AStudy, label: Label, again: Again, database: Store
) -> Response:
    """Erase a participant's data; typing the label again prevents accidents."""
    _check_typed("erase", label, again)
    erase_person(settings(request), database, study, label, actor)
    return see(_address(study, label))


def _check_typed(what: str, label: str, again: str) -> None:
    """Refuse what cannot be undone unless the participant's label was typed."""
    if again.strip() != label:
        raise InvalidError(f"To {what} {label}, type {label} into the field. Nothing was changed.")


def _participant_page(
    request: Request, person: Experimenter, study: Study, label: str, resume_code: str | None = None
) -> Response:
    with database(request).reading() as connection:
        participant = participant_labelled(connection, study.id, label)
        facts = participant_record(connection, participant)
        given = stage_records(connection, participant.id)
        history = exclusion_records(connection, participant.id)
        recruit = recruit_of(connection, participant.id)
        screened = [
            row | {"words": worded_result(row)} for row in screening_records(connection, study.id, participant.id)
        ]
        comments = comment_records(connection, study.id, SoughtComments(participant=label))
    is_let_in_again = facts["excluded"] and facts["reason"] == AGAIN
    context = {
        "facts": facts,
        "given": given,
        "history": history,
        "recruit": recruit,
        "screened": screened,
        "comments": comments,
        "answers": _answers(study, given),
        **_unusual(request, study),
        "may_go_on": facts["stage"] not in ENDS and not is_let_in_again,
        "is_let_in_again": is_let_in_again,
        "resume_code": resume_code,
    }
    return study_page(request, "participant", person, study, context)


def _answers(study: Study, given: Sequence[Mapping[str, Any]]) -> list[WordedAnswer]:
    """Word the questionnaire of a participant; nothing before it is answered."""
    answers: Mapping[str, Any] = next(
        (row["data"].get("answers", {}) for row in given if row["stage"] == INTERVIEW), {}
    )
    return worded_answers(asked_questions(parse_options(study.options)), answers)


def _address(study: Study, label: str) -> str:
    return f"/admin/studies/{study.slug}/participants/{label}"


def _unusual(request: Request, study: Study) -> dict[str, Any]:
    """Return the flags known now, and whether newer ones are being computed; the page does not wait for the end."""
    with database(request).reading() as connection:
        votes = vote_state(connection, study.id)
    flags: Flags = request.app.state.flags
    return {
        "flags": flags.of(study.id, votes, now(request), PATIENCE_S),
        "is_computing": flags.is_computing(study.id),
    }


@router.get("/{label}/export.json")
def export_participant(person: Looking, study: AStudy, label: Label, database: Store, moment: Now) -> Response:
    """Export all data of a participant, on request."""
    with database.writing() as connection:
        participant = participant_labelled(connection, study.id, label)
        given = everything_of(connection, participant)
        record(connection, person.name, Entry("participant exported", study.id, label), moment)
    headers = {"Content-Disposition": attachment(f"{study.slug}-{label}.json")}
    return JSONResponse(jsonable_encoder({"study": study.slug, "participant": label, **given}), headers=headers)

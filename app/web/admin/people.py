"""A study's participants: what each gave, exclusions with reasons, withdrawal and erasure."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Path, Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse, Response

from app.errors import InvalidError
from app.store.audit import Entry, record
from app.store.engine import Database
from app.store.experimenters import Experimenter
from app.store.participants import (
    erase,
    everything_of,
    exclude,
    exclusion_records,
    participant_labelled,
    participant_records,
    stage_records,
    undo_exclusion,
    withdraw_participant,
)
from app.store.sessions import new_resume_code
from app.store.studies import Study
from app.study.stages import ENDS
from app.web.admin.shell import see, study_page
from app.web.gates import Acting, AStudy, Looking, Now, Store, database
from app.web.results import analysis_of

Label = Annotated[str, Path(max_length=40)]
Reason = Annotated[str, Form(min_length=3, max_length=500)]

router = APIRouter(prefix="/admin/studies/{slug}/participants", include_in_schema=False)


@router.get("")
def participants_page(request: Request, person: Looking, study: AStudy, database: Store) -> Response:
    with database.reading() as connection:
        people = participant_records(connection, study.id)
    observers = _observers(database, study.id)
    return study_page(request, "participants", person, study, {"people": people, "observers": observers})


@router.get("/{label}")
def participant_page(request: Request, person: Looking, study: AStudy, label: Label) -> Response:
    return _participant_page(request, person, study, label)


@router.post("/{label}/resume-code")
def renew_resume_code(
    request: Request, person: Looking, actor: Acting, study: AStudy, label: Label, database: Store
) -> Response:
    """A code for who lost theirs, shown this once."""
    with database.writing() as connection:
        code = new_resume_code(connection, participant_labelled(connection, study.id, label).id)
        actor.note(connection, "new code to go on", study, label)
    return _participant_page(request, person, study, label, code)


@router.post("/{label}/exclude")
def exclude_participant(actor: Acting, study: AStudy, label: Label, reason: Reason, database: Store) -> Response:
    with database.writing() as connection:
        exclude(connection, participant_labelled(connection, study.id, label), reason.strip(), actor.name, actor.now)
        actor.note(connection, "participant excluded", study, label, reason=reason.strip())
    return see(_address(study, label))


@router.post("/{label}/include")
def include_again(actor: Acting, study: AStudy, label: Label, database: Store) -> Response:
    with database.writing() as connection:
        undo_exclusion(connection, participant_labelled(connection, study.id, label), actor.name, actor.now)
        actor.note(connection, "exclusion undone", study, label)
    return see(_address(study, label))


@router.post("/{label}/withdraw")
def withdraw_for_participant(actor: Acting, study: AStudy, label: Label, database: Store) -> Response:
    with database.writing() as connection:
        withdraw_participant(connection, participant_labelled(connection, study.id, label), actor.now)
        actor.note(connection, "participant withdrawn", study, label)
    return see(_address(study, label))


@router.post("/{label}/erase")
def erase_participant(
    actor: Acting, study: AStudy, label: Label, again: Annotated[str, Form(max_length=40)], database: Store
) -> Response:
    """Delete what somebody gave; typing the label again keeps slips from being final."""
    if again.strip() != label:
        raise InvalidError(f"To erase {label}, type {label} into the field. Nothing was erased.")
    with database.writing() as connection:
        erase(connection, participant_labelled(connection, study.id, label), actor.now)
        actor.note(connection, "participant erased", study, label)
    return see(_address(study, label))


def _participant_page(
    request: Request, person: Experimenter, study: Study, label: str, resume_code: str | None = None
) -> Response:
    with database(request).reading() as connection:
        found = participant_labelled(connection, study.id, label)
        (facts,) = (row for row in participant_records(connection, study.id) if row["participant"] == label)
        given = stage_records(connection, found.id)
        history = exclusion_records(connection, found.id)
    context = {
        "facts": facts,
        "given": given,
        "history": history,
        "observer": _observers(database(request), study.id).get(label),
        "may_go_on": facts["stage"] not in ENDS,
        "resume_code": resume_code,
    }
    return study_page(request, "participant", person, study, context)


def _address(study: Study, label: str) -> str:
    return f"/admin/studies/{study.slug}/participants/{label}"


def _observers(database: Database, study_id: int) -> dict[str, dict[str, object]]:
    analysis = analysis_of(database, study_id)
    return {row["participant"]: row for row in analysis["observers"]} if analysis else {}


@router.get("/{label}/export.json")
def export_participant(person: Looking, study: AStudy, label: Label, database: Store, now: Now) -> Response:
    """All that is kept of one participant, for who asks for it."""
    with database.writing() as connection:
        found = participant_labelled(connection, study.id, label)
        given = everything_of(connection, found)
        record(connection, person.name, Entry("participant exported", study.id, label), now)
    headers = {"Content-Disposition": f'attachment; filename="{study.slug}-{label}.json"'}
    return JSONResponse(jsonable_encoder({"study": study.slug, "participant": label, **given}), headers=headers)

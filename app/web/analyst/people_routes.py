"""Change what is kept of participants over REST: exclude, withdraw, erase, give a new code, code comments."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field, StringConstraints

from app.operations.upkeep import comments
from app.operations.upkeep.people import (
    enter_screening,
    erase_person,
    exclude_person,
    include_person,
    let_take_part_again,
    note_interview,
    renew_code,
    withdraw_person,
)
from app.store.access.rights import ERASING, PEOPLE, PERSONAL, STUDIES
from app.store.database.engine import Database
from app.store.participants.comments import LONGEST_COMMENT, LONGEST_TAG, CommentPlace, Source
from app.store.participants.participants import everything_of, exclusion_records, participant_labelled
from app.store.participants.recruits import recruit_records
from app.store.studies.audit import Actor, Entry, record
from app.store.studies.studies import Study
from app.study.options.options import parse_options
from app.study.questions.questionnaire import LONGEST_ANSWER, LONGEST_QUESTION
from app.study.screening.screening import EnteredResult, TestName
from app.web.analyst import columns
from app.web.analyst.formats import ChosenFormat, CompressedRoute, table
from app.web.analyst.openapi import object_answers, table_answers
from app.web.analyst.openapi_examples import EVERYTHING
from app.web.analyst.study_routes import Body, StudyEditor
from app.web.gates import Now, Store, settings
from app.web.roles import AStudy, Reader, may_change, may_read

BASE = "/studies/{slug}/participants/{label}"
router = APIRouter(prefix="/api/v1", tags=["people"], route_class=CompressedRoute)

Excluder = Annotated[Actor, Depends(may_change(PEOPLE))]
Eraser = Annotated[Actor, Depends(may_change(ERASING))]
Label = Annotated[str, Path(max_length=40)]
Line = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200)]
Tag = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=LONGEST_TAG)]
TagInPath = Annotated[str, Path(min_length=1, max_length=LONGEST_TAG)]


def place_of_comment(
    participant: Annotated[str, Query(max_length=40)],
    source: Annotated[Source, Query()],
    subject: Annotated[str, Query(max_length=LONGEST_QUESTION, description="as the table `comments` has it")],
) -> CommentPlace:
    """Read which comment is meant."""
    return CommentPlace(participant, source, subject)


AComment = Annotated[CommentPlace, Depends(place_of_comment)]
TagOfComment = Annotated[str, Query(min_length=1, max_length=LONGEST_TAG)]


class TagBody(Body):
    tag: Annotated[Tag, Field(description="its new name")]


class NoteBody(Body):
    comment: Annotated[str, StringConstraints(strip_whitespace=True, max_length=LONGEST_COMMENT)]


class ExclusionBody(Body):
    reason: Annotated[str, StringConstraints(strip_whitespace=True, min_length=3, max_length=500)]


class EnteredBody(Body):
    test: TestName
    instrument: Annotated[Line, Field(description="chart, plates or device, with its distance where it matters")]
    result: Annotated[Line, Field(description="as it was read")]
    verdict: Literal["passed", "failed"]
    logmar: Annotated[float | None, Field(ge=-1, le=3, allow_inf_nan=False, description="of acuity")] = None


class InterviewBody(Body):
    answers: Annotated[
        dict[Annotated[str, StringConstraints(max_length=LONGEST_ANSWER)], str],
        Field(description="what was said, by the question as the study asks it"),
    ]


class ExclusionView(BaseModel):
    participant: str
    reason: str
    excluded_by: str
    excluded_at: str


class CodeView(BaseModel):
    participant: str
    code: str = Field(description="by which the participant goes on; it is shown this once")


@router.put(f"{BASE}/exclusion", response_model=ExclusionView)
def exclude_participant(
    body: ExclusionBody, label: Label, actor: Excluder, study: AStudy, database: Store
) -> dict[str, Any]:
    """Leave a participant's votes out of the analysis, for a reason.

    Sent again with the same reason, it changes nothing; with another one it is refused (409).
    """
    held = _exclusion_of(database, study, label)
    if held is None or held["reason"] != body.reason:
        exclude_person(database, study, label, body.reason, actor)
        held = _exclusion_of(database, study, label)
    assert held is not None, "it was just inserted"
    shown = {name: held[name] for name in ("reason", "excluded_by")}
    return {"participant": label, **shown, "excluded_at": held["excluded_at"].isoformat()}


@router.delete(f"{BASE}/exclusion", status_code=204, response_class=Response)
def include_participant(label: Label, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Count a participant's votes again; sent again, it changes nothing."""
    if _exclusion_of(database, study, label) is not None:
        include_person(database, study, label, actor)
    return Response(status_code=204)


@router.put(f"{BASE}/withdrawal", status_code=204, response_class=Response)
def withdraw(label: Label, actor: Eraser, study: AStudy, database: Store) -> Response:
    """Withdraw a participant at their request, which nothing undoes: their data stay and no longer count."""
    withdraw_person(database, study, label, actor)
    return Response(status_code=204)


@router.put(f"{BASE}/erasure", status_code=204, response_class=Response)
def erase(request: Request, label: Label, actor: Eraser, study: AStudy, database: Store) -> Response:
    """Delete all that a participant gave, for good, also from backups that are restored later; once (then 409)."""
    erase_person(settings(request), database, study, label, actor)
    return Response(status_code=204)


@router.post(f"{BASE}/resume-code", status_code=201, response_model=CodeView)
def renew_resume_code(label: Label, actor: StudyEditor, study: AStudy, database: Store) -> CodeView:
    """Make a new code for a participant who lost theirs; the older one ends. After the end of a session: 409."""
    return CodeView(participant=label, code=renew_code(database, study, label, actor))


@router.post(f"{BASE}/screening", status_code=204, response_class=Response)
def enter_screening_result(
    body: EnteredBody, label: Label, actor: Excluder, study: AStudy, database: Store
) -> Response:
    """Enter the result of a test beside the screen, such as a printed chart; the newest of a test counts."""
    enter_screening(database, study, label, EnteredResult(**body.model_dump()), actor)
    return Response(status_code=204)


@router.post(f"{BASE}/again", status_code=204, response_class=Response)
def take_part_again(label: Label, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Let somebody begin anew by the same link, after bad luck; what they gave before stays, and counts no more.

    Once for each participant (then 409).
    """
    let_take_part_again(database, study, label, actor)
    return Response(status_code=204)


@router.put(f"{BASE}/interview", status_code=204, response_class=Response)
def note_spoken_answers(body: InterviewBody, label: Label, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Note what a participant said in the spoken interview; the questions left out keep their answers.

    The table `questionnaire` has all answers.
    """
    note_interview(database, study, label, body.answers, actor)
    return Response(status_code=204)


@router.put("/studies/{slug}/comment_tags/{tag:path}", status_code=204, response_class=Response)
def keep_tag(tag: TagInPath, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Add a tag to code comments with; sent again, it changes nothing."""
    comments.keep_tag(database, study, tag, actor)
    return Response(status_code=204)


@router.patch("/studies/{slug}/comment_tags/{tag:path}", status_code=204, response_class=Response)
def call_tag(body: TagBody, tag: TagInPath, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Give a tag another name; its comments keep it."""
    comments.call_tag(database, study, tag, body.tag, actor)
    return Response(status_code=204)


@router.delete("/studies/{slug}/comment_tags/{tag:path}", status_code=204, response_class=Response)
def delete_tag(tag: TagInPath, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Delete a tag, and take it off its comments for good."""
    comments.remove_tag(database, study, tag, actor)
    return Response(status_code=204)


@router.put("/studies/{slug}/comments/tag", status_code=204, response_class=Response)
def tag_comment(place: AComment, tag: TagOfComment, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Give a comment a tag, which is added to the study if it is new; sent again, it changes nothing."""
    comments.put_tag(database, study, place, tag, actor)
    return Response(status_code=204)


@router.delete("/studies/{slug}/comments/tag", status_code=204, response_class=Response)
def untag_comment(place: AComment, tag: TagOfComment, actor: Excluder, study: AStudy, database: Store) -> Response:
    """Take a tag off a comment; sent again, it changes nothing."""
    comments.take_tag_off(database, study, place, tag, actor)
    return Response(status_code=204)


@router.put("/studies/{slug}/trials/{trial}/comment", status_code=204, response_class=Response)
def note_on_trial(
    body: NoteBody,
    trial: Annotated[str, Path(max_length=32)],
    actor: Excluder,
    study: AStudy,
    database: Store,
) -> Response:
    """Note what was said or seen at a trial, in place of an earlier note; an empty one deletes it."""
    comments.note_on_trial(database, study, trial, body.comment, actor)
    return Response(status_code=204)


@router.get(BASE, responses=object_answers(EVERYTHING))
def everything(
    label: Label, who: Annotated[Reader, Depends(may_read(PERSONAL))], study: AStudy, database: Store, now: Now
) -> Response:
    """Send all data of a participant, as they may ask for them; the audit log notes it."""
    with database.writing() as connection:
        given = everything_of(connection, participant_labelled(connection, study.id, label))
        record(connection, who.name, Entry("participant exported", study.id, label), now)
    return JSONResponse(jsonable_encoder({"study": study.slug, "label": label, **given}))


@router.get("/studies/{slug}/outside-ids", responses=table_answers(columns.OUTSIDE_IDS))
def outside_ids(
    who: Annotated[Reader, Depends(may_read(STUDIES))], study: AStudy, database: Store, chosen: ChosenFormat, now: Now
) -> Response:
    """List everybody's outside id, state and completion code, to approve and pay them; it takes studies:write."""
    with database.writing() as connection:
        rows = recruit_records(connection, study.id, parse_options(study.options).outside.code)
        record(connection, who.name, Entry("outside ids exported", study.id, study.slug), now)
    return table(rows, columns.OUTSIDE_IDS, chosen, f"{study.slug}-outside-ids")


def _exclusion_of(database: Database, study: Study, label: str) -> dict[str, Any] | None:
    """Return the exclusion of a participant that holds."""
    with database.reading() as connection:
        person = participant_labelled(connection, study.id, label)
        return next((row for row in exclusion_records(connection, person.id) if row["undone_at"] is None), None)

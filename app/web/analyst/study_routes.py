"""Create, edit, open, close, archive, duplicate and delete studies over REST, and invite to them."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Annotated, Any
from urllib.parse import unquote

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from app.errors import InvalidError, NotFoundError, StudyError, said_on_page
from app.ffmpeg import no_progress
from app.operations.studies.create import duplicate_study, read_options, shows_anything
from app.operations.studies.creation import begin_creation
from app.operations.studies.drafts import Draft, outlook_of
from app.operations.studies.edit import check_edit, remake_films, save_edit
from app.operations.studies.invitations import MOST_AT_ONCE, make_invitations, name_invitation, stop_invitation
from app.operations.studies.manage import study_file_of, study_summary
from app.operations.studies.standing import change_standing, delete_study, give_new_address
from app.operations.studies.stimulus_sets import set_called
from app.operations.tasks import wait_for_task
from app.store.access.rights import STUDIES
from app.store.database.engine import Database
from app.store.database.server_tasks import cancel_task, task_by_id
from app.store.participants.invitations import Invitation, invitations_of
from app.store.studies.audit import Actor
from app.store.studies.drafts import KeptDraft, drafts_of, drop_draft, keep_draft
from app.store.studies.studies import Standing, Study, StudyCounts, progress_of, study_by_slug
from app.study.kinds import QUICK
from app.study.options.neutral_words import neutral_words
from app.study.options.option_table import COLUMNS
from app.study.options.options import overridden, parse_options
from app.study.options.own_texts import LONGEST_NAME
from app.study.options.study_file import StudyFile
from app.study.options.wording import check_languages
from app.study.planning import MOST_PLACES
from app.study.protocols import EXPOSURE_BOUNDS_S
from app.web.analyst.formats import CompressedRoute
from app.web.gates import Store, languages, link_to, settings
from app.web.roles import AStudy, may_change

LOW_S, HIGH_S = EXPOSURE_BOUNDS_S


router = APIRouter(prefix="/api/v1", tags=["studies"], route_class=CompressedRoute)

StudyEditor = Annotated[Actor, Depends(may_change(STUDIES))]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME, description="as participants read it")]
Exposure = Annotated[float, Field(ge=LOW_S, le=HIGH_S, allow_inf_nan=False, description="how long a pair is shown, s")]
Seed = Annotated[int, Field(ge=0, le=2**63 - 1, description="of all participants' orders")]
Options = Annotated[dict[str, Any], Field(description="as in the table [options] of a study file")]
InvitationLabel = Annotated[
    str, StringConstraints(strip_whitespace=True, max_length=200), Field(description="whom it is for; empty: nobody")
]
Code = Annotated[str, Path(max_length=40)]
SetName = Annotated[str, Path(max_length=200, description="name of a stimulus set on the server")]
TaskId = Annotated[str, Path(max_length=32, description="id of the task")]
Wait = Annotated[float, Query(ge=0, le=600, description="longest wait for the end, s")]
WAIT_S = 15.0
RESULTS = re.compile(
    r"/admin/(studies/(?P<study>[^/]+)(/.*)?|sets/(?P<stimulus_set>[^/]+)|files/(?P<file>[^/]+/[^/]+))"
)  # pages that tasks lead to


class Body(BaseModel):
    """A body that refuses names it does not know, and converts no types."""

    model_config = ConfigDict(extra="forbid", strict=True)


class NewStudyBody(Body):
    name: Name
    stimulus_set: Annotated[str, Field(max_length=200, description="name of a stimulus set on the server")]
    preset: Annotated[str, Field(max_length=20, description="paper, quick or online")] = QUICK
    options: Options = {}
    exposure_s: Exposure | None = None
    seed: Seed | None = None


class DraftBody(Body):
    preset: Annotated[str, Field(max_length=20, description="that fills in what was not typed")] = QUICK
    platform: Annotated[str, Field(max_length=20, description="such as prolific; empty: you invite people")] = ""
    answers: Annotated[
        dict[str, Annotated[str, Field(max_length=200)]],
        Field(max_length=100, description="what the platform shows you, such as prolific.code"),
    ] = {}
    typed: Annotated[dict[str, Any], Field(description="settings by name, such as break_every or limits.finished")] = {}


class EditBody(Body):
    revision: Annotated[int, Field(ge=1, le=2**31 - 1, description="of the study as you read it")]
    name: Name | None = None
    exposure_s: Exposure | None = None
    seed: Seed | None = None
    options: Options = {}


class StateBody(Body):
    state: Standing


class CopyBody(Body):
    name: Name


class InvitationsBody(Body):
    places: Annotated[int | None, Field(ge=1, le=MOST_PLACES, description="null: as many as come")] = None
    number: Annotated[int, Field(ge=1, le=MOST_AT_ONCE, description="how many invitations to make")] = 1
    label: InvitationLabel = ""


class LabelBody(Body):
    label: InvitationLabel


class ManagedStudyView(BaseModel):
    slug: str
    name: str
    state: Standing
    exposure_s: float
    created_at: str
    n_datasets: int
    n_conditions: int
    n_pairs: int
    n_started: int
    n_finished: int
    n_votes: int
    revision: int
    seed: int
    options: dict[str, Any]


class TaskView(BaseModel):
    """What the server makes or checks in the background."""

    task: str
    state: str = Field(description="running, done or failed")
    done: int = Field(description="how much of the step is done")
    total: int = Field(description="how much the step is")
    detail: str = Field(description="what is being done, or why it failed")
    is_cancelled: bool
    study: str | None = Field(description="the study's name in addresses, once it is made or checked")
    stimulus_set: str | None = Field(default=None, description="name of the stimulus set that was uploaded")
    file: str | None = Field(default=None, description="shelf and name of the file that was uploaded")


class DraftView(DraftBody):
    """A form of a study that is not created yet."""

    stimulus_set: str
    changed_at: datetime


class WholeDraftView(DraftView):
    """A form with the study that it describes, and what this will be; null: it cannot be made yet."""

    hindrance: str = Field(description="why no study can be made of it; empty: it can")
    study: dict[str, Any] | None = Field(
        description="name, exposure_s, seed and options, as creating a study takes them"
    )
    n_pairs: int | None = Field(description="to compare; 0: films are shown one by one")
    n_trials: int | None = Field(description="of a participant, without practice")
    n_films: int | None = Field(description="files to make")
    n_bytes: float | None = Field(description="of these files, about")
    seconds: float | None = Field(description="to make them, about")
    minutes: dict[str, float] | None = Field(description="of a session, by stage")


class InvitationView(BaseModel):
    code: str
    places: int | None
    n_used: int
    path: str
    link: str  # whole, with the parameters that a recruiting platform fills in
    label: str = ""


@router.get("/drafts", response_model=list[DraftView])
def drafts(actor: StudyEditor, database: Store) -> list[DraftView]:
    """List your forms of studies that are not created yet, as the dashboard keeps them: the latest of each set."""
    with database.reading() as connection:
        return [_draft(kept) for kept in drafts_of(connection, actor.name)]


@router.get("/drafts/{stimulus_set}", response_model=WholeDraftView)
def draft(stimulus_set: SetName, request: Request, actor: StudyEditor, database: Store) -> WholeDraftView:
    """Send your form of a stimulus set, and what its study would be."""
    return _whole_draft(request, database, actor, stimulus_set)


@router.put("/drafts/{stimulus_set}", response_model=WholeDraftView)
def keep_your_draft(
    body: DraftBody, stimulus_set: SetName, request: Request, actor: StudyEditor, database: Store
) -> WholeDraftView:
    """Keep a form in place of your earlier one of the stimulus set, and say what its study would be.

    What is not complete yet is kept, too; `hindrance` says why no study can be made of it.
    """
    try:
        given = Draft.given(body.model_dump())
    except ValueError as error:
        raise InvalidError(f"Nothing was kept: {error}.") from error
    with database.writing() as connection:
        known = set_called(settings(request), connection, stimulus_set)
        keep_draft(connection, actor.name, known.name, given.as_json(), actor.now)
    return _whole_draft(request, database, actor, stimulus_set)


@router.delete("/drafts/{stimulus_set}", status_code=204, response_class=Response)
def drop_your_draft(stimulus_set: SetName, actor: StudyEditor, database: Store) -> Response:
    """Drop your form of a stimulus set; sent again, it changes nothing."""
    with database.writing() as connection:
        drop_draft(connection, actor.name, stimulus_set)
    return Response(status_code=204)


@router.post(
    "/studies",
    status_code=201,
    response_model=ManagedStudyView,
    responses={202: {"model": TaskView, "description": "Its films are being made; ask for the task"}},
)
def create(
    body: NewStudyBody,
    request: Request,
    actor: StudyEditor,
    database: Store,
    wait_s: Wait = WAIT_S,
) -> Response:
    """Create a study of a stimulus set on the server; it stays paused until opened.

    201 with the study where its films are there or soon made; else 202 with the task that makes them, which goes on
    after a restart of the server and can be cancelled. Films that are there are not made again.
    """
    server = settings(request)
    with database.reading() as connection:
        folder = set_called(server, connection, body.stimulus_set).folder
    try:
        options = read_options(None, body.options, body.preset)
        check_languages(options, languages(request))
        wanted = StudyFile(name=body.name, exposure_s=body.exposure_s, seed=body.seed, options=options)
        name = begin_creation(server, database, folder, wanted, actor)
    except (ValueError, TypeError) as error:
        raise InvalidError(f"The study was not created: {error}.") from error
    begun = waited_task(database, name, wait_s, "The study was not created")
    return accepted(begun) if begun.study is None else _created(database, begun.study)


@router.get("/tasks/{task}", response_model=TaskView)
def task(request: Request, task: TaskId, actor: StudyEditor, database: Store) -> TaskView:
    """Say how far a task is: the making of a study, an upload, or a check."""
    return _task(database, task, _seen_of(request, actor))


@router.delete("/tasks/{task}", response_model=TaskView)
def cancel(request: Request, task: TaskId, actor: StudyEditor, database: Store) -> TaskView:
    """Stop a task, as soon as the step is done that runs now."""
    _task(database, task, _seen_of(request, actor))  # which refuses that of others
    with database.writing() as connection:
        if cancel_task(connection, task, actor.now):
            actor.note(connection, "work cancelled", subject=task)
    return _task(database, task)


def waited_task(database: Database, name: str, longest_s: float, refusal: str) -> TaskView:
    """Wait for a task, but not long, and say how far it is.

    Raises
    ------
    InvalidError
        If it has failed: `refusal`, and why.
    """
    wait_for_task(name, longest_s)
    begun = _task(database, name)
    if begun.state == "failed":
        raise InvalidError(f"{refusal}: {begun.detail.rstrip('.')}.")
    return begun


def accepted(task: TaskView) -> Response:
    """Answer that a task goes on, or has ended, and where to ask for it."""
    headers = {"Location": f"{router.prefix}/tasks/{task.task}"}
    return JSONResponse(task.model_dump(), 200 if task.state == "done" else 202, headers=headers)


def _seen_of(request: Request, actor: Actor) -> str | None:
    """Return whose tasks alone somebody sees who sees some studies only; None: everybody's."""
    return None if request.state.studies is None else actor.name


def _task(database: Database, name: str, seen_of: str | None = None) -> TaskView:
    with database.reading() as connection:
        known = task_by_id(connection, name)
    if known is None or seen_of not in (None, known.actor):
        raise NotFoundError("There is no such task.")
    made = RESULTS.fullmatch(known.result or "") if known.state == "done" else None
    named: dict[str, Any] = {kind: unquote(name) for kind, name in (made.groupdict() if made else {}).items() if name}
    facts: dict[str, Any] = {key: getattr(known, key) for key in ("state", "done", "total", "detail")}
    return TaskView(task=name, is_cancelled=known.cancelled_at is not None, **{"study": None, **named}, **facts)


@router.patch("/studies/{slug}", response_model=ManagedStudyView)
def edit(body: EditBody, request: Request, actor: StudyEditor, study: AStudy, database: Store) -> dict[str, Any]:
    """Change a study's name, exposure, seed or options; what is left out stays, also of a table such as `screening`.

    After somebody has begun, most settings are fixed. Where a setting needs other films, the answer comes when they are
    made. If somebody else has changed the study since you read it, so that its revision is another one, nothing is
    changed (409).
    """
    before = study_file_of(study)
    given = {name: value for name, value in body.model_dump().items() if value is not None and name in COLUMNS}
    try:
        options = parse_options(overridden(before.options.as_json(), body.options))
    except (ValueError, TypeError) as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    wanted = before.but(options=options, **given)
    server = settings(request)
    change = check_edit(server, database, study, wanted, languages(request))
    if change.folder is None:
        save_edit(database, change, body.revision, actor)
    else:
        remake_films(server, database, change, body.revision, actor, no_progress)
    return _view(database, study.slug)


@router.put("/studies/{slug}/state", response_model=ManagedStudyView)
def change_state(body: StateBody, actor: StudyEditor, study: AStudy, database: Store) -> dict[str, Any]:
    """Open, pause, close or archive a study; sent again, it changes nothing."""
    change_standing(database, study, body.state, actor)
    return _view(database, study.slug)


@router.put("/studies/{slug}/address", response_model=ManagedStudyView)
def change_address(request: Request, actor: StudyEditor, study: AStudy, database: Store) -> dict[str, Any]:
    """Give a renamed study the address of its name; the older address is unknown from then on."""
    return _view(database, give_new_address(settings(request), database, study, actor))


@router.post("/studies/{slug}/duplicate", status_code=201, response_model=ManagedStudyView)
def duplicate(body: CopyBody, actor: StudyEditor, study: AStudy, database: Store) -> Response:
    """Create a study of the same stimuli and options, without participants; it stays paused until opened."""
    try:
        slug = duplicate_study(database, study, body.name, actor)
    except ValueError as error:
        raise InvalidError(f"The study was not duplicated: {error}.") from error
    return _created(database, slug)


@router.delete("/studies/{slug}", status_code=204, response_class=Response)
def delete(actor: StudyEditor, study: AStudy, database: Store) -> Response:
    """Delete a study for good, with all votes; once somebody has begun, only an archived one (else 409)."""
    delete_study(database, study, actor)
    return Response(status_code=204)


@router.get("/studies/{slug}/invitations", response_model=list[InvitationView])
def invitations(request: Request, _actor: StudyEditor, study: AStudy, database: Store) -> list[dict[str, Any]]:
    """List a study's invitations; each code lets people in, so this takes the scope studies:write."""
    with database.reading() as connection:
        return [_invitation(request, study, row) for row in invitations_of(connection, study.id)]


@router.post("/studies/{slug}/invitations", status_code=201, response_model=list[InvitationView])
def invite(
    request: Request, body: InvitationsBody, actor: StudyEditor, study: AStudy, database: Store
) -> list[dict[str, Any]]:
    """Make invitations, each for so many participants."""
    codes = make_invitations(database, study, body.places, [body.label] * body.number, actor)
    with database.reading() as connection:
        return [_invitation(request, study, row) for row in invitations_of(connection, study.id) if row.code in codes]


@router.patch("/studies/{slug}/invitations/{code}", status_code=204, response_class=Response)
def label(body: LabelBody, code: Code, actor: StudyEditor, study: AStudy, database: Store) -> Response:
    """Say whom an invitation is for; participants do not read it."""
    name_invitation(database, study, code, body.label, actor)
    return Response(status_code=204)


@router.delete("/studies/{slug}/invitations/{code}", status_code=204, response_class=Response)
def end(code: Code, actor: StudyEditor, study: AStudy, database: Store) -> Response:
    """Let nobody else in by an invitation; sent again, it changes nothing until the unused code is forgotten (404)."""
    stop_invitation(database, study, code, actor)
    return Response(status_code=204)


def _draft(kept: KeptDraft) -> DraftView:
    content = Draft.kept(kept.content).as_json()
    return DraftView(stimulus_set=kept.stimulus_set, changed_at=kept.changed_at, **content)


def _whole_draft(request: Request, database: Database, actor: Actor, stimulus_set: str) -> WholeDraftView:
    with database.reading() as connection:
        known = set_called(settings(request), connection, stimulus_set)
        kept = next((each for each in drafts_of(connection, actor.name) if each.stimulus_set == known.name), None)
    if kept is None:
        raise NotFoundError("You have no draft of this stimulus set.")
    view = _draft(kept).model_dump()
    facts: dict[str, Any] = dict.fromkeys(("study", "n_pairs", "n_trials", "n_films", "n_bytes", "seconds", "minutes"))
    try:
        wanted, outlook = outlook_of(settings(request), known.content, Draft.kept(kept.content), languages(request))
    except (ValueError, StudyError) as error:
        return WholeDraftView(**view, **facts, hindrance=said_on_page(error))
    numbers = {name: getattr(outlook, name) for name in facts if name != "study"}
    facts |= {name: None if value != value else value for name, value in numbers.items()}
    options = neutral_words(wanted.options) if shows_anything(known.content) else wanted.options
    made = {"name": wanted.name, "exposure_s": wanted.exposure_s, "seed": wanted.seed, "options": options.as_json()}
    return WholeDraftView(**view, **{**facts, "study": made}, hindrance="")


def _invitation(request: Request, study: Study, row: Invitation) -> dict[str, Any]:
    link = link_to(request, study, row.code)
    counts = {"code": row.code, "places": row.places, "n_used": row.n_used}
    return {**counts, "path": f"/s/{row.code}", "link": link, "label": row.label}


def _created(database: Database, slug: str) -> Response:
    return JSONResponse(_view(database, slug), 201, headers={"Location": f"/api/v1/studies/{slug}"})


def _view(database: Database, slug: str) -> dict[str, Any]:
    with database.reading() as connection:
        study = study_by_slug(connection, slug)
        if study is None:
            raise NotFoundError("There is no such study.")
        return _shown(study, progress_of(connection, study.id))


def _shown(study: Study, progress: StudyCounts) -> dict[str, Any]:
    file = study_file_of(study)
    whole = {"revision": study.revision, "seed": study.seed, "options": file.options.as_json()}
    return study_summary(study, progress) | whole

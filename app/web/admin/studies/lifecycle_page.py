"""List studies, and open, pause, close, archive, duplicate or preview one."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, BackgroundTasks, Form, Query, Request
from fastapi.responses import JSONResponse, Response

from app.errors import InvalidError
from app.operations.studies.create import duplicate_study
from app.operations.studies.creation import waiting_drafts
from app.operations.studies.standing import change_standing as change_study
from app.operations.studies.standing import give_new_address
from app.store.database.server_tasks import running_tasks
from app.store.participants.invitations import preview_code
from app.store.studies.studies import Standing, all_studies, progress_by_study
from app.store.trials.admission import begin_preview
from app.study.options.options import parse_options
from app.study.stages import INTRODUCTION
from app.web.admin.background import task_address
from app.web.admin.layout import page, see
from app.web.analyst.results import load_analysis
from app.web.gates import Now, Store, settings
from app.web.participant.beginning import remember
from app.web.roles import Acting, AStudy, Person, is_seen
from app.web.uploads import UploadingActor, begin_importing

router = APIRouter(prefix="/admin", include_in_schema=False)


@router.get("")
def studies_page(request: Request, person: Person, database: Store, now: Now, afterwards: BackgroundTasks) -> Response:
    afterwards.add_task(load_analysis)  # a study's pages come next
    with database.reading() as connection:
        listed = [study for study in all_studies(connection) if is_seen(request, study)]
        progress = progress_by_study(connection)  # read second: it then covers every study listed
        n_drafts = len(waiting_drafts(connection, person.name, now))
        tasks = [task for task in running_tasks(connection, now) if person.studies is None or task.actor == person.name]
    context = {
        "studies": listed,
        "progress_by_study": progress,
        "n_drafts": n_drafts,
        "tasks": tasks,
        "largest_mb": settings(request).largest_upload_mb,
    }
    return page(request, "studies", person, context)


@router.get("/studies")
def short_address(_person: Person) -> Response:
    """Lead from the address that the studies' own begin with to their list."""
    return see("/admin")


@router.put("/studies/import")
async def import_whole(
    request: Request, actor: UploadingActor, database: Store, name: Annotated[str, Query(max_length=200)] = ""
) -> Response:
    """Bring in a whole study from another server, in the background."""
    task = await begin_importing(request, settings(request), actor, database, name)
    return JSONResponse({"task": task_address(task)}, 202)


@router.post("/studies/{slug}/state")
def change_standing(actor: Acting, study: AStudy, state: Annotated[Standing, Form()], database: Store) -> Response:
    change_study(database, study, state, actor)
    return see(f"/admin/studies/{study.slug}")


@router.post("/studies/{slug}/address")
def change_address(request: Request, actor: Acting, study: AStudy, database: Store) -> Response:
    """Give a renamed study the address of its name."""
    slug = give_new_address(settings(request), database, study, actor)
    return see(f"/admin/studies/{slug}/edit?saved=1")


@router.post("/studies/{slug}/duplicate")
def duplicate(
    actor: Acting, study: AStudy, name: Annotated[str, Form(min_length=1, max_length=200)], database: Store
) -> Response:
    """Create a study of the same stimuli and options, without participants."""
    try:
        slug = duplicate_study(database, study, name, actor)
    except ValueError as error:
        raise InvalidError(f"The study was not duplicated: {error}.") from error
    return see(f"/admin/studies/{slug}")


@router.post("/studies/{slug}/preview")
def preview(
    request: Request,
    actor: Acting,
    study: AStudy,
    database: Store,
    stage: Annotated[str, Form(max_length=20)] = INTRODUCTION,
) -> Response:
    """Walk through a study as a participant, from a stage on; nothing is counted or kept."""
    if stage not in parse_options(study.options).way:
        raise InvalidError(f"This study has no stage {stage[:20]!r}.")
    token = begin_preview(database, study, actor.now, stage)
    with database.writing() as connection:
        actor.note(connection, "study previewed", study, study.slug)
        code = preview_code(connection, study.id)
    answer = see(f"/s/{code}")
    remember(request, answer, token)
    return answer

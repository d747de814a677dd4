"""Send films, results and whole studies over REST, look at stimulus sets, and check films."""

from __future__ import annotations

from pathlib import Path as FilePath
from tempfile import TemporaryFile
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import Response, StreamingResponse
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from app.errors import ConflictError, InvalidError, NotFoundError
from app.ffmpeg import Progress
from app.files import private_folder
from app.intake.stimuli import check_videos
from app.operations.studies.check_films import FilmCheck, films_of, last_check, start_film_check
from app.operations.studies.stimulus_sets import (
    KnownSet,
    delete_set,
    known_sets,
    name_factors,
    rename_set,
    set_called,
    studies_of,
)
from app.operations.tasks import start_task
from app.operations.upkeep.travel import export_study
from app.store.access.tokens import PERSONAL, READ, STUDIES
from app.store.database.engine import Database, Transaction
from app.store.studies.audit import Actor, Entry, record_alone
from app.web.analyst import columns
from app.web.analyst.compression import CompressedRoute
from app.web.analyst.formats import ChosenFormat, json_object, parts_of, table
from app.web.analyst.openapi import file_body, object_answers, table_answers
from app.web.analyst.openapi_examples import FILM_CHECK, STIMULUS_SET
from app.web.analyst.study_routes import WAIT_S, Body, StudyEditor, TaskView, Wait, accepted, waited_task
from app.web.gates import Store, now, settings
from app.web.roles import AStudy, Reader, may_read
from app.web.uploads import begin_attaching, begin_importing, begin_installing

ZIP = "application/zip"
router = APIRouter(prefix="/api/v1", tags=["uploads"], route_class=CompressedRoute)

READING = [Depends(may_read(READ))]
Name = Annotated[str, Path(max_length=200)]
ACCEPTED: dict[int | str, dict[str, Any]] = {202: {"model": TaskView, "description": "It goes on; ask for the task"}}


class SetBody(Body):
    name: Annotated[str | None, Field(max_length=200, description="the set's")] = None
    levels: Annotated[
        dict[str, dict[str, str]] | None, Field(description="of each condition, its level of each factor")
    ] = None


@router.get("/sets", responses=table_answers(columns.SETS), dependencies=READING)
def sets(request: Request, database: Store, chosen: ChosenFormat) -> Response:
    """List the stimulus sets of the server."""
    with database.reading() as connection:
        rows = [_row(connection, known) for known in known_sets(settings(request), connection)]
    return table(rows, columns.SETS, chosen, "sets")


@router.get("/sets/{name}", responses=object_answers(STIMULUS_SET), dependencies=READING)
def stimulus_set(request: Request, name: Name, database: Store, chosen: ChosenFormat) -> Response:
    """Describe a stimulus set: its conditions with their levels, and its films."""
    with database.reading() as connection:
        known = set_called(settings(request), connection, name)
        row = _row(connection, known)
    films = [each.model_dump(exclude={"master", "mask", "levels"}) for each in known.content.stimuli]
    return json_object({**row, "levels": known.levels, "stimuli": films}, chosen)


@router.post("/sets", response_model=TaskView, responses=ACCEPTED, openapi_extra=file_body())
async def upload_set(
    request: Request,
    actor: StudyEditor,
    database: Store,
    name: Annotated[str, Query(max_length=200, description="of a set of plain films; empty: the folder's")] = "",
    conform: Annotated[bool, Query(description="make films of a scene alike that differ")] = False,
    wait_s: Wait = WAIT_S,
) -> Response:
    """Upload a zip file of films, SCENE/CONDITION.mp4, or of a stimulus set; every film is looked at and checked."""
    task = await begin_installing(request, settings(request), actor, database, name, is_conformed=conform)
    return await _answer(database, task, wait_s, "The films were not taken in")


@router.patch("/sets/{name}", status_code=204, response_class=Response)
def change_set(body: SetBody, request: Request, name: Name, actor: StudyEditor, database: Store) -> Response:
    """Give a set another name, or its conditions other levels; its studies follow."""
    if body.name is not None:
        rename_set(settings(request), database, name, body.name, actor)
    if body.levels is not None:
        name_factors(settings(request), database, name, body.levels, actor)
    return Response(status_code=204)


@router.delete("/sets/{name}", status_code=204, response_class=Response)
def remove_set(request: Request, name: Name, actor: StudyEditor, database: Store) -> Response:
    """Delete a set and its films, unless a study was made of it (409)."""
    with database.reading() as connection:
        title = set_called(settings(request), connection, name).title
    delete_set(settings(request), database, name, title, actor)
    return Response(status_code=204)


@router.post("/sets/{name}/check", response_model=TaskView, responses=ACCEPTED)
def check_set(request: Request, name: Name, actor: StudyEditor, database: Store, wait_s: Wait = WAIT_S) -> Response:
    """Decode every film of a set to its end, and compare its digest; 422 says what is wrong."""
    with database.reading() as connection:
        known = set_called(settings(request), connection, name)

    def work(progress: Progress) -> str:
        try:
            check_videos(known.content, progress)
        except ValueError as error:  # names paths on the server
            raise InvalidError(str(error).replace(f"{known.folder}/", "")) from error
        record_alone(database, actor.name, Entry("stimulus set checked", subject=name), actor.now)
        return f"/admin/sets/{known.name}"

    task = start_task(database, actor, f"Checking {known.title}", work, subject=f"check of {name}"[:200])
    return accepted(waited_task(database, task, wait_s, "The set is not whole"))


@router.post("/studies/{slug}/results", response_model=TaskView, responses=ACCEPTED, openapi_extra=file_body())
async def upload_results(
    request: Request, actor: StudyEditor, study: AStudy, database: Store, wait_s: Wait = WAIT_S
) -> Response:
    """Attach measures, reports and models: a CSV table of measures, or a zip file of what `validate` wrote.

    They take the place of earlier ones on the same subject; `GET /studies/{slug}/validation` lists the measures.
    """
    task = await begin_attaching(request, settings(request), actor, database, study)
    return await _answer(database, task, wait_s, "Nothing was attached")


@router.get("/studies/{slug}/check", responses=object_answers(FILM_CHECK), dependencies=READING)
def film_check(request: Request, study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Say what the last check of a study's films found; 404 where these films were never checked."""
    with database.reading() as connection:
        films = films_of(connection, study)
    known: FilmCheck | None = last_check(settings(request), study, films)
    if known is None:
        raise NotFoundError("These films were never checked; POST to this address checks them.")
    return json_object(vars(known), chosen)


@router.post("/studies/{slug}/check", response_model=TaskView, responses=ACCEPTED)
def check_films(
    request: Request, actor: StudyEditor, study: AStudy, database: Store, wait_s: Wait = WAIT_S
) -> Response:
    """Decode every film of a study to its end, and play it where a browser is installed; GET says what was found."""
    task = start_film_check(settings(request), database, study, actor)
    return accepted(waited_task(database, task, wait_s, "The films were not checked"))


@router.post("/studies/import", response_model=TaskView, responses=ACCEPTED, openapi_extra=file_body())
async def import_whole_study(
    request: Request,
    actor: StudyEditor,
    database: Store,
    name: Annotated[str, Query(max_length=200, description="of the study here; empty: its own")] = "",
    wait_s: Wait = WAIT_S,
) -> Response:
    """Bring in a whole study from the zip file that `GET /studies/{slug}/export` sends, all of it or nothing.

    It is paused, and nobody's code comes with it: invite anew, and give new codes to who was taking part.
    """
    task = await begin_importing(request, settings(request), actor, database, name)
    return await _answer(database, task, wait_s, "The study was not brought in")


@router.get(
    "/studies/{slug}/export",
    response_class=Response,
    responses={200: {"content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}},
)
def export_whole_study(
    request: Request,
    who: Annotated[Reader, Depends(may_read(PERSONAL))],
    study: AStudy,
    database: Store,
    outside_ids: Annotated[
        bool,
        Query(description="with outside ids, completion codes, addresses that lead back and names on invitations"),
    ] = False,
) -> Response:
    """Send a whole study in one zip file: films, texts, votes, measures and the stimulus set, with all digests.

    Nobody's code is in it. With `outside_ids` it takes the scope studies:write.
    """
    if outside_ids:
        may_read(STUDIES)(request)
    server = settings(request)
    folder: FilePath = server.data_dir / "uploads"
    private_folder(folder)
    content = TemporaryFile(dir=folder)  # noqa: SIM115 (closed when it has been sent)
    try:
        actor = Actor(0, who.name, now(request))
        export_study(server, database, study, content, actor, has_outside=outside_ids)
    except ValueError as error:
        content.close()
        told = str(error).replace(f"{server.data_dir}/", "")
        raise ConflictError(f"The study cannot be sent: {told}.") from error
    headers = {
        "Content-Length": str(content.tell()),
        "Content-Disposition": f'attachment; filename="{study.slug}-whole.zip"',
    }
    return StreamingResponse(parts_of(content), media_type=ZIP, headers=headers)


async def _answer(database: Database, task: str, wait_s: float, refusal: str) -> Response:
    return accepted(await run_in_threadpool(waited_task, database, task, wait_s, refusal))


def _row(connection: Transaction, known: KnownSet) -> dict[str, Any]:
    return {
        "name": known.name,
        "title": known.title,
        "sha256": known.content.sha256,
        "n_films": len(known.content.stimuli),
        "conditions": list(known.conditions),
        "datasets": list(known.datasets),
        "factors": known.content.factors,
        "is_here": known.is_here,
        "studies": [study.slug for study in studies_of(connection, known)],
    }

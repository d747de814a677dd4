"""Send films, results and whole studies over REST, look at stimulus sets, and check films."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path as FilePath
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import Response, StreamingResponse
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from app.errors import ConflictError, InvalidError, NotFoundError
from app.ffmpeg import Progress
from app.files import is_plain_name, private_folder
from app.intake.stimuli import check_videos
from app.intake.summaries import TABLES
from app.operations.foreign_tables import Scale, analysed, understand
from app.operations.studies.check_films import FilmCheck, films_of, last_check, start_film_check
from app.operations.studies.edit import start_mending
from app.operations.studies.stimulus_sets import (
    KnownSet,
    change_stimulus_set,
    delete_set,
    known_sets,
    set_called,
    studies_of,
)
from app.operations.tasks import start_task
from app.operations.upkeep.travel import export_study
from app.store.access.rights import JOBS, PERSONAL, READ, STUDIES
from app.store.database.engine import Database, Transaction
from app.store.studies.audit import Actor, Entry, record_alone
from app.web.analyst import columns
from app.web.analyst.formats import ChosenFormat, CompressedRoute, json_bytes, json_object, parts_of, table
from app.web.analyst.openapi import file_body, object_answers, table_answers
from app.web.analyst.openapi_examples import FILM_CHECK, READ_VOTES, STIMULUS_SET
from app.web.analyst.study_routes import WAIT_S, Body, StudyEditor, TaskView, Wait, accepted, waited_task
from app.web.gates import Store, now, settings
from app.web.problems import problem
from app.web.roles import AStudy, Reader, may_change, may_read
from app.web.uploads import begin_attaching, begin_importing, begin_installing, receive

if TYPE_CHECKING:
    from app.analysis.reading.description import Told

JOIN = "+"  # between columns that are one together
ZIP = "application/zip"
router = APIRouter(prefix="/api/v1", tags=["uploads"], route_class=CompressedRoute)

READING = [Depends(may_read(READ))]
Analysing = Annotated[Actor, Depends(may_change(JOBS))]
Name = Annotated[str, Path(max_length=200)]
ACCEPTED: dict[int | str, dict[str, Any]] = {202: {"model": TaskView, "description": "It goes on; ask for the task"}}


Text = Annotated[str, Query(max_length=2000)]
Word = Annotated[str, Query(max_length=200)]
Words = Annotated[list[Annotated[str, Query(max_length=500)]], Query(max_length=400)]


@dataclass(frozen=True)
class Edits:
    """What is said of a table.

    Parameters
    ----------
    told : edits of its description
    scale : ends of the scale of ratings; None: the usual ones
    text : the same as fields of the page's forms
    """

    told: Told
    scale: Scale
    text: dict[str, str]


def edits_of(
    columns: Text = "",
    choices: Text = "",
    layout: Annotated[str, Query(alias="format", max_length=40)] = "",
    encoding: Word = "",
    sheet: Word = "",
    scale: Word = "",
    column: Words = [],  # noqa: B006 (as the framework has it)
    role: Words = [],  # noqa: B006
    was: Words = [],  # noqa: B006
    a: Word = "",
    b: Word = "",
    none: Word = "",
    by: Annotated[str, Query(max_length=4)] = "",
) -> Edits:
    """Read what a form or a link says of a table.

    Parameters
    ----------
    columns, choices, layout, encoding, sheet, scale : as the options of `reconstudy analyse`
    column, role, was : of each column its new role, and the one that the page showed
    a, b, none : words of the file for these choices
    by : item or side: what a cell names
    """
    from app.analysis.reading.description import Told, pairs_of, written

    if not len(column) == len(role) == len(was):
        raise InvalidError("The columns and their roles do not belong together. Load the page again.")
    try:
        told_columns = pairs_of(columns, "Columns")
        words = {"a": a, "b": b, "none": none, "by": by}
        told_choices = pairs_of(choices, "Choices") | {key: word.strip() for key, word in words.items() if word.strip()}
        ends = _scale(scale)
    except ValueError as error:
        raise InvalidError(f"{error}.") from error
    moved = [(new, old) for new, old in zip(role, was, strict=True) if new != old]
    for each in {new for new, _ in moved if new} | {old for _, old in moved if old in told_columns}:
        names = [name for name, new in zip(column, role, strict=True) if new == each]
        told_columns |= {each: JOIN.join(names)}
    told_columns = {ours: theirs for ours, theirs in told_columns.items() if theirs}
    told = Told(told_columns, told_choices, layout.strip(), encoding.strip(), sheet.strip())
    text = {"columns": written(told_columns), "choices": written(told_choices), "format": told.format}
    return Edits(told, ends, text | {"encoding": told.encoding, "sheet": told.sheet, "scale": scale.strip()})


Said = Annotated[Edits, Depends(edits_of)]


class SetBody(Body):
    sha256: Annotated[str, Field(max_length=64, description="of the set as you read it; changed since: 409")] = ""
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
    untagged_range: Annotated[
        Literal["", "limited", "full"],
        Query(alias="range", description="of films that do not say theirs; empty: refuse those where it matters"),
    ] = "",
    wait_s: Wait = WAIT_S,
) -> Response:
    """Upload a zip file of films, SCENE/CONDITION.mp4, or of a stimulus set; every film is looked at and checked."""
    told: dict[str, Any] = {"is_conformed": conform, "untagged_range": untagged_range}
    task = await begin_installing(request, settings(request), actor, database, name, **told)
    return await _answer(database, task, wait_s, "The films were not taken in")


@router.patch("/sets/{name}", status_code=204, response_class=Response)
def change_set(body: SetBody, request: Request, name: Name, actor: StudyEditor, database: Store) -> Response:
    """Give a set another name, or its conditions other levels; its studies follow."""
    change_stimulus_set(settings(request), database, name, actor, title=body.name, levels=body.levels, seen=body.sha256)
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


@router.post("/studies/{slug}/films", response_model=TaskView, responses=ACCEPTED)
def mend_films(request: Request, actor: StudyEditor, study: AStudy, database: Store, wait_s: Wait = WAIT_S) -> Response:
    """Make the films again whose files are damaged or missing, exactly as they were, and check all."""
    task = start_mending(settings(request), database, study, actor)
    return accepted(waited_task(database, task, wait_s, "The films were not made again"))


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


@router.post("/studies/{slug}/votes", status_code=409, response_class=Response)
def votes_from_elsewhere(actor: StudyEditor, study: AStudy) -> Response:  # noqa: ARG001 (both are the gate)
    """Refuse votes that were collected elsewhere (409): a study counts its own participants' votes only."""
    raise ConflictError(
        "A study takes votes of its own participants only, as it knows what each of them saw, when and by which rules. "
        "To put votes from elsewhere on one scale with them, GET this address, and analyse both files together with "
        "the same names of conditions and datasets: reconstudy analyse votes.csv other.csv. "
        "POST /api/v1/votes analyses a table by itself."
    )


@router.post("/votes", responses=object_answers(READ_VOTES), openapi_extra=file_body())
async def read_votes(
    request: Request,
    actor: Analysing,
    database: Store,
    said: Said,
    name: Annotated[str, Query(max_length=200, description="of the file; its ending tells the format")] = "votes.csv",
    analyse: Annotated[bool, Query(description="also analyse it; else only say how it is read")] = True,
) -> Response:
    """Read a table of votes or ratings from any program, and analyse it; nothing of it is kept.

    Each column's role, what is not used, who and what is in it, and warnings come with it. Where several readings fit,
    the answer is 409 with `readings`: each in words, with the `columns`, `choices` and `format` to send for it.
    """
    server = settings(request)
    if not is_plain_name(name) or not name.lower().endswith(TABLES):
        raise InvalidError(f"The name is {name[:80]!r}, expected a plain one that ends in {', '.join(TABLES)}.")
    parent = server.data_dir / "uploads"
    folder, received = await receive(request, actor, database, parent, server.largest_upload_mb, check_any)

    def read() -> Response:
        with folder:
            path = received.rename(received.with_name(name if name != received.name else f"table-{name}"))
            understood = understand(path, said.told, said.scale)
            if understood.question:
                readings = [{"text": text, **told} for text, told in understood.readings]
                sentence = f"It can be read in several ways: {understood.question}. Say which is meant."
                return problem(409, sentence, extra={"readings": readings})
            if understood.refusal:
                raise InvalidError(f"{understood.refusal.rstrip('.')}.")
            out = FilePath(folder.name) / "analysis"
            analysis = analysed(path, said.told, out, said.scale) if analyse else None
        whole = asdict(understood)
        whole["columns"] = [{"column": column, "role": role} for column, role in understood.columns]
        for key in ("question", "readings", "refusal"):
            whole.pop(key)
        return Response(json_bytes({**whole, "analysis": analysis}), media_type="application/json")

    return await run_in_threadpool(read)


def check_any(_path: FilePath, _largest_mb: int) -> None:
    """Take any file: a table is checked where it is read."""


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


def _scale(text: str) -> Scale:
    """Read the ends of a scale, LOW:HIGH; empty: the usual ones.

    Raises
    ------
    ValueError
    """
    if not text.strip():
        return None
    low, _, high = text.partition(":")
    try:
        ends = float(low), float(high)
    except ValueError:
        ends = (0.0, 0.0)
    if not ends[0] < ends[1] or not all(abs(end) < 1e9 for end in ends):
        raise ValueError(f"Scale is {text!r}, expected its two ends, such as 1:5")
    return ends

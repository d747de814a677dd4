"""Read and change a study's texts over REST; read its design, the power it has, and every figure of its results."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from app.errors import InvalidError, NotFoundError
from app.operations.commands.analysis import Plan
from app.operations.planning import ASSUMPTIONS, plan_on_server
from app.operations.studies.edit import check_edit, keep_study_image, remove_study_image, save_edit
from app.operations.studies.manage import study_file_of
from app.store.access.rights import READ
from app.store.studies.film_failures import settle_failures
from app.store.studies.images import image_content, image_digests
from app.store.trials.designs import conditions_of, datasets_of, shown_pairs
from app.store.trials.orders import most_trials
from app.study.options.duration import stage_minutes
from app.study.options.options import parse_options
from app.study.options.own_texts import CONSENT, DEBRIEFING
from app.study.options.wording import first_language, own_texts, refused_languages
from app.study.protocols import ACR, PC
from app.study.trial.image import LARGEST_IMAGE, media_type
from app.web.analyst import columns
from app.web.analyst.formats import ChosenFormat, CompressedRoute, json_object, table
from app.web.analyst.openapi import file_body, object_answers, table_answers
from app.web.analyst.openapi_examples import DESIGN, PLAN, TEXTS
from app.web.analyst.results import FIGURE_TYPES, balance_soon, figure, figures_of, results_of
from app.web.analyst.study_routes import Body, StudyEditor
from app.web.gates import Now, Store, from_query, languages, settings
from app.web.roles import AStudy, may_read

PLAIN = {CONSENT: "consent", DEBRIEFING: "debriefing"}  # options that hold the texts of the study's first language
LONGEST_CHECK_S = 60
IMAGES = ("image/png", "image/jpeg", "image/gif", "image/webp")

router = APIRouter(prefix="/api/v1", tags=["material"], route_class=CompressedRoute)

READING = [Depends(may_read(READ))]
Image = Annotated[str, Path(max_length=80)]
Language = Annotated[str, Path(max_length=40)]
Assumed = Annotated[dict[str, Any], Depends(from_query(Plan, ASSUMPTIONS))]
Size = Annotated[dict[str, Any], Depends(from_query(Plan, ("conditions", "datasets")))]
FIGURE_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind.split(";")[0]: {"schema": {"type": "string"}} for kind in FIGURE_TYPES.values()}}
}


class TextsBody(Body):
    revision: Annotated[int, Field(ge=1, le=2**31 - 1, description="of the study as you read it")]
    texts: dict[str, Any]


@router.get("/studies/{slug}/texts", responses=object_answers(TEXTS), dependencies=READING)
def texts(request: Request, study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """Send a study's own texts by language, which languages it is offered in, and the digests of its images."""
    options, packs = parse_options(study.options), languages(request)
    with database.reading() as connection:
        images = image_digests(connection, study.id)
    offered = {tag: refusal or "offered" for tag, refusal in refused_languages(options, packs).items()}
    said = {tag: own_texts(options, tag) for tag in dict.fromkeys([first_language(options), *options.texts])}
    whole = {"revision": study.revision, "first_language": first_language(options), "languages": offered}
    return json_object({**whole, "texts": said, "images": images}, chosen)


@router.put("/studies/{slug}/texts/{language}", status_code=204, response_class=Response)
def change_texts(
    body: TextsBody, language: Language, request: Request, actor: StudyEditor, study: AStudy, database: Store
) -> Response:
    """Give a study its own texts in a language, in place of all it had; what is left out goes back to the pack's.

    If somebody has changed the study since you read it, so that its revision is another one, nothing is changed (409).
    """
    if language not in languages(request):
        raise NotFoundError("There is no such language.")
    before, given = study_file_of(study), dict(body.texts)
    changes: dict[str, Any] = {}
    if language == first_language(before.options):
        changes = {option: given.pop(name, "") for name, option in PLAIN.items()}
    changes["texts"] = {**before.options.texts, language: given}
    try:
        wanted = before.but(options=parse_options({**before.options.as_json(), **changes}))
    except (ValueError, TypeError) as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    change = check_edit(settings(request), database, study, wanted, languages(request))
    save_edit(database, change, body.revision, actor)
    return Response(status_code=204)


@router.get(
    "/studies/{slug}/images/{name}",
    dependencies=READING,
    response_class=Response,
    responses={200: {"content": {key: {"schema": {"type": "string", "format": "binary"}} for key in IMAGES}}},
)
def image(name: Image, study: AStudy, database: Store) -> Response:
    """Send an image that a study's texts show."""
    with database.reading() as connection:
        sha256 = image_digests(connection, study.id).get(name)
        content = image_content(connection, sha256) if sha256 else None
    if content is None:
        raise NotFoundError("This study has no such image.")
    return Response(content, media_type=media_type(content))


@router.put("/studies/{slug}/images/{name}", status_code=204, response_class=Response, openapi_extra=file_body())
async def keep_image(name: Image, request: Request, actor: StudyEditor, study: AStudy, database: Store) -> Response:
    """Keep an image for texts to show, in place of one of the same name; not after somebody has begun (409)."""
    content = await request.body()
    await run_in_threadpool(keep_study_image, database, study, name, content[: LARGEST_IMAGE + 1], actor)
    return Response(status_code=204)


@router.delete("/studies/{slug}/images/{name}", status_code=204, response_class=Response)
def remove_image(name: Image, actor: StudyEditor, study: AStudy, database: Store) -> Response:
    """Remove an image of a study's texts; not after somebody has begun (409)."""
    remove_study_image(database, study, name, actor)
    return Response(status_code=204)


@router.delete("/studies/{slug}/failures", status_code=204, response_class=Response)
def note_failures(actor: StudyEditor, study: AStudy, database: Store) -> Response:
    """Take note of all films that failed: they are no alarm any more, and stay in the table."""
    with database.writing() as connection:
        n = settle_failures(connection, study.id, actor.now)
        actor.note(connection, "failing films noted", study, study.slug, failures=n)
    return Response(status_code=204)


@router.get("/studies/{slug}/design", responses=object_answers(DESIGN), dependencies=READING)
def design(study: AStudy, database: Store, chosen: ChosenFormat, now: Now) -> Response:
    """Describe a study's design: its pairs, trials and minutes a person, and how balanced its orders are so far.

    `balance` is null while the orders of very many participants are still being checked; ask again.
    """
    with database.reading() as connection:
        n_trials, pairs = most_trials(connection, study), shown_pairs(connection, study.id)
        conditions = conditions_of(connection, study.id)
    balance, _ = balance_soon(database, study, now, LONGEST_CHECK_S)
    whole = {
        "conditions": conditions,
        "factors": study.factors,
        "pairs": [vars(pair) for pair in pairs.values()],
        "n_trials": n_trials,
        "minutes": stage_minutes(parse_options(study.options), n_trials, study.exposure_s),
        "balance": balance,
    }
    return json_object(whole, chosen)


@router.get("/studies/{slug}/plan", responses=object_answers(PLAN), dependencies=READING)
def plan_of_study(study: AStudy, database: Store, chosen: ChosenFormat, assumed: Assumed) -> Response:
    """Say what so many participants of a study can show: the power of each claim, by simulation."""
    with database.reading() as connection:
        n_conditions, n_datasets = len(conditions_of(connection, study.id)), len(datasets_of(connection, study.id))
    size = {"conditions": n_conditions, "datasets": n_datasets}
    return json_object(plan_on_server(parse_options(study.options).protocol, size | assumed), chosen)


@router.get("/plan", responses=object_answers(PLAN), dependencies=READING)
def plan(
    chosen: ChosenFormat,
    size: Size,
    assumed: Assumed,
    is_rated: Annotated[bool, Query(description="ratings of single films rather than choices between two")] = False,
) -> Response:
    """Say what a study of so many conditions, datasets and participants can show, before there is any."""
    return json_object(plan_on_server(ACR if is_rated else PC, size | assumed), chosen)


@router.get("/studies/{slug}/figures", responses=table_answers(columns.FIGURES), dependencies=READING)
def figures(study: AStudy, database: Store, chosen: ChosenFormat) -> Response:
    """List the figures of the votes so far."""
    rows = [{"figure": name, "caption": caption} for name, caption in figures_of(results_of(database, study.id))]
    return table(rows, columns.FIGURES, chosen, f"{study.slug}-figures")


@router.get(
    "/studies/{slug}/figures/{name}.{kind}", dependencies=READING, response_class=Response, responses=FIGURE_ANSWERS
)
def figure_file(
    study: AStudy,
    database: Store,
    name: Annotated[str, Path(max_length=200)],
    kind: Annotated[str, Path(max_length=10, description="svg, png, pdf, or csv: the numbers in it")],
) -> Response:
    """Send a figure of the votes so far."""
    content = figure(results_of(database, study.id), name, kind) if kind in FIGURE_TYPES else None
    if content is None:
        raise NotFoundError("There is no such figure of these votes yet; figures are listed beside this address.")
    return Response(content, media_type=FIGURE_TYPES[kind])

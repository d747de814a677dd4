"""List studies, create them, and open, pause, close, archive, duplicate or preview one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, Form, Query, Request
from fastapi.responses import JSONResponse, Response

from app.errors import InvalidError
from app.intake.bounds import typed_in_bounds
from app.operations.studies.create import duplicate_study, new_slug, read_options
from app.operations.studies.creation import begin_creation
from app.operations.studies.standing import change_standing as change_study
from app.operations.studies.stimulus_sets import KnownSet, known_sets, set_called
from app.store.access.experimenters import Experimenter
from app.store.participants.invitations import preview_code
from app.store.studies.studies import Standing, all_studies, progress_by_study
from app.store.trials.admission import begin_preview
from app.study.options.option_table import COLUMNS
from app.study.options.options import parse_options
from app.study.options.platforms import PLATFORMS
from app.study.options.presets import PRESETS, QUICK, read_preset
from app.study.options.study_file import LONGEST_FILE, StudyFile, parse_study_file, with_line
from app.study.options.wording import check_languages
from app.study.stages import PRACTICE
from app.web.admin.layout import page, see, unix
from app.web.admin.studies.form import Fields, StudyForm, options_of, read_values, values_of
from app.web.analyst.results import load_analysis
from app.web.gates import Store, languages, settings
from app.web.participant.beginning import remember
from app.web.roles import Acting, AStudy, Looking, Person, is_seen
from app.web.uploads import UploadingActor, begin_importing

router = APIRouter(prefix="/admin", include_in_schema=False)


@router.get("")
def studies_page(request: Request, person: Person, database: Store, afterwards: BackgroundTasks) -> Response:
    afterwards.add_task(load_analysis)  # a study's pages come next
    with database.reading() as connection:
        listed = [study for study in all_studies(connection) if is_seen(request, study)]
        progress = progress_by_study(connection)  # read second: it then covers every study listed
    return page(
        request,
        "studies",
        person,
        {"studies": listed, "progress_by_study": progress, "largest_mb": settings(request).largest_upload_mb},
    )


@router.put("/studies/import")
async def import_whole(
    request: Request, actor: UploadingActor, database: Store, name: Annotated[str, Query(max_length=200)] = ""
) -> Response:
    """Bring in a whole study from another server, in the background."""
    task = await begin_importing(request, settings(request), actor, database, name)
    return JSONResponse({"job": f"/admin/jobs/{task}"}, 202)


@router.get("/studies/new")
def new_study_page(
    request: Request,
    person: Looking,
    database: Store,
    stimulus_set: Annotated[str, Query(max_length=200)] = "",
    chosen_set: Annotated[str, Query(alias="set", max_length=200)] = "",
    preset: Annotated[str, Query(max_length=20)] = "",
    platform: Annotated[str, Query(max_length=20)] = "",
) -> Response:
    """Ask for stimulus set and preset; with both, show the form, filled with what the preset says.

    Parameters
    ----------
    stimulus_set, preset, platform : as chosen
    chosen_set : the set to offer first, where the preset is still to be chosen
    """
    with database.reading() as connection:
        known = known_sets(settings(request), connection)
    chosen = next((each for each in known if each.name == stimulus_set), None)
    presets = [read_preset(name) for name in PRESETS]
    if chosen is None or (preset or QUICK) not in PRESETS:
        context = {
            "chosen_set": chosen_set,
            "sets": known,
            "presets": presets,
            "default_preset": QUICK,
            "longest_file": LONGEST_FILE,
            "platforms": PLATFORMS,
        }
        return page(request, "new_study", person, context)
    filled = PLATFORMS[platform].outside if platform in PLATFORMS else {}
    begun = {f"outside.{name}": value for name, value in filled.items()}
    return _settings_page(request, person, chosen, preset or QUICK, begun)


@router.post("/studies/new")
def create(
    request: Request,
    person: Looking,
    actor: Acting,
    database: Store,
    fields: Fields,
    stimulus_set: Annotated[str, Form(max_length=200)],
    preset: Annotated[str, Form(max_length=20)] = QUICK,
) -> Response:
    """Create a study in the background; the task's page shows the progress. What is not right is shown again."""
    given = read_values(fields)
    with database.reading() as connection:
        known = set_called(settings(request), connection, stimulus_set)
    try:
        wanted = _chosen(preset, given)
        new_slug(database, wanted.name)
        check_languages(wanted.options, languages(request))
    except ValueError as error:
        return _settings_page(request, person, known, preset if preset in PRESETS else QUICK, given, str(error))
    task = begin_creation(settings(request), database, known.folder, wanted, actor)
    return see(f"/admin/jobs/{task}")


@router.post("/studies/new/file")
def create_from_file(
    request: Request,
    actor: Acting,
    database: Store,
    text: Annotated[str, Form(max_length=LONGEST_FILE)],
    stimulus_set: Annotated[str, Form(max_length=200)],
) -> Response:
    """Create a study from a study file, in the background."""
    with database.reading() as connection:
        known = set_called(settings(request), connection, stimulus_set)
    try:
        wanted = typed_in_bounds(parse_study_file, unix(text))
        new_slug(database, wanted.name)
        check_languages(wanted.options, languages(request))
        if wanted.manifest_sha256 not in (None, known.content.sha256):
            raise ValueError(
                f"manifest_sha256 is that of another stimulus set than {known.title}, whose is {known.content.sha256}; "
                "choose the set that the file was written for, or delete this line"
            )
    except ValueError as error:
        raise InvalidError(f"No study was created: {with_line(unix(text), str(error))}.") from error
    task = begin_creation(settings(request), database, known.folder, wanted, actor)
    return see(f"/admin/jobs/{task}")


def _settings_page(
    request: Request,
    person: Experimenter,
    known: KnownSet,
    preset: str,
    given: Mapping[str, Any] | None = None,
    error: str = "",
) -> Response:
    """Show the form, filled with what the preset says, or with what was sent and why it was refused."""
    values = values_of(StudyFile(name="", options=read_options(None, {}, preset))) | dict(given or {})
    form = StudyForm(values, datasets=known.datasets, conditions=known.conditions, error=error)
    context = {"form": form, "stimulus_set": known, "preset": preset}
    return page(request, "new_study_settings", person, context, 422 if error else 200)


def _chosen(preset: str, given: Mapping[str, Any]) -> StudyFile:
    """Return a preset's study with what the form changes.

    Raises
    ------
    ValueError
        If there is no such preset, or a value is not right.
    """
    chosen = read_preset(preset)
    base = parse_options(chosen.options)
    now = values_of(StudyFile(name="", options=base))
    changed = {name: value for name, value in given.items() if value != now.get(name)}
    if changed.get("consent") and "consent_version" not in changed:
        changed["consent_version"] = ""  # the version names the preset's text
    wanted = options_of(base, changed)
    tops = {name.partition(".")[0] for name in changed} - set(COLUMNS)
    if "scale" not in wanted:
        tops.discard("scale")
    options = parse_options(chosen.overridden_by({name: wanted[name] for name in tops}))
    if options.practice_dataset:
        options = options.with_stage(PRACTICE)
    columns = {name: given[name] for name in COLUMNS if given.get(name) is not None}
    return StudyFile.read({"name": "", **columns, "options": options})


@router.post("/studies/{slug}/state")
def change_standing(actor: Acting, study: AStudy, state: Annotated[Standing, Form()], database: Store) -> Response:
    change_study(database, study, state, actor)
    return see(f"/admin/studies/{study.slug}")


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
def preview(request: Request, actor: Acting, study: AStudy, database: Store) -> Response:
    """Walk through a study as a participant; nothing is counted or kept."""
    token = begin_preview(database, study, actor.now)
    with database.writing() as connection:
        actor.note(connection, "study previewed", study, study.slug)
        code = preview_code(connection, study.id)
    answer = see(f"/s/{code}")
    remember(request, answer, token)
    return answer

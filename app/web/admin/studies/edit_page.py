"""Edit a study's settings, as a form or as a file; two people who edit at once are warned of each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import Response

from app.errors import ConflictError, InvalidError, said_on_page
from app.ffmpeg import Progress
from app.intake.bounds import typed_in_bounds
from app.operations.studies.create import slugify, telling_names
from app.operations.studies.drafts import values_of
from app.operations.studies.edit import check_edit, remake_films, save_edit
from app.operations.studies.manage import study_file_of
from app.operations.studies.stimulus_sets import set_of_study
from app.operations.tasks import start_task
from app.store.access.experimenters import Experimenter
from app.store.database.engine import Database
from app.store.studies.audit import Actor
from app.store.studies.studies import Study, progress_of, study_by_id
from app.store.trials.designs import conditions_of, datasets_of
from app.study.options.option_table import SETTINGS_BY_NAME
from app.study.options.study_file import LONGEST_FILE, StudyFile, parse_study_file, with_line, write_study_file
from app.web.admin.background import task_address
from app.web.admin.layout import attachment, see, study_page, unix
from app.web.admin.studies.form import (
    WAS,
    Fields,
    StudyForm,
    changed_since,
    digests_of,
    fixed_settings,
    merged,
    read_values,
    refuse,
    study_of,
)
from app.web.gates import Store, database, languages, settings
from app.web.roles import Acting, AStudy, Looking, looking

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)

LABELS = {name: setting.label for name, setting in SETTINGS_BY_NAME.items()}

Revision = Annotated[int, Form(ge=1, le=2**31 - 1)]


@router.get("/edit")
def edit_page(request: Request, person: Looking, study: AStudy, database: Store) -> Response:
    form = _form(request, database, study, values_of(study_file_of(study)))
    return _page(request, person, study, form)


@router.post("/edit")
def edit(
    request: Request,
    person: Looking,
    actor: Acting,
    study: AStudy,
    database: Store,
    revision: Revision,
    fields: Fields,
) -> Response:
    """Save the fields of the form; everything else stays. What cannot be saved is shown again with the reason."""
    given = read_values(fields)
    try:
        wanted = study_of(study_file_of(study), given)
        return save_study(request, study, wanted, revision, actor)
    except (ValueError, InvalidError) as error:
        values = {**values_of(study_file_of(study)), **given}
        form = _form(request, database, study, values)
        cause = error if isinstance(error, ValueError) else error.__cause__
        refuse(request, cause if isinstance(cause, ValueError) else ValueError(error))
        return _page(request, person, study, form, status_code=422)
    except ConflictError:
        if answer := _given_back(request, person, study, revision, str(fields.get(WAS, "")), given):
            return answer
        raise


@router.get("/edit/file", dependencies=[Depends(looking("experimenter"))])
def study_file(study: AStudy) -> Response:
    """Download all settings as a study file."""
    headers = {"Content-Disposition": attachment(f"{study.slug}.toml")}
    return Response(write_study_file(study_file_of(study)), media_type="application/toml", headers=headers)


@router.post("/edit/file")
def edit_file(
    request: Request,
    person: Looking,
    actor: Acting,
    study: AStudy,
    revision: Revision,
    text: Annotated[str, Form(max_length=LONGEST_FILE)],
    was: Annotated[str, Form(max_length=LONGEST_FILE)] = "",
) -> Response:
    try:
        wanted = typed_in_bounds(parse_study_file, unix(text))
    except ValueError as error:
        raise InvalidError(f"Nothing was changed: {with_line(unix(text), error, said_on_page(error))}.") from error
    try:
        return save_study(request, study, wanted, revision, actor)
    except ConflictError:
        left_out = [name for name in ("exposure_s", "seed") if getattr(wanted, name) is None]
        given = {name: value for name, value in values_of(wanted).items() if name not in left_out}
        if answer := _given_back(request, person, study, revision, was, given, unix(text)):
            return answer
        raise


def _given_back(
    request: Request,
    person: Experimenter,
    study: Study,
    revision: int,
    was: str,
    given: Mapping[str, Any],
    text: str = "",
) -> Response | None:
    """Show what was typed beside what somebody else has saved meanwhile; None: nobody has."""
    store = database(request)
    with store.reading() as connection:
        now_study = study_by_id(connection, study.id)
    if now_study is None or now_study.revision == revision:
        return None
    mine = merged(was, given, values_of(study_file_of(now_study)), LABELS)
    form = replace(_form(request, store, now_study, mine.values), clashes=mine.clashes, others=mine.others)
    return _page(request, person, now_study, form, status_code=409, text=text)


def save_study(
    request: Request,
    study: Study,
    wanted: StudyFile,
    revision: int,
    actor: Actor,
    page: str = "edit",
) -> Response:
    """Save what has changed, and lead back to a page of the study, or to the work of making its films again.

    Raises
    ------
    InvalidError
        If a value is not right, or the study would be complete in no language.
    ConflictError
        If somebody else has changed the study meanwhile, or a setting cannot change any more.
    """
    server, store = settings(request), database(request)
    address = f"/admin/studies/{study.slug}/{page}{'&' if '?' in page else '?'}saved=1"
    try:
        change = check_edit(server, store, study, wanted, languages(request))
        if change.folder is None:
            save_edit(store, change, revision, actor)
            return see(address)
        if revision != study.revision:
            raise ConflictError("Somebody else has changed this study meanwhile. Look at it again, then repeat it.")
    except ConflictError as error:
        with store.writing() as connection:
            actor.note(connection, "edit refused", study, study.slug, reason=error.detail)
        raise

    def work(progress: Progress) -> str:
        try:
            remake_films(server, store, change, revision, actor, progress)
        except ConflictError as error:
            raise ConflictError(f"{error.detail}{_typed_told(store, study, wanted)}") from error
        return address

    task = start_task(store, actor, f"Making the films of {study.name} again", work, subject=f"study {study.slug}")
    return see(task_address(task))


def _typed_told(store: Database, study: Study, wanted: StudyFile) -> str:
    """Return what was to be changed, each beside what is saved now, for the page of a work that came too late."""
    with store.reading() as connection:
        now_study = study_by_id(connection, study.id) or study
    before, now = (values_of(study_file_of(each)) for each in (study, now_study))
    mine = changed_since(digests_of(before), values_of(wanted))
    typed = "; ".join(f"{label}: {typed} ({saved})" for label, typed, saved in merged("", mine, now, LABELS).clashes)
    return f" You typed (and saved is now): {typed}." if typed else ""


def _form(request: Request, database: Database, study: Study, values: Mapping[str, Any]) -> StudyForm:
    """Return the form of a study, with what its stimulus set offers to choose from."""
    with database.reading() as connection:
        has_begun = progress_of(connection, study.id).n_started > 0
        known = set_of_study(settings(request), connection, study)
        datasets = known.datasets if known else tuple(datasets_of(connection, study.id))
        conditions = known.conditions if known else tuple(conditions_of(connection, study.id))
    fixed = fixed_settings(has_begun=has_begun, has_stimuli=known is not None)
    return StudyForm(values, fixed, datasets, conditions, was=digests_of(values_of(study_file_of(study))))


def _page(
    request: Request, person: Experimenter, study: Study, form: StudyForm, status_code: int = 200, text: str = ""
) -> Response:
    wanted = slugify(study.name)
    address = "" if study.slug == wanted else f"/admin/studies/{wanted}"
    context = {
        "form": form,
        "new_address": address,
        "telling": telling_names(study.name, [each for each in form.conditions if each not in form.values["without"]]),
        "text": text or write_study_file(study_file_of(study)),
        "is_typed": bool(text),
        "longest_file": LONGEST_FILE,
    }
    return study_page(request, "edit", person, study, context, status_code)

"""Make a study on one page: take films, show what was understood and what the study will be, keep the form, create."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import Response
from starlette.datastructures import FormData

from app.errors import InvalidError, StudyError, said_on_page
from app.intake.bounds import typed_in_bounds
from app.intake.treatment import MANY_BEYOND
from app.operations.studies.create import new_slug, read_options, shows_anything, telling_names
from app.operations.studies.creation import begin_creation
from app.operations.studies.drafts import Draft, outlook_of, values_of
from app.operations.studies.forecast import PAIR_FILMS, SINGLE_FILMS, forecast, has_many_pairs
from app.operations.studies.receive_films import found_and_done
from app.operations.studies.stimulus_sets import KnownSet, known_sets, set_called, unreadable_sets
from app.store.access.experimenters import Experimenter
from app.store.studies.drafts import draft_of, drafts_of, drop_draft, keep_draft
from app.study.kinds import PRESETS, QUICK
from app.study.option_fields import SettingError
from app.study.options.neutral_words import neutral_words
from app.study.options.options import StudyOptions
from app.study.options.platforms import PLATFORMS, WAYS
from app.study.options.study_file import LONGEST_FILE, StudyFile, parse_study_file, with_line
from app.study.options.wording import beyond_the_study, check_languages, first_language, wording
from app.web.admin.background import task_address
from app.web.admin.layout import page, see, unix
from app.web.admin.studies.form import (
    ANSWERS,
    WAS,
    WAY,
    Fields,
    StudyForm,
    changed_since,
    digests_of,
    in_words,
    read_values,
    refuse,
)
from app.web.gates import Store, languages, settings
from app.web.markdown import render_markdown
from app.web.roles import Acting, Looking

CONSENT = "consent"
READ_FIRST = ("welcome", CONSENT, "instructions.see", "instructions.switch", "instructions.vote")

router = APIRouter(prefix="/admin/studies/new", include_in_schema=False)

SetName = Annotated[str, Form(max_length=200)]
Preset = Annotated[str, Form(max_length=20)]


@router.get("")
def new_study_page(
    request: Request,
    person: Looking,
    database: Store,
    stimulus_set: Annotated[str, Query(max_length=200)] = "",
    chosen_set: Annotated[str, Query(alias="set", max_length=200)] = "",
    preset: Annotated[str, Query(max_length=20)] = "",
    platform: Annotated[str, Query(max_length=20)] = "",
) -> Response:
    """Ask for films; with a stimulus set, show its form as it was last typed, or as preset and platform fill it in.

    Parameters
    ----------
    stimulus_set, chosen_set : the set
    preset, platform : instead of the ways that the page offers
    """
    with database.reading() as connection:
        known = known_sets(settings(request), connection)
        drafts = drafts_of(connection, person.name)
        chosen = next((each for each in known if each.name == (stimulus_set or chosen_set)), None)
        unreadable = {} if chosen else unreadable_sets(settings(request), connection, known)
    if chosen is None:
        names = {each.name: each.title for each in known}
        context = {
            "sets": known,
            "unreadable": unreadable,
            "drafts": [draft for draft in drafts if draft.stimulus_set in names],
            "titles": names,
            "longest_file": LONGEST_FILE,
            "largest_mb": settings(request).largest_upload_mb,
        }
        return page(request, "new_study", person, context)
    kept = next((draft.content for draft in drafts if draft.stimulus_set == chosen.name), {})
    draft = Draft.kept(kept)
    if preset in PRESETS or (platform in PLATFORMS and platform):
        draft = Draft(preset if preset in PRESETS else QUICK, platform if platform in PLATFORMS else "")
    return _form_page(request, person, chosen, draft)


@router.post("")
def create(
    request: Request,
    person: Looking,
    actor: Acting,
    database: Store,
    fields: Fields,
    stimulus_set: SetName,
    preset: Preset = QUICK,
    platform: Preset = "",
) -> Response:
    """Create a study in the background; the task's page shows the progress. What is not right is shown again."""
    with database.reading() as connection:
        known = set_called(settings(request), connection, stimulus_set)
    draft = _sent(fields, preset, platform)
    try:
        wanted = draft.study(has_many_pairs=has_many_pairs(known.content))
        new_slug(database, wanted.name)
        check_languages(wanted.options, languages(request))
        forecast(settings(request), known.content, wanted.options, wanted.exposure_s)  # which refuses what cannot be
    except ValueError as error:
        shown = draft if preset in PRESETS else replace(draft, preset=QUICK)
        refuse(request, error)
        return _form_page(request, person, known, shown, 422)
    with database.writing() as connection:
        keep_draft(connection, actor.name, known.name, draft.as_json(), actor.now)  # until the study is there
    task = begin_creation(settings(request), database, known.folder, wanted, actor, drawn_from=known.name)
    return see(task_address(task))


@router.post("/draft")
def keep(
    request: Request,
    person: Looking,
    actor: Acting,
    database: Store,
    fields: Fields,
    stimulus_set: SetName,
    preset: Preset = QUICK,
    platform: Preset = "",
) -> Response:
    """Keep the form as it is typed, and answer with what the study would be now."""
    with database.reading() as connection:
        known = set_called(settings(request), connection, stimulus_set)
    draft = _sent(fields, preset, platform)
    with database.writing() as connection:
        keep_draft(connection, actor.name, known.name, draft.as_json(), actor.now)
    return page(request, "_new_study_plan", person, _plan(request, known, draft))


@router.post("/drop")
def drop(actor: Acting, database: Store, stimulus_set: SetName) -> Response:
    """Drop a form that nobody wants any more."""
    with database.writing() as connection:
        if draft_of(connection, actor.name, stimulus_set):
            drop_draft(connection, actor.name, stimulus_set)
    return see("/admin/studies/new")


@router.post("/file")
def create_from_file(
    request: Request,
    actor: Acting,
    database: Store,
    text: Annotated[str, Form(max_length=LONGEST_FILE)],
    stimulus_set: SetName,
) -> Response:
    """Create a study from a study file, in the background."""
    with database.reading() as connection:
        known = set_called(settings(request), connection, stimulus_set)
    try:
        wanted = typed_in_bounds(parse_study_file, unix(text))
        new_slug(database, wanted.name)
        check_languages(wanted.options, languages(request))
        if wanted.manifest_sha256 not in (None, known.content.sha256):
            raise SettingError(
                "manifest_sha256",
                f"is that of another stimulus set than {known.title}, whose is {known.content.sha256}; choose the set "
                "that the file was written for, or delete this line",
            )
    except ValueError as error:
        raise InvalidError(f"No study was created: {with_line(unix(text), error, said_on_page(error))}.") from error
    task = begin_creation(settings(request), database, known.folder, wanted, actor)
    return see(task_address(task))


def _sent(fields: FormData, preset: str, platform: str) -> Draft:
    """Read a draft from the form.

    Raises
    ------
    InvalidError
        If the form has a field that is no setting, or a number is none.
    """
    given = read_values(fields)
    was = str(fields.get(WAS, ""))
    if not was:  # a form of nobody's page, such as a program's
        plain = values_of(StudyFile(name="", options=read_options(None, {}, preset))) if preset in PRESETS else {}
        given = {name: value for name, value in given.items() if value != plain.get(name)}
    way = WAYS.get(str(fields.get(WAY, "")))
    answers = {name.removeprefix(ANSWERS): str(fields[name])[:200] for name in fields if name.startswith(ANSWERS)}
    draft = Draft(preset, platform, answers, changed_since(was, given))
    return replace(draft, preset=way.preset, platform=way.platform) if way else draft


def _form_page(
    request: Request, person: Experimenter, known: KnownSet, draft: Draft, status_code: int = 200
) -> Response:
    """Show the form, filled with what its way says and what was typed."""
    base = draft.base(is_neutral=shows_anything(known.content), has_many_pairs=has_many_pairs(known.content))
    form = StudyForm(
        base | dict(draft.typed),
        datasets=known.datasets,
        conditions=known.conditions,
        was=digests_of(base),
    )
    looks = found_and_done(known.content)
    context = {
        "form": form,
        "stimulus_set": known,
        "draft": draft,
        "ways": WAYS,
        "platforms": PLATFORMS,
        "done": {name: look["done"] for name, look in looks.items() if look["done"]},
        "n_guessed": sum(
            "unknown" in (look["found"].get("matrix"), look["found"].get("range")) for look in looks.values()
        ),
        "beyond_range": [
            name
            for name, look in looks.items()
            if look["found"].get("beyond_limited", 0) > MANY_BEYOND and look["found"]["read_as"]["range"] == "tv"
        ],
        "n_sound": sum(bool(look["found"].get("sound")) for look in looks.values()),
        "address": f"/admin/studies/new?stimulus_set={quote(known.name)}",
        **_plan(request, known, draft),
    }
    return page(request, "new_study_settings", person, context, status_code)


def _plan(request: Request, known: KnownSet, draft: Draft) -> dict[str, Any]:
    """Return what the study would be, and the first that its participants read; and why it cannot be made yet.

    What it costs does not depend on the platform, so it is said before the platform's codes are known.
    """
    lack = draft.lack()
    try:
        wanted, outlook = outlook_of(
            settings(request), known.content, replace(draft, platform="") if lack else draft, languages(request)
        )
    except (ValueError, StudyError) as error:
        hindrance = lack or (in_words(error) if isinstance(error, ValueError) else error.detail)
        return {"outlook": None, "hindrance": hindrance, "by_films": {}, "pages": []}
    by_films = {}
    if outlook.n_pairs > len(known.content.stimuli):
        by_films = {
            films["pair_films"]: forecast(
                settings(request), known.content, wanted.options.but(**films), wanted.exposure_s
            )
            for films in (PAIR_FILMS, SINGLE_FILMS)
        }
    options = neutral_words(wanted.options) if shows_anything(known.content) else wanted.options
    return {
        "outlook": outlook,
        "hindrance": lack,
        "telling": telling_names(
            wanted.name, [each for each in known.conditions if each not in wanted.options.without]
        ),
        "beyond": beyond_the_study(wanted.options),
        "by_films": by_films,
        "chosen_films": wanted.options.pair_films,
        "pages": list(_read_first(request, options, outlook.n_trials)),
    }


def _read_first(request: Request, options: StudyOptions, n_trials: int) -> Iterator[tuple[str, Any]]:
    """Yield heading and text of the pages that participants read before the trials, in the first language."""
    texts: Any = wording(languages(request)[first_language(options)], options, "").texts
    for key in READ_FIRST:
        if key == CONSENT and options.consent:
            yield texts[CONSENT]["heading"], render_markdown(texts["study"][CONSENT])
        group = texts
        for part in key.split("."):
            group = group.get(part, {})
        body = group.get("body", "")
        body = body.get("one" if n_trials == 1 else "other", "") if isinstance(body, dict) else body
        if body:
            yield group.get("heading", ""), body.replace("{total}", str(n_trials))

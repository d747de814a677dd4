"""Edit a study's settings, as a form or as a file; two people who edit at once are warned of each other."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import Response

from app.errors import ConflictError, InvalidError
from app.operations.create import EXPOSURE_BOUNDS_S
from app.operations.manage import study_file_of
from app.store.audit import Actor
from app.store.designs import practice_pairs
from app.store.engine import Database, Transaction
from app.store.studies import Study, edit_study, lock_study, progress_of
from app.study.colour_vision import AXES
from app.study.lab_sheet import BOUNDS, LABELS
from app.study.lab_sheet import LONGEST_NOTE as LONGEST_LAB_NOTE
from app.study.language_pack import LanguagePack
from app.study.options import StudyOptions, check_minimum_viewing, parse_options
from app.study.recruiting import LONGEST_ADDRESS, MOST_PEOPLE, RESUMES
from app.study.screening import TESTS
from app.study.stages import OPTIONAL_STAGES, PRACTICE
from app.study.study_file import LONGEST_FILE, StudyFile, parse_study_file, write_study_file
from app.study.wording import LONGEST_TEXT, check_languages
from app.web.admin.layout import see, study_page, unix
from app.web.gates import Acting, AStudy, Looking, Store, languages

FREE = ("name", "debriefing", "abandoned_after_h", "outside", "limits", "lab_sheet")  # may change after somebody began
LONGEST_NAME = 200
LONGEST_NOTE = 200  # characters of a value in the audit log

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)

Revision = Annotated[int, Form(ge=1, le=2**31 - 1)]
Text = Annotated[str, Form(max_length=LONGEST_TEXT)]
Number = Annotated[float | None, Form(ge=-10, le=10_000, allow_inf_nan=False)]
Word = Annotated[str, Form(max_length=20)]
ShortText = Annotated[str, Form(max_length=50)]
Address = Annotated[str, Form(max_length=LONGEST_ADDRESS)]
Whole = Annotated[int, Form(ge=0, le=MOST_PEOPLE)]
Note = Annotated[str, Form(max_length=LONGEST_LAB_NOTE)]
Words = Annotated[list[Word], Form(max_length=10)]


def screening_given(
    screening: Annotated[bool, Form()] = False,
    test: Words = [],  # noqa: B006 (FastAPI copies it)
    acuity_limit: Number = None,
    distance: Word = "",
    distance_cm: Number = None,
    colour_axis: Words = [],  # noqa: B006
    colour_misses: Number = None,
    on_failure: Word = "",
) -> dict[str, Any]:
    """Return the option `screening` of the form; nothing where the form lacks it. `parse_options` checks it."""
    given = {
        "tests": test,
        "acuity_limit": acuity_limit,
        "distance": distance,
        "distance_cm": distance_cm if distance == "fixed" else None,
        "colour_axes": colour_axis,
        "colour_misses": colour_misses,
        "on_failure": on_failure,
    }
    return {"screening": {key: value for key, value in given.items() if value is not None}} if screening else {}


def recruiting_given(
    recruiting: Annotated[bool, Form()] = False,
    outside_id: ShortText = "",
    keep: Annotated[str, Form(max_length=500)] = "",
    resume: Word = "",
    code: ShortText = "",
    random_codes: Annotated[bool, Form()] = False,
    complete_url: Address = "",
    screened_out_url: Address = "",
    no_consent_url: Address = "",
    full_url: Address = "",
    redirect_after_s: Whole = 0,
    most_finished: Whole = 0,
    most_under_way: Whole = 0,
    open_until: ShortText = "",
    minutes: Whole = 0,
) -> dict[str, Any]:
    """Return the options `outside` and `limits`; nothing where the form lacks them. `parse_options` checks them."""
    outside = {
        "id": outside_id.strip(),
        "keep": keep.replace(",", " ").split(),
        "resume": resume,
        "code": code.strip(),
        "random_codes": random_codes,
        "complete_url": complete_url.strip(),
        "screened_out_url": screened_out_url.strip(),
        "no_consent_url": no_consent_url.strip(),
        "full_url": full_url.strip(),
        "redirect_after_s": redirect_after_s,
    }
    limits = {
        "finished": most_finished,
        "under_way": most_under_way,
        "open_until": open_until.strip(),
        "minutes": minutes,
    }
    return {"outside": outside, "limits": limits} if recruiting else {}


def lab_sheet_given(
    lab_sheet: Annotated[bool, Form()] = False,
    lab_display: Note = "",
    lab_size_inch: Number = None,
    lab_peak_luminance_cd_m2: Number = None,
    lab_white_point: Note = "",
    lab_room_light: Note = "",
    lab_distance_cm: Number = None,
) -> dict[str, Any]:
    """Return the option `lab_sheet` of the form; nothing where the form lacks it. `parse_options` checks it."""
    given = {
        "display": lab_display,
        "size_inch": lab_size_inch,
        "peak_luminance_cd_m2": lab_peak_luminance_cd_m2,
        "white_point": lab_white_point,
        "room_light": lab_room_light,
        "distance_cm": lab_distance_cm,
    }
    return {"lab_sheet": {key: value for key, value in given.items() if value is not None}} if lab_sheet else {}


@router.get("/edit")
def edit_page(request: Request, person: Looking, study: AStudy, database: Store) -> Response:
    current = study_file_of(study)
    with database.reading() as connection:
        has_begun = progress_of(connection, study.id).n_started > 0
    context = {
        "options": current.options,
        "stages": OPTIONAL_STAGES,
        "screening": {"tests": TESTS, "axes": AXES},
        "lab_sheet": {"labels": LABELS, "bounds": BOUNDS, "longest": LONGEST_LAB_NOTE},
        "text": write_study_file(current),
        "longest_text": LONGEST_TEXT,
        "longest_file": LONGEST_FILE,
        "resumes": RESUMES,
        "has_begun": has_begun,
    }
    return study_page(request, "edit", person, study, context)


@router.post("/edit")
def edit(
    request: Request,
    actor: Acting,
    study: AStudy,
    database: Store,
    revision: Revision,
    name: Annotated[str, Form(min_length=1, max_length=200)],
    screening: Annotated[dict[str, Any], Depends(screening_given)],
    recruiting: Annotated[dict[str, Any], Depends(recruiting_given)],
    lab_sheet: Annotated[dict[str, Any], Depends(lab_sheet_given)],
    exposure_s: Annotated[float | None, Form(ge=0.1, le=3600, allow_inf_nan=False)] = None,
    stage: Annotated[list[str], Form(max_length=20)] = [],  # noqa: B006 (FastAPI copies it)
    consent: Text = "",
    consent_version: Annotated[str, Form(max_length=200)] = "",
    comprehension: Annotated[bool, Form()] = False,
    debriefing: Text = "",
) -> Response:
    """Save the fields of the form; everything else stays."""
    now = study_file_of(study)
    given = {
        "optional_stages": stage,
        "consent": unix(consent),
        "consent_version": consent_version.strip(),
        "comprehension": comprehension,
        "debriefing": unix(debriefing),
        **screening,
        **lab_sheet,
    }
    with database.reading() as connection:
        if progress_of(connection, study.id).n_started:  # the form lacks the other fields then
            given = {"debriefing": given["debriefing"], **lab_sheet}
    try:
        options = parse_options({**now.options.as_json(), **given, **recruiting})
        wanted = replace(now, name=name.strip(), exposure_s=exposure_s or now.exposure_s, options=options)
        check_minimum_viewing(options, wanted.exposure_s or 0.0)
    except ValueError as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    return save_study(database, study, wanted, revision, actor, languages(request))


@router.post("/edit/file")
def edit_file(
    request: Request,
    actor: Acting,
    study: AStudy,
    database: Store,
    revision: Revision,
    text: Annotated[str, Form(max_length=LONGEST_FILE)],
) -> Response:
    try:
        wanted = _complete(parse_study_file(unix(text)), study_file_of(study))
    except (tomllib.TOMLDecodeError, ValueError) as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    return save_study(database, study, wanted, revision, actor, languages(request))


def _complete(wanted: StudyFile, now: StudyFile) -> StudyFile:
    """Fill what the file leaves out with the present settings; the stimulus set cannot change.

    Raises
    ------
    ValueError
        If the stimulus set or the choice of its conditions changes, or a value is out of bounds.
    """
    if wanted.stimuli is not None or wanted.manifest_sha256 not in (None, now.manifest_sha256):
        raise ValueError("the stimuli of a study do not change; create a new study of the other stimulus set")
    for name in ("protocol", "reference", "without"):
        if getattr(wanted.options, name) != getattr(now.options, name):
            raise ValueError(f"{name} does not change, as the films are made; create a new study of the stimulus set")
    low, high = EXPOSURE_BOUNDS_S
    exposure_s = float(now.exposure_s or 0) if wanted.exposure_s is None else float(wanted.exposure_s)
    if not low <= exposure_s <= high:
        raise ValueError(f"exposure_s is {exposure_s}, expected between {low} and {high}")
    check_minimum_viewing(wanted.options, exposure_s)
    if not 1 <= len(wanted.name.strip()) <= LONGEST_NAME:
        raise ValueError(f"name has {len(wanted.name.strip())} characters, expected 1 to {LONGEST_NAME}")
    seed = now.seed if wanted.seed is None else wanted.seed
    if not 0 <= (seed or 0) < 2**63:
        raise ValueError(f"seed is {seed}, expected a whole number from 0 to 2^63 - 1")
    sha256 = now.manifest_sha256
    return replace(wanted, name=wanted.name.strip(), manifest_sha256=sha256, exposure_s=exposure_s, seed=seed)


def save_study(
    database: Database,
    study: Study,
    wanted: StudyFile,
    revision: int,
    actor: Actor,
    packs: Mapping[str, LanguagePack],
    page: str = "edit",
) -> Response:
    """Save what has changed, and lead back to a page of the study.

    Raises
    ------
    InvalidError
        If the study would be complete in no language.
    ConflictError
        If somebody else has changed the study meanwhile, or participants who have begun would have seen other settings
        than those who come now.
    """
    try:
        check_languages(wanted.options, packs)
    except ValueError as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    changes = _changes(study_file_of(study), wanted)
    try:
        with database.writing() as connection:
            lock_study(connection, study.id)  # nobody begins between the check and the change
            _refuse_without_films(connection, study.id, wanted.options, changes)
            fixed = sorted(changes.keys() - set(FREE))
            if fixed and progress_of(connection, study.id).n_started:
                what = ", ".join(fixed)
                raise ConflictError(f"Participants have begun, so {what} cannot change. Duplicate the study instead.")
            values: dict[str, Any] = {"name": wanted.name, "exposure_s": wanted.exposure_s, "seed": wanted.seed}
            values["options"] = wanted.options.as_json()
            edit_study(connection, study.id, revision, values)
            actor.note(connection, "study edited", study, study.slug, **changes)
    except ConflictError as error:
        with database.writing() as connection:
            actor.note(connection, "edit refused", study, study.slug, reason=error.detail)
        raise
    return see(f"/admin/studies/{study.slug}/{page}")


def _refuse_without_films(
    connection: Transaction, study_id: int, options: StudyOptions, changes: Mapping[str, Any]
) -> None:
    """Refuse a practice whose films were not made with the study.

    Raises
    ------
    ConflictError
        If the practice is to begin, or to show other films.
    """
    if changed := sorted(changes.keys() & {"practice_dataset", "practice_pairs"}):
        raise ConflictError(f"{changed[0]} cannot change: the films of the practice are made with the study.")
    if PRACTICE in options.way and not practice_pairs(connection, study_id):
        raise ConflictError("This study has no films to practise with; create a study with the stage practice instead.")


def _changes(before: StudyFile, after: StudyFile) -> dict[str, Any]:
    """Return the changed settings with their new values; long texts by their length."""
    old, new = _flat(before), _flat(after)
    return {key: _short(value) for key, value in new.items() if value != old[key]}


def _short(value: Any) -> Any:
    return value if len(str(value)) <= LONGEST_NOTE else f"{len(str(value))} characters"


def _flat(study: StudyFile) -> dict[str, Any]:
    return {"name": study.name, "exposure_s": study.exposure_s, "seed": study.seed, **study.options.as_json()}

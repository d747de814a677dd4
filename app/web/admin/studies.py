"""List studies, create them, and open, pause, close, archive, duplicate or preview one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, Form, Path, Request
from fastapi.responses import Response

from app.errors import InvalidError, NotFoundError
from app.ffmpeg import Progress
from app.operations.create import create_study, duplicate_study, slugify
from app.store.invitations import preview_code
from app.store.jobs import STOPPED, job_by_id
from app.store.sessions import begin_preview
from app.store.studies import Standing, all_studies, progress_by_study, set_standing
from app.study.options import StudyOptions, parse_options
from app.study.presets import PRESETS, QUICK, read_preset
from app.study.protocols import PC, PROTOCOLS_IN_WORDS, RATED, SCALES, typed_scale
from app.study.stages import OPTIONAL_STAGES, PRACTICE
from app.study.wording import LONGEST_TEXT
from app.web.admin.jobs import start_job
from app.web.admin.layout import page, see, unix
from app.web.admin.stimulus_sets import known_sets, set_folder
from app.web.analyst.results import load_analysis
from app.web.gates import Acting, AStudy, Looking, Person, Store, settings
from app.web.participant.session import remember

EXPOSURE_S = Form(ge=0.1, le=3600, allow_inf_nan=False)

router = APIRouter(prefix="/admin", include_in_schema=False)


@router.get("")
def studies_page(request: Request, person: Person, database: Store, afterwards: BackgroundTasks) -> Response:
    afterwards.add_task(load_analysis)  # a study's pages come next
    with database.reading() as connection:
        listed = all_studies(connection)
        progress = progress_by_study(connection)  # read second: it then covers every study listed
    return page(request, "studies", person, {"studies": listed, "progress_by_study": progress})


@router.get("/studies/new")
def new_study_page(request: Request, person: Looking) -> Response:
    context = {
        "sets": known_sets(settings(request)),
        "presets": [read_preset(name) for name in PRESETS],
        "default_preset": QUICK,
        "stages": OPTIONAL_STAGES,
        "protocols": PROTOCOLS_IN_WORDS,
        "scales": SCALES,
        "longest_text": LONGEST_TEXT,
    }
    return page(request, "new_study", person, context)


@router.post("/studies/new")
def create(
    request: Request,
    actor: Acting,
    database: Store,
    name: Annotated[str, Form(min_length=1, max_length=200)],
    stimulus_set: Annotated[str, Form(max_length=200)],
    stage: Annotated[list[str], Form(max_length=20)] = [],  # noqa: B006 (FastAPI copies it)
    exposure_s: Annotated[float | None, EXPOSURE_S] = None,
    consent: Annotated[str, Form(max_length=LONGEST_TEXT)] = "",
    preset: Annotated[str, Form(max_length=20)] = QUICK,
    protocol: Annotated[str, Form(max_length=20)] = PC,
    scale: Annotated[str, Form(max_length=20)] = str(SCALES[0]),
    reference: Annotated[str, Form(max_length=200)] = "",
    without: Annotated[str, Form(max_length=LONGEST_TEXT)] = "",
    practice_dataset: Annotated[str, Form(max_length=200)] = "",
) -> Response:
    """Create a study in the background; the job's page shows the progress.

    Parameters
    ----------
    stage : optional stages besides those of the preset
    consent : in place of the preset's; empty: the preset's
    protocol, scale, reference : options of the study; the scale counts where films are rated
    without : conditions to leave out, with commas
    practice_dataset : to practise with, which no trial shows; empty: none
    """
    folder = set_folder(settings(request), stimulus_set)
    try:
        left_out = [condition for each in without.split(",") if (condition := each.strip())]
        given: dict[str, Any] = {"protocol": protocol, "reference": reference.strip(), "without": left_out}
        if protocol in RATED:
            given["scale"] = typed_scale(scale)
        options = _chosen(preset, stage, unix(consent).strip(), given)
        if practice_dataset.strip():
            options = replace(options, practice_dataset=practice_dataset.strip()).with_stage(PRACTICE)
        subject = f"study {slugify(name)}"
    except ValueError as error:
        raise InvalidError(f"The study was not created: {error}.") from error
    server = settings(request)

    def work(progress: Progress) -> str:
        made = create_study(
            server,
            folder,
            name,
            exposure_s=exposure_s,
            options=options,
            progress=progress,
            by=actor.name,
            is_paused=True,
        )
        return f"/admin/studies/{made['slug']}"

    job = start_job(database, actor, f"Creating the study {name}", work, subject=subject)
    return see(f"/admin/jobs/{job}")


def _chosen(preset: str, stages: Sequence[str], consent: str, others: Mapping[str, Any]) -> StudyOptions:
    """Return a preset's options with the form's.

    Parameters
    ----------
    preset, stages, consent : as in `create`
    others : further options

    Raises
    ------
    ValueError
        If there is no such preset or stage.
    """
    chosen = read_preset(preset)
    given: dict[str, Any] = {"optional_stages": list(dict.fromkeys([*chosen.options["optional_stages"], *stages]))}
    if consent:
        given |= {"consent": consent, "consent_version": ""}  # the version names the preset's text
    return parse_options(chosen.overridden_by({**others, **given}))


@router.get("/jobs/{job}")
def job_page(request: Request, job: Annotated[str, Path(max_length=32)], person: Person, database: Store) -> Response:
    with database.reading() as connection:
        known = job_by_id(connection, job)
    if known is None:
        raise NotFoundError("There is no such work in progress.")
    if known.state == "done" and known.result and "hx-request" not in request.headers:
        return see(known.result)
    return page(request, "job", person, {"job": known, "stopped": STOPPED})


@router.post("/studies/{slug}/state")
def change_standing(actor: Acting, study: AStudy, state: Annotated[Standing, Form()], database: Store) -> Response:
    with database.writing() as connection:
        set_standing(connection, study.id, state, actor.now)
        actor.note(connection, f"study {state}", study, study.slug, before=study.standing)
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

"""Show a study's films, and check that every pair's file is there and unchanged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request
from fastapi.responses import FileResponse, Response

from app.errors import NotFoundError
from app.files import file_digest
from app.films.strips import write_still
from app.store.access.experimenters import Experimenter
from app.store.studies.studies import Study
from app.store.trials.designs import STRIPS, pair_records, stimulus_records
from app.study.options.options import parse_options
from app.web.admin.layout import study_page
from app.web.admin.listing import listed
from app.web.gates import Store, database, settings
from app.web.roles import Acting, AStudy, Person

PAIR_FILM_COLUMNS = ("dataset", "top", "bottom", "n_frames")

router = APIRouter(prefix="/admin/studies/{slug}/stimuli", include_in_schema=False)


@router.get("")
def stimuli_page(request: Request, person: Person, study: AStudy) -> Response:
    return _stimuli_page(request, person, study)


@router.post("")
def check_stimuli(request: Request, person: Person, actor: Acting, study: AStudy, database: Store) -> Response:
    """Check that every pair's file exists and is unchanged."""
    with database.reading() as connection:
        pairs = pair_records(connection, study.id)
    checked = {pair["media"]: _fault(request, pair) for pair in pairs}
    with database.writing() as connection:
        faults = sum(fault is not None for fault in checked.values())
        actor.note(connection, "films checked", study, study.slug, files=len(checked), faults=faults)
    return _stimuli_page(request, person, study, checked)


@router.get("/{media}/{half}.jpg")
def still(
    request: Request,
    _person: Person,
    study: AStudy,
    media: Annotated[str, Path(max_length=32)],
    half: Annotated[str, Path(max_length=9)],
    database: Store,
) -> Response:
    """Show the first picture of a strip of a pair's film."""
    strips = STRIPS if parse_options(study.options).reference_beside else STRIPS[:2]
    with database.reading() as connection:
        pair = next((row for row in pair_records(connection, study.id) if row["media"] == media), None)
    if pair is None or half not in strips:
        raise NotFoundError("This study has no such film.")
    server = settings(request)
    path = server.data_dir / "stills" / f"{pair['sha256']}-{half}.jpg"
    if not path.is_file():
        row = strips.index(half) * (pair["height"] + pair["guard_rows"])
        write_still(server.media_dir / pair["file"], path, row=row, width=pair["width"], height=pair["height"])
    return FileResponse(path, media_type="image/jpeg", headers={"Cache-Control": "private, max-age=86400"})


def _stimuli_page(
    request: Request, person: Experimenter, study: Study, checked: Mapping[str, str | None] | None = None
) -> Response:
    """Show a study's films; `checked` says by film what is wrong with it, and then those come first."""
    with database(request).reading() as connection:
        stimuli, pairs = stimulus_records(connection, study.id), pair_records(connection, study.id)
    names = dict.fromkeys(row["dataset"] for row in stimuli)
    if checked is not None:
        pairs = sorted(pairs, key=lambda pair: checked[pair["media"]] is None)
    context = {
        "datasets": {name: [row for row in stimuli if row["dataset"] == name] for name in names},
        "pairs": listed(request, pairs, PAIR_FILM_COLUMNS, prefix="pairs_"),
        "has_reference": bool(parse_options(study.options).reference_beside),
        "checked": checked,
    }
    return study_page(request, "stimuli", person, study, context)


def _fault(request: Request, pair: dict[str, Any]) -> str | None:
    path = settings(request).media_dir / pair["file"]
    if not path.is_file():
        return "the file is missing"
    return None if file_digest(path) == pair["sha256"] else "the file is not what it was when the study was made"

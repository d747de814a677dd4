"""Show a study's films, and check that every one can be shown."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import FileResponse, Response

from app.errors import NotFoundError
from app.films.strips import write_still
from app.operations.studies.check_films import films_of, in_words, last_check, start_film_check
from app.operations.studies.edit import start_mending
from app.store.access.experimenters import Experimenter
from app.store.studies.studies import Study
from app.store.trials.designs import STRIPS, film_file, pair_records, stimulus_records
from app.study.options.options import parse_options
from app.web.admin.background import task_address
from app.web.admin.layout import see, study_page
from app.web.admin.listing import listed
from app.web.gates import Store, database, settings
from app.web.roles import Acting, AStudy, Person

PAIR_FILM_COLUMNS = ("dataset", "top", "bottom", "n_frames")

router = APIRouter(prefix="/admin/studies/{slug}/stimuli", include_in_schema=False)


@router.get("")
def stimuli_page(request: Request, person: Person, study: AStudy) -> Response:
    return _stimuli_page(request, person, study)


@router.post("")
def check_stimuli(request: Request, actor: Acting, study: AStudy, store: Store) -> Response:
    """Decode every film to its end, and play it in a browser where one is installed, in the background."""
    task = start_film_check(settings(request), store, study, actor)
    return see(task_address(task))


@router.post("/again")
def mend_stimuli(request: Request, actor: Acting, study: AStudy, store: Store) -> Response:
    """Make damaged films again, and check all."""
    return see(task_address(start_mending(settings(request), store, study, actor)))


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
    options = parse_options(study.options)
    strips, has_pair_films = STRIPS if options.reference_beside else STRIPS[:2], options.has_pair_films
    with database.reading() as connection:
        pair = next((row for row in pair_records(connection, study.id) if row["media"] == media), None)
        alone = None if has_pair_films else film_file(connection, f"{media}.{half}")
    if pair is None or half not in strips:
        raise NotFoundError("This study has no such film.")
    server = settings(request)
    path = server.data_dir / "stills" / f"{pair['sha256'] if alone is None else alone.sha256}-{half}.jpg"
    if not path.is_file():
        row = 0 if alone else strips.index(half) * (pair["height"] + pair["guard_rows"])
        file = pair["file"] if alone is None else alone.file
        write_still(server.media_dir / file, path, row=row, width=pair["width"], height=pair["height"])
    return FileResponse(path, media_type="image/jpeg", headers={"Cache-Control": "private, max-age=86400"})


def _stimuli_page(request: Request, person: Experimenter, study: Study) -> Response:
    """Show a study's films; those of which the last check found a fault come first."""
    with database(request).reading() as connection:
        stimuli, pairs = stimulus_records(connection, study.id), pair_records(connection, study.id)
        check = last_check(settings(request), study, films_of(connection, study))
    options = parse_options(study.options)
    names = dict.fromkeys(row["dataset"] for row in stimuli)
    if check is not None:
        pairs = sorted(pairs, key=lambda pair: pair["media"] not in check.faults)
    context = {
        "datasets": {name: [row for row in stimuli if row["dataset"] == name] for name in names},
        "pairs": listed(request, pairs, PAIR_FILM_COLUMNS, prefix="pairs_"),
        "has_reference": bool(options.reference_beside),
        "has_pair_films": options.has_pair_films,
        "are_pairs": options.has_pair_films and not options.is_shown_alone,
        "are_two": any(pair["top"] != pair["bottom"] for pair in pairs),
        "check": check,
        "said": in_words(check) if check else "",
    }
    return study_page(request, "stimuli", person, study, context)

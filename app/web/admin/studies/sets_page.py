"""List the server's stimulus sets, show and change one, and upload new ones as zip files.

A name from outside never becomes a path: sets are chosen from the list, and names in an upload must be plain.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal
from urllib.parse import quote

from fastapi import APIRouter, Depends, Form, Path, Query, Request
from fastapi.responses import FileResponse, JSONResponse, Response

from app.errors import InvalidError, NotFoundError, StimuliError
from app.intake.contents import PLAYABLE
from app.intake.treatment import preview_of
from app.operations.studies.receive_films import found_and_done
from app.operations.studies.stimulus_sets import (
    ChangedSetError,
    change_stimulus_set,
    delete_set,
    known_sets,
    set_called,
    studies_of,
    unreadable_sets,
)
from app.store.access.experimenters import Experimenter
from app.store.database.engine import Database
from app.web.admin.background import task_address
from app.web.admin.layout import page, see
from app.web.admin.studies.form import Merged, digests_in, digests_of, merged
from app.web.gates import Store, settings
from app.web.roles import Acting, Looking, Person, experimenter
from app.web.uploads import UploadingActor, begin_installing

PREVIEW = "preview"
CELL = "\t"  # between a condition and a factor, neither of which holds it
LONGEST_DIGESTS = 200_000  # characters of what a page says that its levels were

router = APIRouter(prefix="/admin", include_in_schema=False)

Word = Annotated[str, Form(max_length=200)]
Words = Annotated[list[Word], Form(max_length=10_000)]
Name = Annotated[str, Path(max_length=200)]


@router.get("/sets")
def sets_page(request: Request, person: Person, database: Store) -> Response:
    server = settings(request)
    with database.reading() as connection:
        known = known_sets(server, connection)
        users = {stimulus_set.name: studies_of(connection, stimulus_set) for stimulus_set in known}
        unreadable = unreadable_sets(server, connection, known)
    context = {"sets": known, "unreadable": unreadable, "users": users, "largest_mb": server.largest_upload_mb}
    return page(request, "sets", person, context)


@router.get("/sets/{name}")
def set_page(request: Request, person: Person, database: Store, name: Name) -> Response:
    """Show a set's films, and the factors of its conditions."""
    return _page(request, person, database, name)


def _page(
    request: Request, person: Experimenter, database: Database, name: str, mine: Merged | None = None
) -> Response:
    """Show a set; `mine`: its levels as somebody has typed them while somebody else has saved others."""
    with database.reading() as connection:
        known = set_called(settings(request), connection, name)
        users = studies_of(connection, known)
    saved = _cells(known.levels)
    levels = {each: dict(known.levels[each]) for each in known.conditions}
    for cell, level in mine.values.items() if mine else ():
        condition, _, factor = cell.partition(CELL)
        levels[condition][factor] = level
    numbers = {stimulus.name: number for number, stimulus in enumerate(known.content.stimuli)}
    looks = found_and_done(known.content)
    context = {
        "set": known,
        "users": users,
        "numbers": numbers,
        "looks": looks,
        "factors": list(
            dict.fromkeys([*known.content.factors, *(factor for cells in levels.values() for factor in cells)])
        ),
        "levels": levels,
        "was": digests_of(saved),
        "clashes": mine.clashes if mine else (),
        "others": mine.others if mine else (),
    }
    return page(request, "set", person, context, 409 if mine else 200)


@router.get("/sets/{name}/films/{number}", dependencies=[Depends(experimenter)])
def set_film(request: Request, database: Store, name: Name, number: Annotated[str, Path(max_length=17)]) -> Response:
    """Serve a film of a set by its place in the manifest: first the stimuli, then those for practice.

    `NUMBER.preview` is the beginning of the film, encoded for browsers that do not play the film itself.
    """
    with database.reading() as connection:
        known = set_called(settings(request), connection, name)
    films = (*known.content.stimuli, *known.content.practice)
    place, _, kind = number.partition(".")
    is_there = place.isdecimal() and int(place) < len(films)
    path = known.folder / films[int(place)].video if is_there else known.folder
    if not path.resolve().is_relative_to(known.folder.resolve()) or not path.is_file():
        raise NotFoundError(f"{known.title} has no such film.")
    if kind == PREVIEW or path.suffix.lower() not in PLAYABLE:
        try:
            path = preview_of(path, settings(request).data_dir / "stills")
        except StimuliError as error:
            raise InvalidError(f"{films[int(place)].name} cannot be shown: it is damaged, or no film.") from error
    return FileResponse(path, media_type="video/mp4", headers={"Cache-Control": "private, max-age=3600"})


@router.post("/sets/{name}/factors")
def change_factors(
    request: Request,
    person: Looking,
    actor: Acting,
    database: Store,
    name: Name,
    condition: Words,
    factor: Words,
    level: Words,
    seen: Word = "",
    was: Annotated[str, Form(max_length=LONGEST_DIGESTS)] = "",
) -> Response:
    """Save the table of factors: a name for each column, and the levels row by row; a column without a name goes.

    Parameters
    ----------
    seen, was : digest of the set, and digests of its levels, as the page showed them
    """
    if len(level) != len(condition) * len(factor):
        raise InvalidError(
            f"Nothing was changed: {len(level)} levels, expected {len(factor)} for each of {len(condition)} conditions."
        )
    names = [text.strip() for text in factor]
    if twice := [text for text in names if text and names.count(text) > 1]:
        raise InvalidError(f"Nothing was changed: the factor {twice[0]!r} is there twice; give each its own name.")
    rows = [level[at : at + len(names)] for at in range(0, len(level), len(names))] if names else [[]] * len(condition)
    with database.reading() as connection:
        n_known = len(set_called(settings(request), connection, name).content.factors)
    new = [(names[column], row[column]) for row in rows for column in range(n_known, len(names))]
    if any(text.strip() and not factor for factor, text in new):
        raise InvalidError("Nothing was changed: the new factor has levels and no name; name it above them.")
    levels = {
        key: {factor: text.strip() for factor, text in zip(names, row, strict=True) if factor and text.strip()}
        for key, row in zip(condition, rows, strict=True)
    }
    try:
        change_stimulus_set(settings(request), database, name, actor, levels=levels, seen=seen)
    except ChangedSetError as error:
        saved, typed, before = _cells(error.now.levels), _cells(levels), digests_in(was)
        labels = {cell: " of ".join(cell.split(CELL)[::-1]) for cell in {**saved, **before, **typed}}
        empty = dict.fromkeys(labels, "")
        first = json.dumps({**digests_in(digests_of(empty)), **before}) if before else ""
        return _page(request, person, database, name, merged(first, {**empty, **typed}, saved, labels))
    return see(f"/admin/sets/{quote(name)}?saved=1")


def _cells(levels: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """Return the cells of the table of factors: each level by its condition and factor."""
    return {f"{each}{CELL}{factor}": level for each, row in levels.items() for factor, level in row.items()}


@router.post("/sets/{name}/name")
def rename(request: Request, actor: Acting, database: Store, name: Name, title: Word) -> Response:
    change_stimulus_set(settings(request), database, name, actor, title=title)
    return see(f"/admin/sets/{quote(name)}")


@router.post("/sets/{name}/delete")
def delete(request: Request, actor: Acting, database: Store, name: Name, again: Word) -> Response:
    delete_set(settings(request), database, name, again, actor)
    return see("/admin/sets")


@router.put("/stimuli/upload")
async def upload(
    request: Request,
    actor: UploadingActor,
    database: Store,
    name: Annotated[str, Query(max_length=200)] = "",
    conform: bool = False,
    untagged_range: Annotated[Literal["", "limited", "full"], Query(alias="range")] = "",
    then: Literal["", "study"] = "",
) -> Response:
    """Take a zip file of films, or of a stimulus set; it is unpacked, looked at and checked in the background.

    `then=study` leads on to the form of a study of it.
    """
    server = settings(request)
    told: dict[str, Any] = {"is_conformed": conform, "untagged_range": untagged_range, "is_for_study": then == "study"}
    task = await begin_installing(request, server, actor, database, name, **told)
    return JSONResponse({"task": task_address(task)}, 202)

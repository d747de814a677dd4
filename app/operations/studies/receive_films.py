"""Take in what somebody uploads to compare: a stimulus set, or plain films, of which a set is made."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

from app.errors import StimuliError, said_on_page
from app.ffmpeg import VIDEO_SUFFIXES, Progress
from app.files import is_plain_name, read_json
from app.intake.arrivals import unpacked_films
from app.intake.bounds import in_bounds
from app.intake.import_videos import import_stimuli
from app.intake.stimuli import MANIFEST, StimulusSet, check_videos, read_manifest
from app.intake.zips import MB
from app.operations.studies.create import slugify
from app.settings import Settings

UNNAMED = "Films"
TABLE = "films.csv"  # says what each film shows that lies in no folder
SEPARATORS = ("__", "_", "-", " ")  # of a scene's name from a condition's


def install_set(
    server: Settings,
    packed: Path,
    unpacked: Path,
    progress: Progress,
    *,
    name: str = "",
    is_wish: bool = False,
    is_conformed: bool = False,
    untagged_range: str = "",
) -> str:
    """Unpack an upload, make a set of it where it is none, check it, move it to its place, and return its name.

    Parameters
    ----------
    packed : a zip file of a set's folder, or of DATASET/CONDITION.mp4
    unpacked : folder that is made for its content
    name : of a set that is made of plain films; empty: that of the folder in the zip file, with a number if it is taken
    is_wish : may the name get a number, too?
    is_conformed : make films of a dataset alike that differ in size, frame rate or length
    untagged_range : limited or full, of films that do not say theirs; empty: refuse those where it matters

    Raises
    ------
    ValueError, TooLargeError
        If it is neither, its films cannot be shown, or its name is taken; without the server's paths.
    """
    folder = in_bounds(unpacked_films, packed, unpacked, server.largest_upload_mb * MB)
    try:
        if (folder / MANIFEST).is_file():
            stimulus_set = in_bounds(read_manifest, folder, are_compared=True)
            check_videos(stimulus_set, progress)
        else:
            title = name.strip() or (folder.name if folder != unpacked else UNNAMED)
            title = _free(server, title) if is_wish or not name.strip() else title
            _refuse_taken(server, title)  # before its films are decoded
            made = import_stimuli(
                _in_folders(folder),
                unpacked.with_name("made") / slugify(title),
                is_conformed=is_conformed,
                untagged_range=untagged_range,
                name=title,
                progress=progress,
            )
            stimulus_set = _with_pairs(made.stimulus_set)
    except StimuliError as error:
        said = said_on_page(error).replace(f"{folder}/", "").replace(str(folder), "the upload")
        raise StimuliError(said) from error
    slug = _refuse_taken(server, stimulus_set.name)
    stimulus_set.folder.rename(server.sets_dir / slug)
    return slug


def _free(server: Settings, title: str) -> str:
    """Return a title that no set of the server has: this one, or with the first number that is free."""
    numbered = (title if number == 1 else f"{title} {number}" for number in count(1))
    return next(each for each in numbered if not (server.sets_dir / slugify(each)).exists())


def _refuse_taken(server: Settings, title: str) -> str:
    slug = slugify(title)
    if (server.sets_dir / slug).exists():
        raise StimuliError(f"there are films called {slug!r} already; give these another name, then upload them again")
    return slug


def found_and_done(stimulus_set: StimulusSet) -> dict[str, dict[str, Any]]:
    """Return what the import found in each film and did to it, by its name; sets of earlier versions do not say."""
    manifest = read_json(stimulus_set.folder / MANIFEST)
    entries = [*manifest.get("stimuli", ()), *manifest.get("practice", ())]
    return {
        f"{entry.get('dataset')}/{entry.get('approach')}": {
            "found": entry.get("found") or {},
            "done": entry.get("done") or [],
        }
        for entry in entries
        if isinstance(entry, dict)
    }


def _in_folders(folder: Path) -> Path:
    """Put films that lie in no folder into one for each scene: as a table says, or as all of their names agree.

    Raises
    ------
    StimuliError
        If neither says what each of them shows.
    """
    flat = sorted(path for path in folder.iterdir() if path.suffix.lower() in VIDEO_SUFFIXES)
    if not flat:
        return folder
    table = folder / TABLE
    places = _places_of_table(table) if table.is_file() else _places_of_names([path.stem for path in flat])
    for path in flat:
        dataset, condition = places.get(path.name, places.get(path.stem, ("", "")))
        if any(not is_plain_name(part) for part in (dataset, condition)):
            raise StimuliError(
                f"{path.name} lies in no folder, and its name does not say what it shows; expected a folder for each "
                "scene with a film for each condition, such as street/method-a.mp4, names such as street_method-a.mp4, "
                f"or a table {TABLE} with the columns file, dataset and condition. Or drop the films themselves on New "
                "study, which asks"
            )
        (folder / dataset).mkdir(exist_ok=True)
        path.rename(folder / dataset / f"{condition}{path.suffix}")
    return folder


def _places_of_table(path: Path) -> dict[str, tuple[str, str]]:
    """Read scene and condition of each file from a table."""
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
        return {row["file"].strip(): (row["dataset"].strip(), row["condition"].strip()) for row in rows}
    except (KeyError, AttributeError, UnicodeDecodeError, csv.Error) as error:
        raise StimuliError(f"{TABLE} cannot be read; expected the columns file, dataset and condition") from error


def _places_of_names(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Split names such as street_method-a where one separator gives every scene every condition; nothing: none does."""
    for separator in SEPARATORS:
        for split in (str.rpartition, str.partition):
            places = {name: split(name, separator)[::2] for name in names}
            datasets, conditions = (set(parts) for parts in zip(*places.values(), strict=True))
            is_whole = len(datasets) * len(conditions) == len(set(places.values())) == len(names)
            if is_whole and len(conditions) > 1 and all(map(all, places.values())):
                return places
    return {}


def _with_pairs(made: StimulusSet) -> StimulusSet:
    """Return a set whose scenes all have something to compare."""
    if alone := [dataset for dataset in made.datasets if len(made.of_dataset(dataset)) < 2]:
        raise StimuliError(f"{alone[0]} has one film, expected two or more to compare; add the others to its folder")
    return made

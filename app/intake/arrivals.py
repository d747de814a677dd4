"""Unpack what was uploaded, check it by its kind, and put it on its shelf, whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.errors import InvalidError
from app.ffmpeg import VIDEO_SUFFIXES
from app.intake.bounds import in_bounds
from app.intake.captures import CAPTURE_FILE, missing_pictures, read_outline
from app.intake.models import FOLDERS as MODEL_FOLDERS
from app.intake.models import Model, holds_models, read_models
from app.intake.reports import REPORT, TABLE, Report, read_report
from app.intake.shelves import FOLDERS, SUFFIXES, free_path
from app.intake.stimuli import MANIFEST
from app.intake.summaries import CLOUDS, MODELS, PICTURES, SCENE_FILE, TABLES, files_of, is_film
from app.intake.zips import MB, check_file, check_zip, is_zip, unpack

TEXTS = (".json", ".csv", ".txt", ".md", ".toml", ".yml", ".yaml", ".xml", ".ini", ".html", ".log")
BAGS = (".bag", ".db3", ".mcap")  # of ROS, which hold their pictures
CAPTURED = (*PICTURES, *VIDEO_SUFFIXES, ".npy", ".pfm", ".ply", ".bin", ".sfm", ".mat", ".camera", *BAGS, *TEXTS)
BELONGING: Mapping[str, tuple[str, ...]] = {  # suffixes of files that may be in an upload
    "captures": CAPTURED,
    "calibration": (*PICTURES, *VIDEO_SUFFIXES, *TEXTS),
    "models": (*MODELS, ".mtl", ".bin", *PICTURES, ".webp", *TEXTS),
    "films": (*VIDEO_SUFFIXES, *TEXTS),
    "clouds": (*CLOUDS, ".mtl", ".bin", *PICTURES, *TEXTS),
    "measures": (".csv",),
    "votes": tuple({f".{name.rpartition('.')[2]}" for name in TABLES}),
}
EXPECTED: Mapping[str, str] = {
    "captures": "a zip file of the recording's folder: pictures or videos, with capture.json where it has one",
    "calibration": "a zip file of the pictures of a board, in left/ and right/, or in such folders of each sensor",
    "models": "a zip file of the models' folder, with scene.json and APPROACH/FRAME.ply, .obj, .glb, or splats",
    "films": "a zip file of DATASET/CONDITION.mp4, with conditions.csv where conditions have factors",
    "clouds": f"a cloud or mesh ({', '.join(CLOUDS)}), or a zip file of some",
    "measures": "a table in CSV, whose name ends in .csv",
    "votes": f"a table of votes or ratings, from any program, whose name ends in {', '.join(TABLES)}",
}
COMPARED = (*VIDEO_SUFFIXES, ".json", ".csv", ".txt", ".md")  # suffixes of files of a stimulus set, or of films
RESULTS = (".ply", ".png", ".pdf", ".svg", ".json", ".csv", ".html", ".txt")  # a report's page is not kept
UNPACKED = "unpacked"  # folder of what was in an upload of results
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # how such a text begins


@dataclass(frozen=True)
class Limits:
    """How large an upload may be, packed and unpacked, and how many files it may hold."""

    largest_mb: int
    most_files: int


def shelve(intake: Path, kind: str, name: str, received: Path, work: Path, limits: Limits) -> Path:
    """Check an upload and put it on its shelf; return its place there.

    Parameters
    ----------
    intake : the intake folder
    kind : of the shelf
    name : of the new entry, which is free
    received : a zip file, or the file itself where the kind takes one
    work : a missing folder on the same disk, to unpack into; the caller removes it
    limits : of the upload

    Raises
    ------
    InvalidError, TooLargeError
        If it is not what the kind takes, or the name is taken meanwhile.
    """
    work.mkdir(parents=True)
    made = work / "unpacked"
    if is_zip(received) and kind in FOLDERS:
        check_zip(received, limits.largest_mb, limits.most_files)
        made.mkdir()
        unpack(received, made, limits.largest_mb * MB, BELONGING[kind], kind)
        made = _top(kind, made)
    elif kind in SUFFIXES and name.lower().endswith(SUFFIXES[kind]):
        made = work / name
        shutil.copyfile(received, made)
        check_file(made, name, BELONGING[kind], kind)
    else:
        raise InvalidError(f"This file does not belong to {kind}; expected {EXPECTED[kind]}.")
    CHECKS[kind](made)
    place = free_path(intake, kind, name)
    place.parent.mkdir(parents=True, exist_ok=True)
    made.rename(place)
    return place


def _top(kind: str, folder: Path) -> Path:
    """Return the folder to keep: a zip file may hold it inside another one."""
    while True:
        inside = list(folder.iterdir())
        if len(inside) != 1 or not inside[0].is_dir():
            return folder
        if kind == "films" and any(path.suffix.lower() in VIDEO_SUFFIXES for path in inside[0].iterdir()):
            return folder  # it is the only dataset
        folder = inside[0]


def _check_capture(folder: Path) -> None:
    """Check that a capture's pictures are there, or those of a recording of which a job can make a capture."""
    if not (folder / CAPTURE_FILE).is_file():
        if not _holds(folder, (*PICTURES, *VIDEO_SUFFIXES, *BAGS)):
            raise InvalidError(f"There is neither {CAPTURE_FILE} nor a picture or video in the upload.")
    elif missing := missing_pictures(folder, read_outline(folder)):
        raise InvalidError(
            f"{CAPTURE_FILE} names {missing[0]}, which is not in the upload{_and_more(missing)}. Add what is missing, "
            "then upload again."
        )


def _check_calibration(folder: Path) -> None:
    if not _holds(folder, (*PICTURES, *VIDEO_SUFFIXES)):
        raise InvalidError(
            "There is no picture or video of a board in the upload; expected left/ and right/ with them."
        )


def _check_models(folder: Path) -> None:
    if not (folder / SCENE_FILE).is_file():
        raise InvalidError(
            f"There is no {SCENE_FILE} beside the models; it names the dataset, the unit and what is up."
        )
    if not _holds(folder, MODELS):
        raise InvalidError("There is no model in the upload; expected APPROACH/FRAME.ply, .obj, .glb, .gltf or splats.")


def _check_films(folder: Path) -> None:
    films = [file.relative_to(folder) for file in files_of(folder) if file.suffix.lower() in VIDEO_SUFFIXES]
    if misplaced := [film.as_posix() for film in films if len(film.parts) != 2]:
        raise InvalidError(
            f"{misplaced[0]} lies in the wrong place{_and_more(misplaced)}; expected DATASET/CONDITION.mp4."
        )
    if not any(map(is_film, films)):
        raise InvalidError("There is no film in the upload; expected DATASET/CONDITION.mp4.")


def _check_clouds(path: Path) -> None:
    if not _holds(path, CLOUDS):
        raise InvalidError(f"There is no cloud in the upload; expected files that end in {', '.join(CLOUDS)}.")


def _check_measures(path: Path) -> None:
    try:
        read_report(path)
    except ValueError as error:
        raise InvalidError(f"{str(error).replace(str(path), 'The table')}.") from error


CHECKS: Mapping[str, Callable[[Path], None]] = {
    "captures": _check_capture,
    "calibration": _check_calibration,
    "models": _check_models,
    "films": _check_films,
    "clouds": _check_clouds,
    "measures": _check_measures,
    "votes": lambda _path: None,  # it is read, or asked about, where it is shown
}


def _holds(path: Path, suffixes: tuple[str, ...]) -> bool:
    return any(file.suffix.lower() in suffixes for file in files_of(path))


def _and_more(names: list[str]) -> str:
    return f" (and {len(names) - 1} more)" if len(names) > 1 else ""


def unpacked_films(packed: Path, unpacked: Path, limit: int) -> Path:
    """Unpack an upload to compare; return the folder that holds the manifest, or the datasets."""
    unpack(packed, unpacked, limit, COMPARED, "films to compare")
    inside = list(unpacked.iterdir())
    if len(inside) != 1 or not inside[0].is_dir():
        return unpacked
    only = inside[0]  # a zip file may hold one folder
    is_whole = (only / MANIFEST).is_file() or any(path.is_dir() for path in only.iterdir())
    return only if is_whole else unpacked


def arrived_results(received: Path, folder: Path, largest_mb: int) -> list[Path]:
    """Unpack an upload that `check_results` has passed; return its folders and tables, as `attach` takes them.

    Parameters
    ----------
    received : the upload, which is moved
    folder : for what is unpacked
    largest_mb : how much it may unpack to

    Raises
    ------
    ValueError
        If there is nothing to attach.
    """
    unpacked, table = folder / UNPACKED, folder / "table.csv"
    if not is_zip(received):
        received.rename(table)
        return [table]
    in_bounds(unpack, received, unpacked, largest_mb * MB, RESULTS, "reports or models")
    return results_in(unpacked)


def without_places(told: str, folder: Path) -> str:
    """Return a sentence on an upload without the places on the server that it names."""
    unpacked, table = folder / UNPACKED, folder / "table.csv"
    return told.replace(f"{unpacked}/", "").replace(str(unpacked), "the zip file").replace(str(table), "the table")


def check_results(path: Path, largest_mb: int) -> None:
    """Check an upload of results before any of it is unpacked or read.

    Raises
    ------
    InvalidError, TooLargeError
        If it is neither a table nor a zip file of plain names that unpacks to less than the limit.
    """
    if is_zip(path):
        check_zip(path, largest_mb)
        return
    with path.open("rb") as file:
        head = file.read(1024)
    if b"\0" in head and not head.startswith(UTF_16):
        raise InvalidError("This is neither a zip file nor a table in CSV.")


def results_in(folder: Path) -> list[Path]:
    """Return the folders of reports and of models, and tables of measures outside them, at any depth of an upload.

    Raises
    ------
    ValueError
        If there is none, or a folder holds both.
    """
    reports = {path.parent for path in folder.rglob(REPORT)}
    tables = {path for path in folder.rglob(TABLE) if path.parent not in reports}
    models = {path.parent for name in MODEL_FOLDERS.values() for path in folder.rglob(name) if path.is_dir()}
    if both := reports & models:
        raise ValueError(f"{min(both)}: holds a report and models; put them into two folders")
    if not reports | models | tables:
        raise ValueError(
            f"{folder}: holds neither a report ({REPORT}), nor a table of measures ({TABLE}), nor models "
            "(meshes/DATASET/CONDITION.ply); pack the folders that a validation or an export of models wrote"
        )
    return sorted(reports | models | tables)


def read_results(paths: Sequence[Path]) -> tuple[list[tuple[Path, Report]], list[Model]]:
    """Read the reports and tables, each with its path, and all models."""
    reports = [(path, read_report(path)) for path in paths if not holds_models(path)]
    return reports, [model for path in paths if holds_models(path) for model in read_models(path)]

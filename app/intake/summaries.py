"""Say in one line what an entry of the intake folder holds, or what is wrong with it, without decoding its pictures."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from app.errors import InvalidError
from app.ffmpeg import VIDEO_SUFFIXES
from app.files import read_json
from app.intake.captures import CAPTURE_FILE, LARGEST_DESCRIPTION, read_outline
from app.intake.import_videos import MASK, MASTER
from app.intake.reports import REPORT
from app.intake.stimuli import MANIFEST

SCENE_FILE = "scene.json"
RUN_FILE = "run.json"
ANALYSIS = "analysis.json"
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".pnm", ".exr")
TABLES = (".csv", ".tsv", ".csv.gz", ".tsv.gz", ".xlsx", ".json", ".jsonl", ".ndjson", ".parquet")
LONGEST_NAME = 100  # letters
SCANS = (".pcd", ".las", ".laz", ".e57")
SHAPES = (".ply", ".obj", ".glb", ".gltf", ".stl", ".off", *SCANS, ".parquet")  # the last one is a packed mesh of a run
MODELS = (*SHAPES, ".spz", ".splat", ".ksplat", ".sog")
NOTES = (".txt", ".csv")  # which may hold points, or notes on the clouds beside them
CLOUDS = (*SHAPES, ".xyz", ".asc", ".pts", *NOTES)


def files_of(path: Path) -> list[Path]:
    """Return the files below a folder by name, or the file itself; links and hidden ones are left out.

    Nothing outside the folder is read by a link in it.
    """
    if path.is_dir() and not path.is_symlink():
        return [Path(file.path) for file in walk(path)]
    return [path] if path.is_file() and not path.is_symlink() else []


def walk(folder: Path | str) -> Iterator[os.DirEntry[str]]:
    """Yield the files below a folder as `files_of` does, without asking the disk for each: there may be very many.

    Folders that a job removes meanwhile, or that the server's user may not read, are left out.
    """
    with suppress(FileNotFoundError, PermissionError), os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            if entry.name.startswith("."):
                continue
            if entry.is_dir(follow_symlinks=False):
                yield from walk(entry.path)
            elif entry.is_file(follow_symlinks=False):
                yield entry


def is_readable(path: Path) -> bool:
    """Whether the server's user may read a file, or list and enter a folder; what was copied by hand may be closed."""
    return os.access(path, os.R_OK) and (not path.is_dir() or os.access(path, os.X_OK))


def capture_summary(folder: Path) -> str:
    """Say how many sensors and frames a capture has; a recording may have no `capture.json` yet."""
    if not (folder / CAPTURE_FILE).is_file():
        return f"recording without {CAPTURE_FILE}: {calibration_summary(folder)}"
    try:
        outline = read_outline(folder)
    except InvalidError as error:
        return error.detail
    parts = [_counted(len(outline.sensors), "sensor"), _counted(outline.n_frames, "frame")]
    if outline.n_frames > 1:
        parts.append(f"{outline.fps:g} a second")
    return ", ".join([*parts, "with masks"] if outline.has_masks else parts)


def calibration_summary(path: Path) -> str:
    """Say how many pictures of a board there are."""
    files = files_of(path)
    n_pictures, n_videos = (
        sum(file.suffix.lower() in suffixes for file in files) for suffixes in (PICTURES, VIDEO_SUFFIXES)
    )
    parts = [_counted(n, noun) for n, noun in ((n_pictures, "picture"), (n_videos, "video")) if n]
    return ", ".join(parts) or "no picture"


def models_summary(folder: Path) -> str:
    """Say how many approaches and models there are, and of which scene."""
    models = [file for file in files_of(folder) if file.suffix.lower() in MODELS]
    approaches = {file.relative_to(folder).with_suffix("").parts[0] for file in models}
    counted = f"{_counted(len(approaches), 'approach')}, {_counted(len(models), 'model')}"
    try:
        dataset = str(read_json(folder / SCENE_FILE, LARGEST_DESCRIPTION)["dataset"])
        return f"{counted} of {dataset[:LONGEST_NAME]}"
    except (ValueError, KeyError):
        return f"{counted}; {SCENE_FILE} is missing or damaged"


def films_summary(folder: Path) -> str:
    """Say how many conditions of how many datasets are filmed."""
    films = [file for file in files_of(folder) if is_film(file.relative_to(folder))]
    datasets = {file.parent.name for file in films}
    if not films:
        return "no film DATASET/CONDITION.mp4"
    return f"{_counted(len(films), 'film')} of {_counted(len(datasets), 'dataset')}"


def clouds_summary(path: Path) -> str:
    """Say how many clouds there are."""
    return _counted(len(clouds_among(files_of(path))), "cloud")


def clouds_among(files: Iterable[Path]) -> list[Path]:
    """Return those files that are clouds; text of any kind is one where nothing else is."""
    clouds = [file for file in files if file.suffix.lower() in CLOUDS]
    return [file for file in clouds if file.suffix.lower() not in NOTES] or clouds


def measures_summary(path: Path) -> str:
    """Say how many rows a table of measures has, and name its columns."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.reader(file)
            header = next(rows, [])
            return f"{_counted(sum(1 for row in rows if row), 'row')}: {', '.join(header)[:100]}"
    except (OSError, UnicodeDecodeError, csv.Error):
        return "not readable as a table in UTF-8"


def votes_summary(path: Path) -> str:
    """Say that a table is one; what its columns are is said where it is read."""
    return f"table of votes or ratings, {path.stat().st_size / 1024:.0f} kB"


def run_summary(folder: Path) -> str:
    """Say what a job made: a reconstruction, a stimulus set, a report, or files."""
    kinds: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
        (MANIFEST, lambda content: f"stimulus set of {_counted(len(content['stimuli']), 'film')}"),
        (RUN_FILE, _run_summary),
        (REPORT, lambda content: f"report{_named(content, 'kind')}"),
    )
    for name, say in kinds:
        try:
            return say(read_json(folder / name))
        except (ValueError, KeyError, TypeError):
            continue
    if (folder / ANALYSIS).is_file():
        return "analysis of votes or ratings"
    return _counted(len(files_of(folder)), "file")


def _run_summary(content: Mapping[str, Any]) -> str:
    approaches, n_frames = content["approaches"], len(content["frames"])
    return f"reconstruction of {content['dataset']}: {_counted(n_frames, 'frame')} by {', '.join(approaches)}"


def is_film(relative: Path) -> bool:
    """Tell a film DATASET/CONDITION.mp4 from masters, masks and other files."""
    plain = not relative.stem.endswith((MASTER, MASK))
    return plain and len(relative.parts) == 2 and relative.suffix.lower() in VIDEO_SUFFIXES


SUMMARIES: Mapping[str, Callable[[Path], str]] = {
    "captures": capture_summary,
    "calibration": calibration_summary,
    "models": models_summary,
    "films": films_summary,
    "clouds": clouds_summary,
    "measures": measures_summary,
    "votes": votes_summary,
    "runs": run_summary,
}


def _named(content: Mapping[str, Any], key: str) -> str:
    return f": {content[key]}" if isinstance(content.get(key), str) else ""


def _counted(n: int, noun: str) -> str:
    plural = f"{noun}es" if noun.endswith("ch") else f"{noun}s"
    return f"{n} {noun if n == 1 else plural}"

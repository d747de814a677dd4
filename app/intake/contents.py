"""Sort the files of an entry by how a page can show them: films, pictures, models, reports, tables."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from app.ffmpeg import VIDEO_SUFFIXES
from app.intake.import_videos import MASK, MASTER
from app.intake.models import FOLDERS, LARGEST_BYTES, LONGEST_HEADER, Kind
from app.intake.summaries import files_of, is_readable

PLAYABLE = (".mp4", ".webm")  # by browsers, mostly; of other films a preview is made
SHOWN_PICTURES = (".png", ".jpg", ".jpeg", ".svg", ".webp")
MOST_SHOWN = 120  # films, pictures and reports on a page
MOST_MODELS = 400
SPLATS = re.compile(rb"property \w+ (f_dc_0|packed_position)\s")
COUNT = re.compile(rb"element (vertex|face) (\d{1,18})\s")


@dataclass(frozen=True)
class ShownModel:
    """A mesh, cloud or splats as the page's viewer takes it; `place` is its path in the entry.

    Parameters
    ----------
    dataset : the frame, or another name of what several approaches model
    condition : the approach, or where the file lies
    kind : by what the file has: properties of splats, triangles, or points
    """

    place: str
    dataset: str
    condition: str
    kind: Kind
    n_points: int
    n_faces: int


@dataclass(frozen=True)
class Contents:
    """Paths in an entry, by how they are shown; `sizes` has all files, in bytes.

    Parameters
    ----------
    films : by dataset
    """

    films: Mapping[str, list[str]]
    pictures: list[str]
    models: list[ShownModel]
    reports: list[str]
    tables: list[str]
    sizes: Mapping[str, int]


def read_contents(entry: Path) -> Contents:
    """Sort the files of an entry; the first of each sort, where there are very many."""
    base = entry.parent if entry.is_file() else entry
    files = [(file.relative_to(base).as_posix(), file) for file in files_of(entry) if is_readable(file)]
    places = [place for place, _ in files]
    films: dict[str, list[str]] = {}
    for place in _ending(places, VIDEO_SUFFIXES)[:MOST_SHOWN]:
        if not Path(place).stem.endswith((MASTER, MASK)):
            films.setdefault(Path(place).parent.as_posix(), []).append(place)
    models = (_model(place, file) for place, file in files if place.lower().endswith(".ply"))
    return Contents(
        films,
        _pictures(places)[:MOST_SHOWN],
        [model for model, _ in zip(filter(None, models), range(MOST_MODELS), strict=False)],
        _ending(places, (".html",))[:MOST_SHOWN],
        _ending(places, (".csv",))[:MOST_SHOWN],
        {place: file.stat().st_size for place, file in files},
    )


def _pictures(places: list[str]) -> list[str]:
    """Return the pictures; of a figure in several forms the drawing, which is sharp at any size."""
    drawings = {place.removesuffix(".svg") for place in places if place.endswith(".svg")}
    return [
        place
        for place in _ending(places, SHOWN_PICTURES)
        if place.endswith(".svg") or Path(place).with_suffix("").as_posix() not in drawings
    ]


def _ending(places: list[str], suffixes: tuple[str, ...]) -> list[str]:
    return [place for place in places if place.lower().endswith(suffixes)]


def _model(place: str, file: Path) -> ShownModel | None:
    """Describe a PLY file; None where a browser cannot show it."""
    if file.stat().st_size > LARGEST_BYTES:
        return None
    with file.open("rb") as opened:
        header = opened.read(LONGEST_HEADER).partition(b"end_header")[0]
    counts = {name: int(count) for name, count in COUNT.findall(header)}
    if not header.startswith(b"ply") or not counts.get(b"vertex"):
        return None
    *folders, stem = Path(place).with_suffix("").parts
    where = "/".join(folders[1:] if folders[:1] and folders[0] in FOLDERS.values() else folders)
    dataset, condition = (stem, where) if where else ("all", stem)
    n_faces = counts.get(b"face", 0)
    kind: Kind = "splat" if SPLATS.search(header) else "mesh" if n_faces else "cloud"
    return ShownModel(place, dataset, condition, kind, counts[b"vertex"], n_faces)

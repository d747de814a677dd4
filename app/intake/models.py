"""Check a folder of meshes and point clouds to attach to a study, from `reconstudy models` or of anybody's PLY files.

It holds `meshes/DATASET/CONDITION.ply` and `clouds/DATASET/CONDITION.ply`, binary and little endian. Points may have
colours, normals, and `error`, their signed distance to the truth in mm. The content of a file counts, not its name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyListProperty, PlyParseError

from app.files import file_digest

Kind = Literal["mesh", "cloud"]
FOLDERS: dict[Kind, str] = {"mesh": "meshes", "cloud": "clouds"}
LARGEST_BYTES = 256 * 1024 * 1024  # of a model; a browser holds two
LONGEST_HEADER = 8192
LIMIT_SHARE = 95  # percentile of the errors where the colour scale ends, as in the reports
UNREADABLE = "has {!r} in its header, expected points with numbers and lists of three points"
READABLE = re.compile(r"element (vertex|face) \d{1,18}|property list (uchar|uint8) u?int(32)? vertex_ind(ices|ex)")
TRIANGLES = {"vertex_indices": 3, "vertex_index": 3}  # lists of known length are mapped, not read into memory


@dataclass(frozen=True)
class Model:
    """A mesh or cloud of a condition in a dataset.

    Parameters
    ----------
    error_limit_mm : 95 % of the points are nearer to the truth; None where errors are not known
    """

    path: Path
    dataset: str
    condition: str
    kind: Kind
    sha256: str
    n_points: int
    n_faces: int
    error_limit_mm: float | None


def holds_models(folder: Path) -> bool:
    """Say whether a folder looks like one of models."""
    return any((folder / name).is_dir() for name in FOLDERS.values())


def read_models(folder: Path) -> list[Model]:
    """Check all models of a folder.

    Raises
    ------
    ValueError
        If it holds no model, or an invalid one: names the file.
    """
    models = [read_model(path, kind) for kind, path in _files(folder)]
    if not models:
        raise ValueError(f"{folder}: holds no meshes/DATASET/CONDITION.ply; `reconstudy models RUN -o OUT` writes them")
    return models


def read_model(path: Path, kind: Kind) -> Model:
    """Check the model in a file DATASET/CONDITION.ply.

    Raises
    ------
    ValueError
        If it is not a model of this kind.
    """
    if path.stat().st_size > LARGEST_BYTES:
        raise ValueError(f"{path}: has {path.stat().st_size // 2**20} MB, expected {LARGEST_BYTES // 2**20} at most")
    try:
        points, faces = _elements(path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if kind == "mesh" and not len(faces):
        raise ValueError(f"{path}: holds no faces; a cloud belongs into the folder {FOLDERS['cloud']}")
    limit = _error_limit(path, points)
    digest = file_digest(path)
    return Model(path, path.parent.name, path.stem, kind, digest, len(points), len(faces), limit)


def _files(folder: Path) -> Iterator[tuple[Kind, Path]]:
    for kind, name in FOLDERS.items():
        for path in sorted((folder / name).glob("*/*.ply")):
            yield kind, path


def _read_ply(path: Path) -> PlyData:
    """Map a PLY into memory whose only lists are those of triangles; all else would be read row by row."""
    with path.open("rb") as file:
        header, end, _ = file.read(LONGEST_HEADER).partition(b"end_header\n")
        if not end or not header.startswith(b"ply\nformat binary_little_endian 1.0\n"):
            raise ValueError("is no binary little-endian PLY file")
        for line in (" ".join(line.split()) for line in header.decode("ascii", "replace").split("\n")):
            if line.startswith(("element", "property list")) and not READABLE.fullmatch(line):
                raise ValueError(UNREADABLE.format(line))
        file.seek(0)
        try:
            ply = PlyData.read(file, mmap="r", known_list_len={"vertex": TRIANGLES, "face": TRIANGLES})
        except (PlyParseError, ValueError) as error:
            raise ValueError(f"is no whole PLY file of triangles: {error}") from error
        if file.read(1):
            raise ValueError("goes on after its last element")
    return ply


def _elements(path: Path) -> tuple[NDArray[np.void], NDArray[np.integer]]:
    """Read the points, and the triangles (M, 3), of a PLY that can be drawn."""
    ply = _read_ply(path)
    for element in ply:
        for line in element.properties:
            if isinstance(line, PlyListProperty) != (element.name == "face"):
                raise ValueError(UNREADABLE.format(str(line)))
    points: NDArray[np.void] = ply["vertex"].data if "vertex" in ply else np.zeros(0, np.void)
    if not len(points) or not {"x", "y", "z"} <= set(points.dtype.names or ()):
        raise ValueError("holds no points with x, y and z")
    if not all(np.isfinite(points[axis]).all() for axis in "xyz"):
        raise ValueError("holds coordinates that are not finite numbers")
    lists = ply["face"].properties if "face" in ply else ()
    faces: NDArray[np.integer] = ply["face"][lists[0].name] if lists else np.zeros((0, 3), np.int32)
    if faces.size and not 0 <= faces.min() <= faces.max() < len(points):
        raise ValueError("has faces that are no triangles of its points")
    return points, faces


def _error_limit(path: Path, points: NDArray[np.void]) -> float | None:
    if "error" not in (points.dtype.names or ()):
        return None
    errors = np.abs(points["error"].astype(np.float64))
    if not np.isfinite(errors).all():
        raise ValueError(f"{path}: holds errors that are not finite numbers")
    return float(np.percentile(errors, LIMIT_SHARE))

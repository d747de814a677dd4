"""Check a folder of meshes, clouds and splats to attach to a study, from `reconstudy models` or of anybody's PLY files.

It holds `meshes/DATASET/CONDITION.ply`, `clouds/DATASET/CONDITION.ply` and `splats/DATASET/CONDITION.ply`, binary and
little endian. Points may have colours, normals, and `error`, their signed distance to the truth in mm; splats have the
properties of the original trainer (Kerbl et al. 2023). The content of a file counts, not its name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from app.files import file_digest

Kind = Literal["mesh", "cloud", "splat"]
FOLDERS: dict[Kind, str] = {"mesh": "meshes", "cloud": "clouds", "splat": "splats"}
SPLAT = {"f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"}
LARGEST_BYTES = 256 * 1024 * 1024  # of a model; a browser holds two
LONGEST_HEADER = 8192
LIMIT_SHARE = 95  # percentile of the errors where the colour scale ends, as in the reports
UNREADABLE = "has {!r} in its header, expected points with numbers and lists of three points"
ELEMENT = re.compile(r"element (vertex|face) (\d{1,18})")
NUMBER = re.compile(r"property (\w+) (\w+)")
LIST = re.compile(r"property list (uchar|uint8) u?int(32)? vertex_ind(ices|ex)")
NUMBERS = {  # the types of a point's numbers
    name: kind
    for kind, names in {
        "<i1": ("char", "int8"),
        "<u1": ("uchar", "uint8"),
        "<i2": ("short", "int16"),
        "<u2": ("ushort", "uint16"),
        "<i4": ("int", "int32"),
        "<u4": ("uint", "uint32"),
        "<f4": ("float", "float32"),
        "<f8": ("double", "float64"),
    }.items()
    for name in names
}
TRIANGLE = np.dtype([("length", "<u1"), ("corners", "<i4", (3,))])


@dataclass(frozen=True)
class Model:
    """A mesh, cloud or splats of a condition in a dataset.

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
        raise ValueError(f"{folder}: holds no meshes/DATASET/CONDITION.ply, as the models of a run are called")
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
    if kind == "splat" and (missing := sorted(SPLAT - set(points.dtype.names or ()))):
        raise ValueError(f"{path}: its points are no splats: they lack {', '.join(missing)}")
    limit = _error_limit(path, points)
    digest = file_digest(path)
    return Model(path, path.parent.name, path.stem, kind, digest, len(points), len(faces), limit)


def _files(folder: Path) -> Iterator[tuple[Kind, Path]]:
    for kind, name in FOLDERS.items():
        for path in sorted((folder / name).glob("*/*.ply")):
            yield kind, path


def _elements(path: Path) -> tuple[NDArray[np.void], NDArray[np.integer]]:
    """Map the points, and the triangles (M, 3), of a PLY that can be drawn, into memory."""
    n_rows, types, at = _header(path)
    size = path.stat().st_size
    expected = at + sum(count * types[name].itemsize for name, count in n_rows.items())
    if size < expected:
        raise ValueError(f"is no whole PLY file of triangles: it has {size} bytes, its header promises {expected}")
    content, rows = np.asarray(np.memmap(path, np.uint8, "r")), {}
    for name, count in n_rows.items():
        n_bytes = count * types[name].itemsize
        rows[name] = content[at : at + n_bytes].view(types[name]) if n_bytes else np.zeros(count, types[name])
        at += n_bytes
    faces = rows.get("face", np.zeros(0, TRIANGLE))
    faces = faces if faces.dtype == TRIANGLE else np.zeros(0, TRIANGLE)
    if (faces["length"] != 3).any():
        row = int(np.argmax(faces["length"] != 3))
        raise ValueError(f"is no PLY file of triangles: face {row} has {faces['length'][row]} corners, expected 3")
    if size > expected:
        raise ValueError("goes on after its last element")
    points: NDArray[np.void] = rows.get("vertex", np.zeros(0, np.void))
    if not len(points) or not {"x", "y", "z"} <= set(points.dtype.names or ()):
        raise ValueError("holds no points with x, y and z")
    if not all(np.isfinite(points[axis]).all() for axis in "xyz"):
        raise ValueError("holds coordinates that are not finite numbers")
    corners: NDArray[np.integer] = faces["corners"]
    if corners.size and not 0 <= corners.min() <= corners.max() < len(points):
        raise ValueError("has faces that are no triangles of its points")
    return points, corners


def _header(path: Path) -> tuple[dict[str, int], dict[str, np.dtype[np.void]], int]:
    """Return the number of each element's rows, their type, and the header's bytes."""
    with path.open("rb") as file:
        header, end, _ = file.read(LONGEST_HEADER).partition(b"end_header\n")
    if not end or not header.startswith(b"ply\nformat binary_little_endian 1.0\n"):
        raise ValueError("is no binary little-endian PLY file")
    n_rows: dict[str, int] = {}
    fields: dict[str, list[tuple[str, str]]] = {}
    element = ""
    for line in (" ".join(line.split()) for line in header.decode("ascii", "replace").split("\n")):
        number = NUMBER.fullmatch(line)
        if (started := ELEMENT.fullmatch(line)) and started[1] not in n_rows:
            element = started[1]
            n_rows[element], fields[element] = int(started[2]), []
        elif element == "face" and LIST.fullmatch(line) and not fields[element]:
            fields[element].append(("triangle", ""))
        elif element == "vertex" and number and number[1] in NUMBERS and number[2] not in dict(fields[element]):
            fields[element].append((number[2], NUMBERS[number[1]]))
        elif line.startswith(("element", "property")):
            raise ValueError(UNREADABLE.format(line))
    types = {name: TRIANGLE if name == "face" and rows else np.dtype(rows) for name, rows in fields.items()}
    return n_rows, types, len(header) + len(end)


def _error_limit(path: Path, points: NDArray[np.void]) -> float | None:
    if "error" not in (points.dtype.names or ()):
        return None
    errors = np.abs(points["error"].astype(np.float64))
    if not np.isfinite(errors).all():
        raise ValueError(f"{path}: holds errors that are not finite numbers")
    return float(np.percentile(errors, LIMIT_SHARE))

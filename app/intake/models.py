"""Check a folder of meshes and point clouds to attach to a study, from `reconstudy models` or of anybody's PLY files.

It holds `meshes/DATASET/CONDITION.ply` and `clouds/DATASET/CONDITION.ply`, binary and little endian. Points may have
colours, normals, and `error`, their signed distance to the truth in mm. The content of a file counts, not its name.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from app.files import file_digest

Kind = Literal["mesh", "cloud"]
FOLDERS: dict[Kind, str] = {"mesh": "meshes", "cloud": "clouds"}
LARGEST_BYTES = 256 * 1024 * 1024  # of a model; a browser holds two
LONGEST_HEADER = 8192
LIMIT_SHARE = 95  # percentile of the errors where the colour scale ends, as in the reports
SHORT_NAMES = {
    "char": "int8",
    "uchar": "uint8",
    "short": "int16",
    "ushort": "uint16",
    "int": "int32",
    "uint": "uint32",
    "float": "float32",
    "double": "float64",
}
SCALARS = SHORT_NAMES | {name: name for name in SHORT_NAMES.values()}
TRIANGLE = np.dtype([("count", "u1"), ("index", "<i4", (3,))])
FACE_LISTS = tuple(f"property list {count} {kind} vertex_ind{end}" for count in ("uchar", "uint8")
                   for kind in ("int", "uint", "int32", "uint32") for end in ("ices", "ex"))  # fmt: skip


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
    """Does the folder look like a folder of models?"""
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
    content = path.read_bytes()
    try:
        points, faces = _elements(content)
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


def _elements(content: bytes) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return points and triangles of a PLY file, checked for completeness and finite numbers."""
    head, separator, _ = content[:LONGEST_HEADER].partition(b"end_header\n")
    if not separator or not head.startswith(b"ply\nformat binary_little_endian 1.0\n"):
        raise ValueError("is no binary little-endian PLY file")
    kind, n_points, n_faces = _described(head.decode("ascii", "replace").splitlines()[2:])
    start, size = len(head) + len(separator), n_points * kind.itemsize + n_faces * TRIANGLE.itemsize
    if len(content) != start + size:
        raise ValueError(f"has {len(content) - start} bytes after its header, expected {size}")
    points = np.frombuffer(content, kind, n_points, start)
    faces = np.frombuffer(content, TRIANGLE, n_faces, start + points.nbytes)
    if not all(np.isfinite(points[axis]).all() for axis in "xyz"):
        raise ValueError("holds coordinates that are not finite numbers")
    index = faces["index"]
    if (faces["count"] != 3).any() or (index.size and not 0 <= index.min() <= index.max() < n_points):
        raise ValueError("has faces that are no triangles of its points")
    return points, faces


def _described(lines: list[str]) -> tuple[np.dtype[np.void], int, int]:
    """Return the data type of a point, the number of points, and the number of triangles from a header."""
    counts, fields, element = {"vertex": 0, "face": 0}, [], ""
    for line in (line.strip() for line in lines if not line.startswith(("comment", "obj_info"))):
        words = line.split()
        if words[:1] == ["element"] and len(words) == 3 and words[1] in counts and words[2].isdigit():
            element, counts[words[1]] = words[1], int(words[2])
        elif element == "vertex" and len(words) == 3 and words[0] == "property" and words[1] in SCALARS:
            fields.append((words[2], SCALARS[words[1]]))
        elif not (element == "face" and line in FACE_LISTS):
            raise ValueError(f"has {line[:80]!r} in its header, expected points with numbers and lists of three points")
    if not counts["vertex"] or not {"x", "y", "z"} <= {name for name, _ in fields}:
        raise ValueError("holds no points with x, y and z")
    return np.dtype(fields).newbyteorder("<"), counts["vertex"], counts["face"]


def _error_limit(path: Path, points: NDArray[np.void]) -> float | None:
    if "error" not in (points.dtype.names or ()):
        return None
    errors = np.abs(points["error"].astype(np.float64))
    if not np.isfinite(errors).all():
        raise ValueError(f"{path}: holds errors that are not finite numbers")
    return float(np.percentile(errors, LIMIT_SHARE))

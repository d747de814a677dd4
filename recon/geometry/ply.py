"""PLY, the file format of clouds and meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.ply_elements import Elements, Lists, read_elements
from recon.geometry.polygons import cut_polygons
from recon.runtime.files import naming, refused, why_no_file

FLOAT_NORMAL = ("nx", "ny", "nz")
UINT8_COLOUR = ("red", "green", "blue")
FACE_LISTS = ("vertex_indices", "vertex_index")
STRIPS = "tristrips"  # Stanford's form of triangles


def ply_bytes(columns: Mapping[str, NDArray[Any]], faces: NDArray[np.integer] | None = None) -> bytes:
    """Encode points, and triangles where there are any, as binary little-endian PLY.

    Parameters
    ----------
    columns : uint8 or floating (N,) each, by the property's name; floating ones are written as float32
    faces : integer (M, 3); None for a file without the element `face`
    """
    kinds = [(name, "|u1" if values.dtype == np.uint8 else "<f4") for name, values in columns.items()]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(next(iter(columns.values())))}"]
    header += [f"property {'uchar' if kind == '|u1' else 'float'} {name}" for name, kind in kinds]
    content = np.rec.fromarrays(list(columns.values()), dtype=kinds).tobytes()
    if faces is not None:
        table = np.empty(len(faces), [("length", "|u1"), ("vertex_indices", "<i4", (3,))])
        table["length"], table["vertex_indices"] = 3, faces
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        content += table.tobytes()
    return "\n".join([*header, "end_header", ""]).encode("ascii") + content


def vector_columns(names: Sequence[str], vectors: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the columns of vectors (N, 3) by name."""
    return dict(zip(names, vectors.T, strict=True))


def read_ply(path: Path) -> Elements:
    """Read the elements of a PLY file that holds points.

    Raises
    ------
    ValueError
        If the file is missing, damaged or without points.
    """
    if not path.is_file():
        raise ValueError(f"{path}: {why_no_file(path)}")
    try:
        ply = read_elements(path)
    except OSError as error:
        raise refused(path, error) from error
    except ValueError as error:
        advice = "" if path.suffix.lower() == ".ply" else "; save it as PLY"
        raise ValueError(f"{path}: is not a whole PLY file: {error}{advice}") from error
    if not ply.n_rows("vertex"):
        raise ValueError(f"{path}: holds no points")
    return ply


def number_columns(ply: Elements, element: str, names: Sequence[str]) -> NDArray[Any]:
    """Copy properties of an element's rows into an array (N, P).

    Parameters
    ----------
    ply : from `read_ply`
    element : `vertex` or `face`
    names : of P properties

    Raises
    ------
    ValueError
        If one of the properties has lists.
    """
    columns = [ply.columns(element)[name] for name in names]
    numbers = [column for column in columns if not isinstance(column, Lists)]
    if len(numbers) < len(columns):
        owners = "points" if element == "vertex" else "faces"
        raise ValueError(f"its {owners} have lists where numbers are expected: {', '.join(names)}")
    return np.column_stack(numbers)


def point_columns(path: Path, ply: Elements, names: Sequence[str]) -> NDArray[Any]:
    """Copy properties of the points into an array (N, P).

    Parameters
    ----------
    path : of the file, for messages
    ply : from `read_ply`
    names : of P properties

    Raises
    ------
    ValueError
        If the points lack one of the properties, or have lists in its place.
    """
    missing = [name for name in names if name not in ply.columns("vertex")]
    if missing:
        raise ValueError(f"{path}: its points have no {', '.join(missing)}")
    with naming(path):
        return number_columns(ply, "vertex", names)


def optional_columns(path: Path, ply: Elements, *choices: Sequence[str]) -> NDArray[Any] | None:
    """Copy the properties by the first of these names that are all there, (N, P); None where no choice is."""
    chosen = next((names for names in choices if all(name in ply.columns("vertex") for name in names)), None)
    return None if chosen is None else point_columns(path, ply, chosen)


def face_corners(ply: Elements) -> Lists | None:
    """Return the corners of faces; None where there are no faces.

    A ValueError says that there are triangles in another form: without them, a mesh would be taken for a cloud.
    """
    if ply.n_rows(STRIPS) and ply.n_rows("face"):
        raise ValueError(f"it has faces and strips of triangles ({STRIPS}), expected either; save it with faces")
    if not (ply.n_rows(STRIPS) or ply.n_rows("face")):
        return None
    columns = ply.columns(STRIPS if ply.n_rows(STRIPS) else "face")
    corners = next((columns[name] for name in FACE_LISTS if name in columns), None)
    if not isinstance(corners, Lists):
        raise ValueError(
            f"its faces have {', '.join(columns) or 'nothing'}, expected {' or '.join(FACE_LISTS)} with lists"
        )
    if ply.n_rows(STRIPS):
        return _of_strips(corners)
    if corners.lengths.min() < 3:
        face = int(corners.lengths.argmin())
        raise ValueError(f"face {face} has {corners.lengths[face]} corners, expected at least 3")
    return corners


def _of_strips(strips: Lists) -> Lists:
    """Return the triangles of strips, each of which ends at its row's end or at -1; every second one is turned."""
    places = np.arange(len(strips.values))
    is_end = strips.values < 0
    begins = np.concatenate([np.cumsum(strips.lengths) - strips.lengths, places[is_end] + 1])
    starts = np.zeros(len(places) + 1, np.int64)
    starts[begins] = begins
    within = places - np.maximum.accumulate(starts)[:-1]  # 0 at the first corner of each strip
    last = np.flatnonzero((within >= 2) & ~is_end)
    odd = within[last] % 2
    corners = strips.values[np.stack([last - 2, last - 1 + odd, last - odd], axis=1)]
    has_area = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    return Lists(corners[has_area].ravel(), np.full(int(has_area.sum()), 3, np.int64))


def triangles(path: Path, ply: Elements) -> NDArray[np.integer]:
    """Copy the triangles (M, 3), into which other polygons are cut.

    Raises
    ------
    ValueError
        If there are no faces, or one with less than three corners.
    """
    corners = face_corners(ply)
    if corners is None:
        raise ValueError(f"{path}: holds no faces")
    places, _ = cut_polygons(point_columns(path, ply, "xyz"), corners.values, corners.lengths)
    return corners.values[places]

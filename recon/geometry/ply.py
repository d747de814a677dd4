"""PLY, the file format of clouds and meshes.

plyfile reads the files: a binary mesh of one million vertices and two million triangles in 0.06 s, a tenth of that as
text in 1.8 s. It also makes the headers of the files that we write, but not their content, because it writes triangles
one by one: two million take it 3 s, `ndarray.tobytes` 0.1 s.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement, PlyParseError

from recon.storage.files import refused, why_no_file

FLOAT_NORMAL = ("nx", "ny", "nz")
UINT8_COLOUR = ("red", "green", "blue")
FACE_LISTS = ("vertex_indices", "vertex_index")
STRIPS = "tristrips"  # Stanford's form of triangles
TRIANGLES = {"face": dict.fromkeys(FACE_LISTS, 3)}  # lists of known length can be mapped into memory
LONGEST_HEADER = 64 * 1024  # bytes; plyfile reads headers letter by letter
END_OF_HEADER = b"end_header"


def ply_bytes(columns: Mapping[str, NDArray[Any]], faces: NDArray[np.integer] | None = None) -> bytes:
    """Encode points, and triangles where there are any, as binary little-endian PLY.

    Parameters
    ----------
    columns : uint8 or floating (N,) each, by the property's name; floating ones are written as float32
    faces : integer (M, 3); None for a file without the element `face`
    """
    kinds = [(name, "|u1" if values.dtype == np.uint8 else "<f4") for name, values in columns.items()]
    vertices = np.rec.fromarrays(list(columns.values()), dtype=kinds)
    elements, content = [PlyElement.describe(vertices, "vertex")], vertices.tobytes()
    if faces is not None:
        corners: tuple[str, str, tuple[int]] = ("vertex_indices", "<i4", (3,))
        table = np.empty(len(faces), [("length", "|u1"), corners])
        table["length"], table["vertex_indices"] = 3, faces
        elements.append(PlyElement.describe(np.broadcast_to(np.zeros(1, [corners]), len(faces)), "face"))
        content += table.tobytes()
    header: str = PlyData(elements, byte_order="<").header
    return f"{header}\n".encode("ascii") + content


def vector_columns(names: Sequence[str], vectors: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the columns of vectors (N, 3) by name."""
    return dict(zip(names, vectors.T, strict=True))


def read_ply(path: Path) -> PlyData:
    """Read the elements of a PLY file that holds points.

    Raises
    ------
    ValueError
        If the file is missing, damaged or without points.
    """
    if not path.is_file():
        raise ValueError(f"{path}: {why_no_file(path)}")
    try:
        ply = _parsed(path)
    except OSError as error:
        raise refused(path, error) from error
    except Exception as error:  # numpy's own errors come through where values do not fit a property
        advice = "" if path.suffix.lower() == ".ply" else "; save it as PLY"
        raise ValueError(f"{path}: is not a whole PLY file: {str(error) or type(error).__name__}{advice}") from error
    if "vertex" not in ply or not ply["vertex"].count:
        raise ValueError(f"{path}: holds no points")
    return ply


def point_columns(path: Path, ply: PlyData, names: Sequence[str]) -> NDArray[Any]:
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
    missing = [name for name in names if name not in ply["vertex"]]
    if missing:
        raise ValueError(f"{path}: its points have no {', '.join(missing)}")
    columns = np.column_stack([ply["vertex"][name] for name in names])
    if columns.dtype == object:
        raise ValueError(f"{path}: its points have lists where numbers are expected: {', '.join(names)}")
    return columns


def optional_columns(path: Path, ply: PlyData, *choices: Sequence[str]) -> NDArray[Any] | None:
    """Copy the properties by the first of these names that are all there, (N, P); None where no choice is."""
    chosen = next((names for names in choices if all(name in ply["vertex"] for name in names)), None)
    return None if chosen is None else point_columns(path, ply, chosen)


def face_list(ply: PlyData) -> str | None:
    """Return the name of the property that holds the corners of faces; None where there are no faces.

    A ValueError says that there are triangles in another form: without them, a mesh would be taken for a cloud.
    """
    if STRIPS in ply and ply[STRIPS].count:
        raise ValueError(f"its triangles are strips ({STRIPS}), which are not read; save it with faces")
    if "face" not in ply or not ply["face"].count:
        return None
    name = next((name for name in FACE_LISTS if name in ply["face"]), None)
    if name is None:
        properties = ", ".join(each.name for each in ply["face"].properties)
        raise ValueError(f"its faces have {properties or 'nothing'}, expected {' or '.join(FACE_LISTS)}")
    return name


def triangles(path: Path, ply: PlyData) -> NDArray[np.integer]:
    """Copy the triangles (M, 3).

    Raises
    ------
    ValueError
        If there are no faces, or faces with more or fewer than three corners.
    """
    name = face_list(ply)
    if name is None:
        raise ValueError(f"{path}: holds no faces")
    corners = ply["face"][name]
    if corners.dtype == object:  # a text file's, or one with lists of other lengths beside
        if any(np.shape(face) != (3,) for face in corners):
            raise ValueError(f"{path}: its faces are no triangles throughout")
        corners = np.stack(corners)
    return np.array(corners)


def _parsed(path: Path) -> PlyData:
    """Parse a file whose header promises no more rows than it has bytes, so that no memory is taken for them."""
    with path.open("rb") as file:
        header, end, _ = file.read(LONGEST_HEADER).partition(END_OF_HEADER)
        if not end:
            raise ValueError(f"there is no end_header in its first {LONGEST_HEADER} bytes")
        size = path.stat().st_size
        for count in re.findall(rb"[\r\n]\s*element\s+\S+\s+(-?\d+)", header):
            if not 0 <= int(count) <= size:
                raise ValueError(f"its header promises {int(count)} rows, but the file has only {size} bytes")
        file.seek(0)
        if not header.isascii():
            return _parsed_as_ascii(file.read())
        if re.search(rb"[\r\n]\s*format\s+ascii", header):
            return PlyData.read(path)
        try:
            ply = PlyData.read(file, known_list_len=TRIANGLES)
        except PlyParseError as error:
            if "unexpected list length" not in str(error):
                raise
            file.seek(0)
            ply = PlyData.read(file)  # row by row, as there are other polygons
        if file.read(1):
            raise ValueError("it goes on after its last element")
        return ply


def _parsed_as_ascii(content: bytes) -> PlyData:
    """Parse a copy of a file without the letters in its comments that plyfile refuses."""
    header, _, rows = content.partition(END_OF_HEADER)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "ascii.ply"
        copy.write_bytes(header.decode("latin-1").encode("ascii", "replace") + END_OF_HEADER + rows)
        return _parsed(copy)

"""Clouds of scanners: PCD by Open3D, LAS and LAZ by laspy, E57 by pye57, which read what their files announce.

What a file announces is held against its bytes first, and against what was read afterwards, as Open3D answers a damaged
file with an empty cloud.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.models.part import NEUTRAL, Contents, cloud_part, colours_from
from recon.runtime.backend import open3d

HEADER_BYTES = 4096
PCD_KEYS = ("FIELDS", "SIZE", "TYPE", "COUNT", "POINTS", "DATA")
NUMBER = "[1-9][0-9]{0,15}", "a whole number from 1"
PCD_VALUES = {  # what Open3D believes, and would read memory by
    "SIZE": ("[1248]", "1, 2, 4 or 8"),
    "TYPE": ("[FUI]", "F, U or I"),
    "COUNT": ("[1-9][0-9]{0,3}", "a whole number from 1 to 9999"),
    "WIDTH": NUMBER,
    "HEIGHT": NUMBER,
    "POINTS": NUMBER,
    "DATA": ("ascii|binary|binary_compressed", "ascii, binary or binary_compressed"),
}
SHORTEST_LINE = 6  # bytes of a point as text
MOST_PACKED = 264  # times that LZF can shrink
LAS_HEADER, SHORTEST_RECORD = 375, 54  # bytes
UNREADABLE = (RuntimeError, ValueError, LookupError, TypeError, OverflowError, EOFError, MemoryError, struct.error)
POINTS_A_BYTE = 8  # of LAZ and E57 at their best, far beyond that of any scan


def read_pcd_model(path: Path) -> Contents:
    """Read the points of a PCD file of any kind of data, with normals and colours where it has them.

    Raises
    ------
    ValueError
        If the file is missing or damaged, or has no x, y, z.
    """
    n_points, library = _announced_pcd(path), open3d()
    with library.utility.VerbosityContextManager(library.utility.VerbosityLevel.Error):
        cloud = library.io.read_point_cloud(path, format="pcd")
    points = np.asarray(cloud.points)
    if len(points) != n_points:
        raise ValueError(f"announces {n_points} points, {len(points)} could be read; it is damaged")
    normals = np.asarray(cloud.normals) if cloud.has_normals() else None
    colours = colours_from(np.asarray(cloud.colors)) if cloud.has_colors() else None
    return _cloud(path, points, normals, colours)


def _announced_pcd(path: Path) -> int:
    """Return how many points a PCD's header announces, if its bytes can hold them."""
    with path.open("rb") as file:
        head = file.read(HEADER_BYTES)
    header: dict[str, list[str]] = {}
    place = 0
    while "DATA" not in header:
        line, end, _ = head[place:].partition(b"\n")
        if not end:
            raise ValueError("is no PCD: its header has no line DATA")
        place += len(line) + 1
        keyword, *words = line.decode("ascii", "replace").split() or [""]
        header[keyword] = words
    header.setdefault("COUNT", ["1"] * len(header.get("FIELDS", ())))
    header.setdefault("WIDTH", header.get("POINTS", []))
    header.setdefault("HEIGHT", ["1"])
    if any(key not in header for key in PCD_KEYS) or not {"x", "y", "z"} <= {*header["FIELDS"]}:
        raise ValueError(f"is no PCD of points: its header lacks {', '.join(PCD_KEYS)}, or x, y, z among its fields")
    for key, (form, expected) in PCD_VALUES.items():
        n = len(header["FIELDS"]) if key in ("SIZE", "TYPE", "COUNT") else 1
        if len(header[key]) != n or not all(re.fullmatch(form, value) for value in header[key]):
            each = f"{n} values, each {expected}" if n > 1 else expected
            raise ValueError(f"its header has {key} {' '.join(header[key])[:80]}, expected {each}")
    n_points, body = int(header["POINTS"][0]), path.stat().st_size - place
    if int(header["WIDTH"][0]) * int(header["HEIGHT"][0]) != n_points:
        raise ValueError(f"announces {n_points} points, but its WIDTH and HEIGHT do not")
    stride = sum(int(size) * int(count) for size, count in zip(header["SIZE"], header["COUNT"], strict=True))
    kind = header["DATA"][0]
    needed = {"ascii": n_points * SHORTEST_LINE, "binary": n_points * stride}.get(kind, n_points * stride / MOST_PACKED)
    if needed > body + 1:
        raise ValueError(f"announces {n_points} points, more than its {body} bytes of data can hold; is it cut off?")
    return n_points


def read_las_model(path: Path) -> Contents:
    """Read the points of a LAS or LAZ file, in its own unit, with colours where it has them.

    Raises
    ------
    ValueError
        If the file is missing or damaged, or laspy is not installed.
    """
    laspy = _library("laspy", "LAS and LAZ")
    _check_records(path)
    try:
        with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as file:
            _check_announced(path, file.header.point_count)
            if file.header.are_points_compressed:
                _check_chunks(path, int(file.header.offset_to_point_data))
            las = file.read()
        points = np.column_stack([las.x, las.y, las.z]).astype(np.float64)
        has_colours = {"red", "green", "blue"} <= {*las.point_format.dimension_names}
        values = np.column_stack([las.red, las.green, las.blue]) if has_colours else np.zeros((0, 3))
    except (laspy.LaspyException, *UNREADABLE) as error:
        raise ValueError(f"is not readable as LAS: {error}") from error
    return _cloud(path, points, None, colours_from(values) if values.any() else None)


def _check_records(path: Path) -> None:
    """Refuse a LAS that announces more variable records than it has bytes: laspy would look for each of them."""
    with path.open("rb") as file:
        head = file.read(LAS_HEADER)
    n_records = int.from_bytes(head[100:104], "little")
    n_records += int.from_bytes(head[243:247], "little") if head[25:26] >= b"\x04" else 0
    if n_records * SHORTEST_RECORD > path.stat().st_size:
        raise ValueError(f"is no whole LAS: it announces {n_records} records, more than its bytes can hold")


def _check_chunks(path: Path, data_at: int) -> None:
    """Refuse a LAZ whose table announces more chunks than it has bytes: reading it would end the process."""
    n_bytes = path.stat().st_size
    with path.open("rb") as file:
        file.seek(data_at)
        table_at = int.from_bytes(file.read(8), "little", signed=True)
        if table_at == -1:  # written to a stream: the place stands at the end
            file.seek(max(n_bytes - 8, 0))
            table_at = int.from_bytes(file.read(8), "little", signed=True)
        file.seek(max(table_at, 0))
        n_chunks = int.from_bytes(file.read(8)[4:], "little")
    if not 0 <= table_at < n_bytes or n_chunks > n_bytes:
        raise ValueError(f"it announces {n_chunks} chunks at byte {table_at}, more than its {n_bytes} bytes can hold")


def read_e57_model(path: Path) -> Contents:
    """Read the points of all scans of an E57 file, each where its pose puts it, metres, with colours where some have.

    Raises
    ------
    ValueError
        If the file is missing or damaged, or pye57 is not installed.
    """
    pye57 = _library("pye57", "E57")
    try:
        file = pye57.E57(str(path))
        numbers = range(file.scan_count)
        _check_announced(path, sum(file.get_header(number).point_count for number in numbers))
        scans = [file.read_scan(number, colors=True, ignore_missing_fields=True) for number in numbers]
    except (pye57.libe57.E57Exception, *UNREADABLE) as error:
        raise ValueError(f"is not readable as E57: {error}") from error
    if not scans:
        raise ValueError("holds no scan")
    points = np.concatenate([_columns(scan, ("cartesianX", "cartesianY", "cartesianZ")) for scan in scans])
    names = ("colorRed", "colorGreen", "colorBlue")
    shades = [colours_from(_columns(scan, names)) if {*names} <= {*scan} else None for scan in scans]
    grey = [np.full((len(scan["cartesianX"]), 3), NEUTRAL, np.uint8) for scan in scans]
    has_colours = any(shade is not None for shade in shades)
    colours = [plain if shade is None else shade for shade, plain in zip(shades, grey, strict=True)]
    contents = _cloud(path, points, None, np.concatenate(colours) if has_colours else None)
    if n_grey := has_colours * sum(shade is None for shade in shades):
        contents.warn(f"has no colours in {n_grey} of {len(scans)} scans, which are shown grey")
    return contents


def _columns(scan: Mapping[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[Any]:
    return np.column_stack([scan[name] for name in names])


def _check_announced(path: Path, n_points: int) -> None:
    n_bytes = path.stat().st_size
    if n_points > POINTS_A_BYTE * n_bytes:
        raise ValueError(f"it announces {n_points} points, more than its {n_bytes} bytes can hold")


def _library(name: str, formats: str) -> Any:
    """Import a library of the extra `recon` when a file asks for it."""
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise ValueError(f"{formats} needs {name}: pip install 'reconstudy[recon]'") from error


def _cloud(
    path: Path, points: NDArray[np.float64], normals: NDArray[np.float64] | None, colours: NDArray[np.uint8] | None
) -> Contents:
    contents = Contents([path])
    contents.parts.append(cloud_part(contents, points, normals, colours))
    return contents

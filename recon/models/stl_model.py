"""Meshes as STL, binary or text, and as OFF with its colours: COFF, NOFF and their like.

trimesh's readers are not used: they cut the concave polygons of OFF wrongly, and leave out its colours.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.polygons import cut_polygons
from recon.models.part import Contents, Part, cloud_part, colours_from, split_corners

END_BYTES = 4096  # in which a text ends, however long its name
HEADER_BYTES = 84  # of a binary STL: 80 of any text, and the number of triangles
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE | re.IGNORECASE)
OFF_KIND = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF")


def read_stl_model(path: Path) -> Contents:
    """Read the triangles of an STL file; corners of the same place become one vertex.

    Raises
    ------
    ValueError
        If the file is missing or damaged.
    """
    content = path.read_bytes()
    n_triangles = int.from_bytes(content[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    end = HEADER_BYTES + TRIANGLE.itemsize * n_triangles
    contents = Contents([path])
    if len(content) != end and content.lstrip()[:5].lower() == b"solid" and (vertices := VERTEX.findall(content)):
        corners = np.array(vertices, dtype=np.float32)
        if b"endsolid" not in content[-END_BYTES:].lower():
            raise ValueError("is cut off: its text does not end with a line endsolid")
    elif len(content) < end or not n_triangles:
        raise ValueError(f"is no whole STL: it has {len(content)} bytes, {n_triangles} triangles need {end}")
    else:
        corners = np.frombuffer(content[:end], TRIANGLE, offset=HEADER_BYTES)["corners"].reshape(-1, 3)
        if len(content) > end:
            contents.warn(f"has {len(content) - end} bytes behind its triangles, left out")
    if not len(corners) or len(corners) % 3:
        raise ValueError(f"has {len(corners)} corners of triangles, expected a multiple of 3")
    places, numbers = np.unique(corners + np.float32(0), axis=0, return_inverse=True)  # there is one 0
    contents.parts.append(Part(places.astype(np.float64), numbers.reshape(-1, 3).astype(np.int64)))
    return contents


def read_off_model(path: Path) -> Contents:
    """Read the polygons, or the points, of an OFF file with the colours of its vertices or faces.

    Raises
    ------
    ValueError
        If the file is missing or damaged, or has coordinates of four numbers.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    rows = [words for words in (line.partition("#")[0].split() for line in text.splitlines()) if words]
    if rows and "BINARY" in rows[0]:
        raise ValueError("is a binary OFF, which is not read; save it as text or as PLY")
    kind = OFF_KIND.fullmatch(rows[0][0]) if rows else None
    if kind is None or kind[4] or kind[5]:
        raise ValueError("is no OFF of three coordinates: it does not begin with OFF, COFF, NOFF or CNOFF")
    first = rows[0][1:] or [*rows, []][1]
    rows = rows[1 if rows[0][1:] else 2 :]
    if len(first) < 2:
        raise ValueError("is cut off before the numbers of its vertices and faces")
    n_vertices, n_faces = int(first[0]), int(first[1])
    if min(n_vertices, n_faces) < 0 or len(rows) < n_vertices + n_faces:
        raise ValueError(f"announces {n_vertices} vertices and {n_faces} faces, {len(rows)} lines follow")
    values = _rows(rows[:n_vertices])
    after = 3 + (3 if kind[3] else 0)
    normals = values[:, 3:6] if kind[3] else None
    has_colours = values.shape[1] >= after + 3 and (kind[2] or not kind[1])  # some programs write C without saying it
    contents = Contents([path])
    colours = _colours(rows[:n_vertices], values[:, after : after + 3], after) if has_colours else None
    if not n_faces:
        contents.parts.append(cloud_part(contents, values[:, :3], normals, colours))
        return contents
    polygons = rows[n_vertices : n_vertices + n_faces]
    counts = np.array([int(words[0]) for words in polygons])
    if counts.min() < 3 or any(len(words) <= count for words, count in zip(polygons, counts, strict=True)):
        raise ValueError("a face has fewer than three corners, or fewer than it says")
    corners = np.array([int(word) for words, n in zip(polygons, counts, strict=True) for word in words[1 : n + 1]])
    places, cut = cut_polygons(values[:, :3], corners, counts)
    part = Part(values[:, :3], corners[places].astype(np.int64), normals, colours)
    shades = [words[count + 1 : count + 4] for words, count in zip(polygons, counts, strict=True)]
    if colours is None and all(len(words) == 3 for words in shades):  # fewer are a place in a table of colours
        part = split_corners(part, cut, _colours(shades, np.array(shades, dtype=np.float64), 0))
    contents.parts.append(part)
    return contents


def _rows(rows: list[list[str]]) -> NDArray[np.float64]:
    if len({len(words) for words in rows}) != 1 or len(rows[0]) < 3:
        raise ValueError("its vertices have different numbers of values, expected x y z with normals or colours alike")
    return np.array(rows, dtype=np.float64)


def _colours(rows: list[list[str]], values: NDArray[np.float64], place: int) -> NDArray[np.uint8]:
    """Return colours (N, 3): whole numbers are bytes, others from 0 to 1, as the files of Geomview."""
    is_whole = all(word.lstrip("-").isdecimal() for words in rows for word in words[place : place + 3])
    if is_whole and values.min() >= 0 and values.max() <= 255:  # 1 of a byte is no white
        return values.astype(np.uint8)
    return colours_from(values)

"""Models as Wavefront OBJ with MTL: vertex colours, several materials, textures, polygons, negative indices.

trimesh's reader (5.2) is not used, because it goes on in silence where an MTL file or a texture is missing.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.ply_elements import are_numbers, numbers_of
from recon.geometry.polygons import cut_polygons
from recon.models.part import NEUTRAL, Contents, Part, cloud_part, colours_from, decode_picture
from recon.runtime.files import why_no_file

OPTIONS = re.compile(r"-(\w+)((?:\s+(?:on|off|-?[\d.]+(?:e-?\d+)?))*)\s+")  # before the file's name in `map_Kd`
WORD_OPTIONS = re.compile(r"-(type|imfchan|colorspace)\s+\S+\s+")  # likewise, with a word each
FORMS = {  # of the corners of faces, all alike, with how many numbers a corner has; `++` never looks back
    re.compile(rf"(?:\s*+{corner})++\s*+"): n_numbers
    for corner, n_numbers in (
        (r"-?\d++", 1),
        (r"-?\d++/-?\d++", 2),
        (r"-?\d++//-?\d++", 3),
        (r"-?\d++/-?\d++/-?\d++", 3),
    )
}
MOVES = ("s", "o", "t")  # options with numbers that change where a texture is
POSITION, POSITION_AND_COLOUR = 3, 6  # numbers of a vertex
BLOCK = 100_000  # lines of faces that are taken apart at once
OPAQUE = "has transparent materials, which are shown opaque"


@dataclass
class _Material:
    """What an MTL file says of a material: its texture, else its colour, sRGB 0 to 1."""

    colour: tuple[float, ...] | None = None
    picture: NDArray[np.uint8] | None = None
    scale: NDArray[np.float64] = field(default_factory=lambda: np.ones(2))  # of places on it, before they are moved
    shift: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))


@dataclass
class _Faces:
    """Lines of faces in a row, of one material, with how many elements of each kind stand before them."""

    material: str
    before: tuple[int, int, int]
    lines: list[str] = field(default_factory=list)


@dataclass
class _Lines:
    """The lines of an OBJ file by their keyword."""

    vertices: list[str] = field(default_factory=list)
    places: list[str] = field(default_factory=list)
    normals: list[str] = field(default_factory=list)
    faces: list[_Faces] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)


def read_obj_model(path: Path) -> Contents:
    """Read the model of an OBJ file; one without faces is a cloud.

    Raises
    ------
    ValueError
        If the file is missing or damaged, or an MTL file, a material or a texture that it names is missing.
    """
    if not path.is_file():
        raise ValueError(why_no_file(path))
    lines = _lines(path)
    contents = Contents([path])
    libraries = [name for names in lines.libraries for name in _library_names(path.parent, names)]
    materials = _materials(contents, libraries, {faces.material for faces in lines.faces})
    vertices, colours = _vertices(lines.vertices, contents)
    positions = vertices[:, :3]
    if not lines.faces:
        contents.parts.append(cloud_part(contents, positions, None, colours))
        return contents
    _finite(vertices, lines.vertices, "v")
    places = _finite(_numbers(lines.places, "vt", (1, 2, 3)), lines.places, "vt")
    normals = _finite(_numbers(lines.normals, "vn", (3,)), lines.normals, "vn")
    for name in dict.fromkeys(faces.material for faces in lines.faces):
        if name and libraries and name not in materials:
            contents.warn(f"uses the material {name!r}, which {', '.join(libraries)} does not define")
        material = materials.get(name, _Material())
        corners, counts = _corners(
            [faces for faces in lines.faces if faces.material == name], (len(vertices), len(places), len(normals))
        )
        if material.picture is None:
            corners[:, 1] = -1  # so that a seam does not part its vertices
        vertex, used = _merged(corners)
        triangles = vertex[cut_polygons(positions[used[:, 0]], vertex, counts)[0]]
        has_places, has_normals = bool((used[:, 1] >= 0).all()), bool((used[:, 2] >= 0).all())
        part = Part(positions[used[:, 0]], triangles, normals[used[:, 2]] if has_normals else None)
        if material.picture is None:
            contents.parts.append(replace(part, colours=_shades(material, colours, used[:, 0])))
        elif not has_places:
            raise ValueError(f"faces of its textured material {name!r} have no texture coordinates (vt)")
        else:
            uv = places[used[:, 1], :2] * material.scale + material.shift
            contents.parts.append(replace(part, uv=uv, picture=material.picture))
    return contents


def _library_names(folder: Path, names: str) -> list[str]:
    """Return the files that a line `mtllib` names: several between spaces, or one whose name holds some."""
    is_there = {name: (folder / name.replace("\\", "/")).is_file() for name in (names, *names.split())}
    return names.split() if any(is_there.values()) and not is_there[names] else [names]


def _vertices(lines: Sequence[str], contents: Contents) -> tuple[NDArray[np.float64], NDArray[np.uint8] | None]:
    """Return vertices (N, 3 or more) and their colours; those of a file that has some are grey where they lack one."""
    has_colour = np.array([len(line.split()) == POSITION_AND_COLOUR for line in lines], bool)
    is_short = np.array([len(line.split()) == POSITION for line in lines], bool)
    if not (has_colour.any() and is_short.any() and (has_colour | is_short).all()):
        vertices = _numbers(lines, "v", (3, 4, 6, 7, 8))
        if vertices.shape[1] < POSITION_AND_COLOUR:
            return vertices, None
        first = _first_of_colour(vertices)
        return vertices, colours_from(vertices[:, first : first + 3])
    contents.warn(f"has no colour at {np.count_nonzero(is_short)} of {len(lines)} vertices, which are shown grey")
    coloured = _numbers([line for line, kept in zip(lines, has_colour, strict=True) if kept], "v", (6,))
    plain = _numbers([line for line, kept in zip(lines, is_short, strict=True) if kept], "v", (3,))
    vertices, colours = np.zeros((len(lines), POSITION)), np.full((len(lines), 3), NEUTRAL, np.uint8)
    vertices[has_colour], vertices[is_short] = coloured[:, :POSITION], plain
    colours[has_colour] = colours_from(coloured[:, POSITION:])
    return vertices, colours


def _first_of_colour(vertices: NDArray[np.float64]) -> int:
    """Return where colours begin: behind x, y, z, or behind a weight, of which there are eight numbers, or it is 1."""
    width, has_one = vertices.shape[1], bool((vertices[:, 3] == 1).all())
    is_weighted = width == POSITION_AND_COLOUR + 1 and has_one and bool((vertices[:, 6] != 1).any())
    return POSITION + int(is_weighted or width > POSITION_AND_COLOUR + 1)


def _shades(
    material: _Material, colours: NDArray[np.uint8] | None, used: NDArray[np.int64]
) -> NDArray[np.uint8] | None:
    """Return the colours of the vertices used, uint8 (N, 3): the file's own, else the material's, else None."""
    if colours is not None:
        return colours[used]
    if material.colour is None:
        return None
    return np.tile(colours_from(np.array([material.colour])), (len(used), 1))


def _lines(path: Path) -> _Lines:
    lines = _Lines()
    material, faces, begun = "", None, ""
    by_keyword = {"v": lines.vertices, "vt": lines.places, "vn": lines.normals}
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for line in file:
            text = begun + line.strip()
            if text.endswith("\\") and not text.startswith("#"):  # goes on in the next line; a note may name a folder
                begun = text[:-1] + " "
                continue
            begun = ""
            keyword, rest = (*text.split(None, 1), "", "")[:2]  # by spaces or tabs
            numbers = rest.partition("#")[0]  # a note may follow them; names may hold this sign
            if keyword == "f":
                if faces is None:
                    faces = _Faces(material, (len(lines.vertices), len(lines.places), len(lines.normals)))
                    lines.faces.append(faces)
                faces.lines.append(numbers)
            elif keyword in by_keyword:
                by_keyword[keyword].append(numbers)
                faces = None
            elif keyword == "usemtl":
                material, faces = rest.strip(), None
            elif keyword == "mtllib":
                lines.libraries.append(rest.strip())
    return lines


def _numbers(lines: Sequence[str], keyword: str, n_columns: Sequence[int]) -> NDArray[np.float64]:
    """Return the numbers (N, C) of the lines of a keyword, which all have as many as the first, or say which is wrong.

    Parameters
    ----------
    lines : without the keyword
    keyword : for the message
    n_columns : how many numbers a line may have
    """
    if not lines:
        return np.zeros((0, max(n_columns[0], 2)))
    width = len(lines[0].split())
    values = numbers_of(" ".join(lines))
    if width not in n_columns or len(values) != width * len(lines) or not _are_alike(lines, width):
        for number, line in enumerate(lines, 1):
            if len(line.split()) != width or width not in n_columns or not are_numbers(line):
                expected = " or ".join(map(str, n_columns)) if number == 1 else str(width)
                raise ValueError(f"its {keyword} number {number} is {line!r:.60}, expected {expected} numbers")
        raise ValueError(f"its {keyword} lines are not readable as numbers")
    table = values.reshape(-1, width)
    return table if width > 1 else np.column_stack([table, np.zeros(len(table))])


def _finite(table: NDArray[np.float64], lines: Sequence[str], keyword: str) -> NDArray[np.float64]:
    """Return the numbers of the lines of a keyword, or say which are not finite."""
    is_finite = np.isfinite(table).all(axis=1)
    if not is_finite.all():
        wrong = int(np.argmin(is_finite))
        raise ValueError(f"its {keyword} number {wrong + 1} is {lines[wrong]!r:.60}, expected finite numbers")
    return table


def _are_alike(lines: Sequence[str], width: int) -> bool:
    return all(len(line.split()) == width for line in lines)


def _corners(faces: Sequence[_Faces], n_elements: tuple[int, int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return corners of polygons, int64 (K, 3): vertex, place and normal from 0, -1 for none; and their counts (P,).

    Parameters
    ----------
    faces : lines of a material
    n_elements : how many vertices, places and normals the file has
    """
    parts, counts = [], []
    for run in faces:
        for start in range(0, len(run.lines), BLOCK):
            lines = run.lines[start : start + BLOCK]
            indices = _indices(lines)
            counts.append(np.array([len(line.split()) for line in lines]))
            from_zero = np.where(indices < 0, indices + np.array(run.before), indices - 1)
            is_none = (indices == 0) & np.array([False, True, True])
            wrong = ~is_none & ((from_zero < 0) | (from_zero >= np.array(n_elements)))
            if wrong.any():
                corner = " ".join(lines).split()[int(np.flatnonzero(wrong.any(axis=1))[0])]
                raise ValueError(
                    f"the face corner {corner!r} is out of range: the file has {n_elements[0]} vertices, "
                    f"{n_elements[1]} texture coordinates and {n_elements[2]} normals, counted from 1"
                )
            parts.append(np.where(is_none, -1, from_zero))
    n_corners = np.concatenate(counts)
    if n_corners.min() < 3:
        raise ValueError(f"a face has {n_corners.min()} corners, expected at least 3")
    return np.concatenate(parts), n_corners


def _indices(lines: Sequence[str]) -> NDArray[np.int64]:
    """Return vertex, place and normal, int64 (K, 3), of corners such as 3, 3/1, 3//2 or 3/1/2; 0 for none."""
    text = " ".join(lines)
    if (form := next((form for form in FORMS if form.fullmatch(text)), None)) is not None:
        numbers = np.fromstring(text.replace("//", "/0/").replace("/", " "), dtype=np.int64, sep=" ")
        columns = numbers.reshape(-1, FORMS[form])
        return np.pad(columns, ((0, 0), (0, 3 - columns.shape[1])))
    try:
        rows = [[int(index or 0) for index in (*word.split("/"), "", "")[:3]] for word in text.split()]
        return np.array(rows, dtype=np.int64).reshape(-1, 3)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"its faces are not readable: {error}") from error


def _merged(corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Make a vertex of each different corner; returns the vertex (K,) of each and the corners (N, 3) that are left.

    Parameters
    ----------
    corners : int64 (K, 3), as `_corners` returns them
    """
    size = corners.max(axis=0) + 2
    key = ((corners[:, 0] + 1) * size[1] + corners[:, 1] + 1) * size[2] + corners[:, 2] + 1
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return inverse, corners[first]


def _materials(contents: Contents, libraries: Sequence[str], used: Collection[str]) -> dict[str, _Material]:
    """Read MTL files, and the textures of the materials that faces use."""
    materials: dict[str, _Material] = {}

    @cache  # many materials may share a picture
    def decoded(path: Path) -> NDArray[np.uint8]:
        return decode_picture(contents.beside(str(path), "texture"), str(path))

    for library in libraries:
        folder = Path(library.replace("\\", "/")).parent
        text = contents.beside(library, "material file").decode("utf-8-sig", "replace")
        name, current = "", _Material()
        for line in text.splitlines():
            keyword, rest = (*line.split(None, 1), "", "")[:2]  # by spaces or tabs
            rest = rest.strip()
            if keyword.lower() == "newmtl":
                name, current = rest, materials.setdefault(rest, _Material())
            elif keyword.lower() == "kd" and rest:
                current.colour = _colour(rest, library)
            elif keyword.lower() == "map_kd" and rest and name in used:
                current.picture = decoded(folder / _picture_name(rest, current))
            elif keyword == "map_d" or (keyword == "d" and _last(rest) < 1) or (keyword == "Tr" and _last(rest) > 0):
                contents.warn(OPAQUE)
    return materials


def _colour(text: str, library: str) -> tuple[float, ...]:
    try:
        red, green, blue = (float(value) for value in text.split()[:3])
    except ValueError as error:
        raise ValueError(
            f"Kd in its material file {library} is {text!r}, expected three numbers from 0 to 1"
        ) from error
    return tuple(min(max(value, 0.0), 1.0) for value in (red, green, blue))


def _picture_name(text: str, material: _Material) -> str:
    """Return the file's name behind the options of `map_Kd`, of which the material gets scale and shift."""
    name = text
    while option := WORD_OPTIONS.match(name) or OPTIONS.match(name):
        numbers = option[2].split() if option[1] in MOVES else []
        if option[1] == "t" and any(map(float, numbers)):
            raise ValueError(f"its texture is stirred by {option[0].strip()!r}, which is not read; bake it")
        moved = {"s": material.scale, "o": material.shift}.get(option[1], np.zeros(2))
        moved[: len(numbers)] = numbers[:2]
        name = name[option.end() :]
    return name.strip('"').replace("\\", "/")


def _last(text: str) -> float:
    """Return the number that a line ends in; NaN where it ends in none."""
    try:
        return float(text.split()[-1])
    except (IndexError, ValueError):
        return float("nan")

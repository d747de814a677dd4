"""A model of any format as what the renderer draws: one mesh, discs or splats, in the world in millimetres."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Discs, Mesh, Model, check_resolved, stacked_faces
from recon.geometry.mesh_files import read_mesh
from recon.geometry.normals import UPWARDS, surface_normals, unit_normals
from recon.geometry.packed import PACKED
from recon.geometry.rig import transformed
from recon.models.atlas import one_texture
from recon.models.gltf.model import VertexColours, read_gltf_model
from recon.models.obj_model import read_obj_model
from recon.models.part import NEUTRAL, Contents, Part
from recon.models.ply_model import read_ply_model
from recon.models.scans import read_e57_model, read_las_model, read_pcd_model
from recon.models.splats.read import SPLAT_READERS, holds_splats, read_with_warnings
from recon.models.stl_model import read_off_model, read_stl_model
from recon.runtime.artefacts import file_digest
from recon.runtime.files import naming, refused, why_no_file

Reader = Callable[[Path, VertexColours | None], Contents]
GLTF_SUFFIXES = (".glb", ".gltf")


def _sure(read: Callable[[Path], Contents]) -> Reader:
    """Return the reader of a format that leaves nobody in doubt of what its colours are."""
    return lambda path, _colours: read(path)


def _read_packed_model(path: Path) -> Contents:
    mesh = read_mesh(path)
    uv, picture = (None, None) if mesh.texture is None else (mesh.texture.uv, mesh.texture.pixels)
    part = Part(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64), mesh.normals, mesh.colours, uv, picture)
    return Contents([path], [part])


READERS: dict[str, Reader] = {
    ".ply": _sure(read_ply_model),
    ".obj": _sure(read_obj_model),
    ".glb": read_gltf_model,
    ".gltf": read_gltf_model,
    ".stl": _sure(read_stl_model),
    ".off": _sure(read_off_model),
    ".pcd": _sure(read_pcd_model),
    ".las": _sure(read_las_model),
    ".laz": _sure(read_las_model),
    ".e57": _sure(read_e57_model),
    PACKED: _sure(_read_packed_model),
}
MODEL_SUFFIXES = tuple(dict.fromkeys([*READERS, *SPLAT_READERS]))
MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Placement:
    """How a model comes into the world.

    Parameters
    ----------
    unit : of the file, a name in `MM`, as it is said to be
    world_from_model : 4x4, to mm, y up: a rotation with one scale, and a translation
    splat_mm : radius of the discs that a point cloud is drawn by, mm; None where none is stated
    antialiased : whether splats were trained so, which few files say
    vertex_colours : what those of glTF files are, where it is not linear light; None where nobody says
    """

    unit: str
    world_from_model: Matrix
    splat_mm: float | None = None
    antialiased: bool = False
    vertex_colours: VertexColours | None = None


@dataclass(frozen=True, eq=False)
class ReadModel:
    """A model with its origin.

    Parameters
    ----------
    model : in the world
    digest : SHA-256 over all files that it was read from
    warnings : what is not shown as the file has it, a clause each that follows the model's name
    n_bytes : of all files that it was read from
    """

    model: Model
    digest: str
    warnings: tuple[str, ...]
    n_bytes: int = 0


def read_model(path: Path, placement: Placement) -> ReadModel:
    """Read a model in one of the formats of `MODEL_SUFFIXES`.

    Parameters
    ----------
    path : of its file; textures and materials are read from beside it
    placement : where it stands

    Raises
    ------
    ValueError
        If a file is missing or damaged, or there is nothing that can be drawn; the message begins with the path.
    """
    if holds_splats(path):
        return _placed_splats(path, placement)
    contents = read_contents(path, placement.vertex_colours)
    with naming(path):
        parts = [part for part in contents.parts if len(part.faces)]
        if parts:
            if len(parts) < len(contents.parts):
                contents.warn("has points beside its faces, which are not shown")
            model: Model = _mesh([_placed(part, placement) for part in parts], contents)
        else:
            clouds = [_placed(part, placement) for part in contents.parts if len(part.vertices)]
            model = _discs(clouds, contents, placement.splat_mm)
    return ReadModel(model, _digest(contents.files), tuple(contents.warnings), _size(contents.files))


def _placed_splats(path: Path, placement: Placement) -> ReadModel:
    splats, warnings = read_with_warnings(path)
    moved = splats.moved(np.array(placement.world_from_model))
    moved = replace(moved, antialiased=splats.antialiased or placement.antialiased)
    return ReadModel(moved, _digest([path]), warnings, _size([path]))


def read_contents(path: Path, vertex_colours: VertexColours | None = None) -> Contents:
    """Read what a model's file holds, in its own unit and axes.

    Parameters
    ----------
    path : of the file
    vertex_colours : of glTF, see `read_gltf_model`

    Raises
    ------
    ValueError
        If a file is missing or damaged; the message begins with the path.
    """
    try:
        if not path.is_file():
            raise ValueError(why_no_file(path))
        if path.suffix.lower() not in READERS:
            raise ValueError(f"ends in {path.suffix or 'nothing'!r}, expected one of {', '.join(READERS)}")
        return READERS[path.suffix.lower()](path, vertex_colours)
    except OSError as error:
        raise refused(path, error) from error
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from error


def _mesh(parts: list[Part], contents: Contents) -> Mesh:
    if any(part.colours is None and part.picture is None for part in parts):
        contents.warn("has no colours and is shown in neutral grey")
    parts = [_coloured(part) for part in parts]
    vertices = _vertices(parts)
    faces = stacked_faces([part.faces for part in parts], [len(part.vertices) for part in parts])
    colours = np.concatenate([_shades(part) for part in parts])
    texture = one_texture(parts)
    normals = surface_normals(vertices, faces)
    if all(part.normals is not None for part in parts):
        normals = unit_normals(np.concatenate([part.normals for part in parts if part.normals is not None]), normals)
    return Mesh(vertices.astype(np.float32), faces, normals, colours, texture)


def _discs(parts: list[Part], contents: Contents, radius_mm: float | None) -> Discs:
    if not parts:
        raise ValueError("holds neither faces nor points")
    if radius_mm is None:
        raise ValueError(
            "has points and no faces; state the radius to draw points by in scene.json, for example "
            '"splat_mm": 3, or add the faces'
        )
    if any(part.colours is None for part in parts):
        contents.warn("has no colours and is shown in neutral grey")
    parts = [_coloured(part) for part in parts]
    vertices = _vertices(parts)
    normals = np.tile(np.array(UPWARDS, np.float32), (len(vertices), 1))  # all are lit alike
    if all(part.normals is not None for part in parts):
        normals = unit_normals(np.concatenate([part.normals for part in parts if part.normals is not None]), normals)
    return Discs(Cloud(vertices.astype(np.float32), normals, np.concatenate([_shades(p) for p in parts])), radius_mm)


def _vertices(parts: list[Part]) -> NDArray[np.float64]:
    """Return the vertices of all parts (N, 3), mm, if they stay what they are in single precision."""
    vertices = np.concatenate([part.vertices for part in parts])
    try:
        check_resolved(vertices)
    except ValueError as error:
        raise ValueError(f"{error}, for example by world_from_model in scene.json") from error
    return vertices


def _placed(part: Part, placement: Placement) -> Part:
    """Bring a part into the world, and leave out vertices that no face names."""
    matrix = np.array(placement.world_from_model)
    if len(part.faces):
        part = _named_vertices(part)
    vertices = transformed(part.vertices, matrix)
    normals = None
    if part.normals is not None:  # one that is no number is computed later
        is_usable = np.isfinite(part.normals).all(axis=1, keepdims=True)
        normals = np.where(is_usable, part.normals, 0).astype(np.float64) @ matrix[:3, :3].T
    return replace(part, vertices=vertices, normals=normals)


def _named_vertices(part: Part) -> Part:
    is_named = np.zeros(len(part.vertices), bool)
    is_named[part.faces] = True
    if is_named.all():
        return part
    number = np.cumsum(is_named) - 1
    return Part(
        part.vertices[is_named],
        number[part.faces],
        None if part.normals is None else part.normals[is_named],
        None if part.colours is None else part.colours[is_named],
        None if part.uv is None else part.uv[is_named],
        part.picture,
    )


def _coloured(part: Part) -> Part:
    """Colour a part that has neither colours nor a picture."""
    if part.colours is not None or part.picture is not None:
        return part
    return replace(part, colours=np.full((len(part.vertices), 3), NEUTRAL, np.uint8))


def _shades(part: Part) -> NDArray[np.uint8]:
    """Return the vertices' colours, uint8 (N, 3); grey under a texture, which is shown instead."""
    return np.full((len(part.vertices), 3), NEUTRAL, np.uint8) if part.colours is None else part.colours


def _size(files: list[Path]) -> int:
    """Return the bytes of all files."""
    return sum(file.stat().st_size for file in files)


def _digest(files: list[Path]) -> str:
    """Return the SHA-256 over files by their names and contents."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(f"{file.name}\0{file_digest(file)}\n".encode())
    return digest.hexdigest()

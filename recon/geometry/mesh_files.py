"""Read and write clouds and meshes: PLY, GLB, OBJ and packed ones."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.glb import glb_bytes, png_of, read_glb
from recon.geometry.mesh import Cloud, Mesh, Shape, face_indices, finite_rows
from recon.geometry.normals import are_unit, unit_normals
from recon.geometry.obj import mtl_text, obj_text
from recon.geometry.packed import FILLED, PACKED, packed_bytes, read_packed
from recon.geometry.ply import (
    FLOAT_NORMAL,
    UINT8_COLOUR,
    face_corners,
    optional_columns,
    ply_bytes,
    point_columns,
    read_ply,
    triangles,
    vector_columns,
)
from recon.runtime.files import check_suffix, naming, why_no_file, write_bytes


def write_cloud(path: Path, cloud: Cloud) -> Path:
    """Write a cloud as binary PLY (little endian), whole or not at all; the same cloud gives the same bytes.

    Raises
    ------
    ValueError
        If the cloud is empty or the name does not end in .ply.
    """
    check_suffix(path, (".ply",))
    if not len(cloud):
        raise ValueError(f"{path}: the cloud is empty, nothing to write")
    sigma = {} if cloud.sigma is None else {"sigma": cloud.sigma}
    return write_bytes(path, ply_bytes(_oriented(cloud.points, cloud.normals, cloud.colours) | sigma))


def write_no_cloud(path: Path) -> Path:
    """Write the PLY of a cloud without points, which `read_cloud` refuses: ask `holds_points` first."""
    check_suffix(path, (".ply",))
    return write_bytes(path, _no_cloud())


def no_cloud_digest() -> str:
    """Return the SHA-256, hexadecimal, of the file that `write_no_cloud` writes."""
    return sha256(_no_cloud()).hexdigest()


def holds_points(path: Path) -> bool:
    """Tell a PLY with points from one that `write_no_cloud` wrote."""
    return path.stat().st_size != len(_no_cloud()) or path.read_bytes() != _no_cloud()


def write_mesh(path: Path, mesh: Mesh) -> Path:
    """Write a mesh as binary PLY, GLB or packed, a textured one not as PLY but OBJ; the same mesh gives the same bytes.

    Every file is whole or absent. Vertices where a hole was filled carry a 1 as `filled`, in GLB as `_FILLED`; OBJ
    cannot say so. Beside a.obj come its material a.mtl and its picture a.png.

    Convention
    ----------
    PLY and OBJ keep millimetres and sRGB bytes. GLB, as glTF 2.0 wants it, is scaled to metres by its node and holds
    linear colours in 16 bits, from which the sRGB bytes come back exactly, or a PNG; its material is unlit, because
    the studio's light is already in the colours.

    Raises
    ------
    ValueError
        If the mesh has no face, or the name ends in none of .ply, .glb, .obj and .parquet, or the format cannot hold
        its colours.
    """
    check_suffix(path, (".ply", ".glb", ".obj", PACKED))
    if not len(mesh.faces):
        raise ValueError(f"{path}: the mesh has no face, nothing to write")
    if path.suffix.lower() == ".obj":
        return _write_obj(path, mesh)
    if path.suffix.lower() == ".glb":
        return write_bytes(path, glb_bytes(mesh))
    if path.suffix.lower() == PACKED:
        return write_bytes(path, packed_bytes(mesh))
    _check_no_texture(path, mesh)
    filled = {} if mesh.filled is None else {FILLED: mesh.filled.astype(np.uint8)}
    return write_bytes(path, ply_bytes(_oriented(mesh.vertices, mesh.normals, mesh.colours) | filled, mesh.faces))


def write_measured(path: Path, model: Mesh | Cloud, errors: NDArray[np.floating]) -> Path:
    """Write a mesh or cloud as binary PLY whose points carry their signed error as the property `error`.

    Parameters
    ----------
    path : must end in .ply
    model : of N points
    errors : floating (N,), mm

    Raises
    ------
    ValueError
        If there is no point, the mesh has a texture, or the name does not end in .ply.
    """
    if isinstance(model, Mesh):
        _check_no_texture(path, model)
    points, faces = (model.vertices, model.faces) if isinstance(model, Mesh) else (model.points, None)
    _check_points(path, points)
    return write_bytes(path, ply_bytes(_oriented(points, model.normals, model.colours) | {"error": errors}, faces))


def write_coloured(
    path: Path, points: NDArray[np.floating], faces: NDArray[np.integer], colours: NDArray[np.uint8]
) -> Path:
    """Write coloured points, and triangles where there are any, as binary PLY to look at.

    Parameters
    ----------
    path : must end in .ply
    points : floating (N, 3), mm
    faces : integer (M, 3); M is 0 for a cloud
    colours : uint8 (N, 3), sRGB

    Raises
    ------
    ValueError
        If there is no point or the name does not end in .ply.
    """
    _check_points(path, points)
    columns = vector_columns("xyz", points) | vector_columns(UINT8_COLOUR, colours)
    return write_bytes(path, ply_bytes(columns, faces if len(faces) else None))


def read_cloud(path: Path) -> Cloud:
    """Read a PLY of coloured, oriented points; normals by other programs get unit length, but for those of length 0.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, or points lack normals or colours.
    """
    ply = read_ply(path)
    with naming(path):
        sigma = point_columns(path, ply, ("sigma",))[:, 0] if "sigma" in ply.columns("vertex") else None
        points, normals, colours = (point_columns(path, ply, names) for names in ("xyz", FLOAT_NORMAL, UINT8_COLOUR))
        return Cloud(points, normals if are_unit(normals) else unit_normals(normals, normals), colours, sigma)


def read_mesh(path: Path) -> Mesh:
    """Read a PLY of coloured triangles, or a GLB or packed mesh of ours.

    Vertices stay as they are, coincident ones included; below a texture, they have the colours of their texels.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, vertices lack normals or
        colours, or faces are missing or no triangles.
    """
    if path.suffix.lower() in (".glb", PACKED):
        with naming(path):
            if not path.is_file():
                raise ValueError(why_no_file(path))
            return read_packed(path) if path.suffix.lower() == PACKED else read_glb(path.read_bytes())
    ply = read_ply(path)
    with naming(path):
        points, normals, colours = (point_columns(path, ply, names) for names in ("xyz", FLOAT_NORMAL, UINT8_COLOUR))
        filled = point_columns(path, ply, (FILLED,))[:, 0] > 0 if FILLED in ply.columns("vertex") else None
        return Mesh(points, face_indices(triangles(path, ply), len(points)), normals, colours, filled=filled)


def read_points(path: Path) -> NDArray[np.float32]:
    """Read the points (N, 3), mm, of any PLY, whatever else it holds.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, or a coordinate is not a number.
    """
    ply = read_ply(path)
    with naming(path):
        return finite_rows(point_columns(path, ply, "xyz"), "points")


def read_surface(path: Path) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Read the points (N, 3), mm, and triangles (M, 3) of any PLY; M is 0 where the file holds no faces.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, or a face is no triangle.
    """
    shape = read_ply_shape(path)
    return shape.points.astype(np.float32), shape.faces


def read_ply_shape(path: Path) -> Shape:
    """Read the points of any PLY, float32, with triangles, normals and colours where it has them.

    Normals that are all 0, which programs write that know none, and colours that are no bytes, whose range nobody
    states, are left out.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, or a face is no triangle.
    """
    ply = read_ply(path)
    with naming(path):
        points = finite_rows(point_columns(path, ply, "xyz"), "points")
        faces = np.zeros((0, 3), np.int32)
        if face_corners(ply) is not None:
            faces = face_indices(triangles(path, ply), len(points))
        normals, colours = (optional_columns(path, ply, names) for names in (FLOAT_NORMAL, UINT8_COLOUR))
    has_normals, has_colours = normals is not None and normals.any(), colours is not None and colours.dtype == np.uint8
    return Shape(points, faces, normals if has_normals else None, colours if has_colours else None)


def _check_points(path: Path, points: NDArray[np.floating]) -> None:
    check_suffix(path, (".ply",))
    if not len(points):
        raise ValueError(f"{path}: there is no point, nothing to write")


def _check_no_texture(path: Path, mesh: Mesh) -> None:
    if mesh.texture is not None:
        raise ValueError(f"{path}: the mesh has a texture, which PLY cannot hold; write it as .glb or .obj")


def _no_cloud() -> bytes:
    points = np.empty((0, 3), np.float32)
    return ply_bytes(_oriented(points, points, points.astype(np.uint8)))


def _oriented(
    points: NDArray[np.float32], normals: NDArray[np.float32], colours: NDArray[np.uint8]
) -> dict[str, NDArray[Any]]:
    return vector_columns("xyz", points) | vector_columns(FLOAT_NORMAL, normals) | vector_columns(UINT8_COLOUR, colours)


def _write_obj(path: Path, mesh: Mesh) -> Path:
    """Write the picture and the material first: an OBJ that exists has both."""
    if mesh.texture is None:
        raise ValueError(f"{path}: OBJ holds colours as a texture, and the mesh has none; write it as .ply or .glb")
    stem = "_".join(path.stem.split())  # many readers end a name at a space
    picture, material = path.with_name(f"{stem}.png"), path.with_name(f"{stem}.mtl")
    write_bytes(picture, png_of(mesh.texture))
    write_bytes(material, mtl_text(picture.name).encode())
    text = obj_text(mesh.vertices, mesh.faces, mesh.normals, mesh.texture.uv, material.name)
    return write_bytes(path, text.encode())

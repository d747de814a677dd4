"""Clouds and meshes, what moves between cloud, surface and render, and their one reader and writer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.geometry.glb import glb_bytes
from recon.geometry.ply import (
    UINT8_COLOUR,
    columns,
    face_bytes,
    face_table,
    oriented_colours,
    ply_header,
    read_elements,
    vertex_table,
)
from recon.storage.files import whole_file

RED, BLUE, GREY = np.array([178, 24, 43]), np.array([33, 102, 172]), 128  # ends of ColorBrewer's RdBu


@dataclass(frozen=True, eq=False)
class Cloud:
    """Coloured, oriented points in the world frame.

    Parameters
    ----------
    points : float32 (N, 3), mm
    normals : float32 (N, 3), unit length, outwards (towards the sensor that saw the point)
    colours : uint8 (N, 3), sRGB
    sigma : float32 (N,), mm, standard deviation of each point along its line of sight; None where unknown

    Raises
    ------
    ValueError
        If the arrays differ in length, a coordinate or normal is not finite, or a sigma is not positive.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
    sigma: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        points = _finite(self.points, "points")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", _finite(self.normals, "normals", len(points)))
        object.__setattr__(self, "colours", _colours(self.colours, len(points)))
        if self.sigma is not None:
            sigma = np.ascontiguousarray(self.sigma, dtype=np.float32)
            if sigma.shape != (len(points),) or not (np.isfinite(sigma) & (sigma > 0)).all():
                raise ValueError(
                    f"sigma has shape {sigma.shape}, expected ({len(points)},) finite positive lengths in mm"
                )
            object.__setattr__(self, "sigma", sigma)

    def __len__(self) -> int:
        return len(self.points)

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.integer]) -> Cloud:
        """The points that a mask (N,) or indices (M,) choose."""
        sigma = None if self.sigma is None else self.sigma[chosen]
        return Cloud(self.points[chosen], self.normals[chosen], self.colours[chosen], sigma)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the world frame with a colour on every vertex.

    Parameters
    ----------
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3), counter-clockwise seen from outside
    normals : float32 (N, 3), unit length, outwards
    colours : uint8 (N, 3), sRGB

    Raises
    ------
    ValueError
        If the arrays differ in length, a coordinate or normal is not finite, or a face names a vertex that
        does not exist.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]

    def __post_init__(self) -> None:
        vertices = _finite(self.vertices, "vertices")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "normals", _finite(self.normals, "normals", len(vertices)))
        object.__setattr__(self, "colours", _colours(self.colours, len(vertices)))
        object.__setattr__(self, "faces", _faces(self.faces, len(vertices)))


def merge_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """All meshes as one: the union of their vertices and faces, in the order given.

    Raises
    ------
    ValueError
        If there is no mesh.
    """
    if not meshes:
        raise ValueError("merging needs at least one mesh, found none")
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.colours for mesh in meshes]),
    )


def error_colours(errors: NDArray[np.floating], limit: float) -> NDArray[np.uint8]:
    """Colours (N, 3) for signed errors (N,): blue at -limit and below, white at 0, red at limit and above.

    Where the error is NaN the colour is a mid grey.

    Raises
    ------
    ValueError
        If the limit is not positive.
    """
    if not limit > 0:
        raise ValueError(f"limit is {limit}, expected an error above 0")
    share = np.clip(np.asarray(errors, dtype=np.float64) / limit, -1, 1)[:, None]
    colours = 255 + np.maximum(share, 0) * (RED - 255.0) + np.maximum(-share, 0) * (BLUE - 255.0)
    return np.asarray(np.where(np.isnan(share), GREY, np.rint(colours)), dtype=np.uint8)


def write_cloud(path: Path, cloud: Cloud) -> Path:
    """Write a cloud as binary PLY (little endian), whole or not at all; the same cloud gives the same bytes.

    Raises
    ------
    ValueError
        If the cloud is empty or the name does not end in .ply.
    """
    _check_suffix(path, (".ply",))
    if not len(cloud):
        raise ValueError(f"{path}: the cloud is empty, nothing to write")
    more = {} if cloud.sigma is None else {"sigma": cloud.sigma}
    vertices = vertex_table(cloud.points, cloud.normals, cloud.colours, more)
    with whole_file(path) as temporary:
        temporary.write_bytes(ply_header(vertices) + vertices.tobytes())
    return path


def write_no_cloud(path: Path) -> Path:
    """Write the PLY of a cloud without points, which no reader takes for a cloud: ask `holds_points` first."""
    _check_suffix(path, (".ply",))
    with whole_file(path) as temporary:
        temporary.write_bytes(_no_cloud())
    return path


def no_cloud_digest() -> str:
    """SHA-256 of what `write_no_cloud` writes, hexadecimal."""
    return sha256(_no_cloud()).hexdigest()


def holds_points(path: Path) -> bool:
    """Whether a PLY is anything else than what `write_no_cloud` wrote."""
    return path.stat().st_size != len(_no_cloud()) or path.read_bytes() != _no_cloud()


def write_mesh(path: Path, mesh: Mesh) -> Path:
    """Write a mesh as binary PLY or as GLB, whole or not at all; the same mesh gives the same bytes.

    Convention
    ----------
    PLY keeps millimetres and sRGB bytes. GLB, as glTF 2.0 wants it, is scaled to metres by its node and holds
    linear colours in 16 bits, from which the sRGB bytes come back exactly; its material is unlit, because the
    studio's light is already in the colours.

    Raises
    ------
    ValueError
        If the mesh has no face or the name ends neither in .ply nor in .glb.
    """
    _check_suffix(path, (".ply", ".glb"))
    if not len(mesh.faces):
        raise ValueError(f"{path}: the mesh has no face, nothing to write")
    content = (
        glb_bytes(mesh.vertices, mesh.faces, mesh.normals, mesh.colours)
        if path.suffix.lower() == ".glb"
        else _ply_mesh(mesh)
    )
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
    return path


def write_measured(path: Path, model: Mesh | Cloud, errors: NDArray[np.floating]) -> Path:
    """Write a mesh or cloud as binary PLY whose points carry their signed error (N,), mm, as the property `error`.

    Raises
    ------
    ValueError
        If there is no point, or the name does not end in .ply.
    """
    _check_suffix(path, (".ply",))
    points, faces = (model.vertices, model.faces) if isinstance(model, Mesh) else (model.points, None)
    if not len(points):
        raise ValueError(f"{path}: there is no point, nothing to write")
    table = vertex_table(points, model.normals, model.colours, {"error": errors})
    content = ply_header(table, None if faces is None else len(faces)) + table.tobytes()
    with whole_file(path) as temporary:
        temporary.write_bytes(content if faces is None else content + face_bytes(faces))
    return path


def write_coloured(
    path: Path, points: NDArray[np.floating], faces: NDArray[np.integer], colours: NDArray[np.uint8]
) -> Path:
    """Write points (N, 3) with colours (N, 3), and triangles (M, 3) where there are any, as binary PLY to look at.

    Raises
    ------
    ValueError
        If there is no point or the name does not end in .ply.
    """
    _check_suffix(path, (".ply",))
    if not len(points):
        raise ValueError(f"{path}: there is no point, nothing to write")
    table = np.empty(len(points), np.dtype([(n, "<f4") for n in "xyz"] + [(n, "|u1") for n in UINT8_COLOUR]))
    for axis in range(3):
        table["xyz"[axis]] = points[:, axis]
        table[UINT8_COLOUR[axis]] = colours[:, axis]
    content = ply_header(table, len(faces) or None) + table.tobytes() + face_bytes(faces)
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
    return path


def read_cloud(path: Path) -> Cloud:
    """Read a PLY of coloured, oriented points.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, or points lack normals or colours.
    """
    elements = read_elements(path)
    try:
        sigma = columns(path, elements, ("sigma",))[:, 0] if "sigma" in elements["vertex"]["properties"] else None
        return Cloud(*oriented_colours(path, elements), sigma)
    except ValueError as error:
        raise _named(path, error) from error


def read_mesh(path: Path) -> Mesh:
    """Read a PLY of coloured triangles; vertices stay as they are in the file, coincident ones included.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, vertices lack normals or
        colours, or faces are missing or no triangles.
    """
    elements = read_elements(path)
    try:
        points, normals, colours = oriented_colours(path, elements)
        return Mesh(points, _faces(face_table(path, elements), len(points)), normals, colours)
    except ValueError as error:
        raise _named(path, error) from error


def read_points(path: Path) -> NDArray[np.float32]:
    """Read only the points (N, 3) of any PLY, whatever else it holds.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, or a coordinate is not a number.
    """
    try:
        return _finite(columns(path, read_elements(path), ("x", "y", "z")), "points")
    except ValueError as error:
        raise _named(path, error) from error


def read_surface(path: Path) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Read only the points (N, 3) and triangles (M, 3) of any PLY; M is 0 where the file holds no faces.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, or a face is no triangle.
    """
    try:
        elements = read_elements(path)
        points = _finite(columns(path, elements, ("x", "y", "z")), "points")
        if not elements.get("face", {}).get("length"):
            return points, np.zeros((0, 3), np.int32)
        return points, _faces(face_table(path, elements), len(points))
    except ValueError as error:
        raise _named(path, error) from error


def _finite(values: ArrayLike, name: str, length: int | None = None) -> NDArray[np.float32]:
    array = np.ascontiguousarray(values, dtype=np.float32)
    if array.ndim != 2 or array.shape[1] != 3 or (length is not None and len(array) != length):
        raise ValueError(f"{name} have shape {array.shape}, expected ({'N' if length is None else length}, 3)")
    if not np.isfinite(array).all():
        row = int(np.argmin(np.isfinite(array).all(axis=1)))
        raise ValueError(f"{name} hold values that are not finite numbers: row {row} is {array[row].tolist()}")
    return array


def _colours(values: ArrayLike, length: int) -> NDArray[np.uint8]:
    array = np.asarray(values)
    if array.shape != (length, 3) or array.dtype != np.uint8:
        raise ValueError(f"colours are {array.dtype} {array.shape}, expected uint8 ({length}, 3) in sRGB")
    return np.ascontiguousarray(array)


def _faces(values: ArrayLike, n_vertices: int) -> NDArray[np.int32]:
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"faces are {array.dtype} {array.shape}, expected integers (M, 3)")
    if array.size and (array.min() < 0 or array.max() >= n_vertices):
        raise ValueError(f"faces name vertices {array.min()} to {array.max()}, but there are {n_vertices}")
    return np.ascontiguousarray(array, dtype=np.int32)


def _check_suffix(path: Path, suffixes: tuple[str, ...]) -> None:
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{path}: unknown kind of file, expected a name that ends in {' or '.join(suffixes)}")


def _no_cloud() -> bytes:
    points = np.empty((0, 3), np.float32)
    return ply_header(vertex_table(points, points, points.astype(np.uint8)))


def _ply_mesh(mesh: Mesh) -> bytes:
    vertices = vertex_table(mesh.vertices, mesh.normals, mesh.colours)
    return ply_header(vertices, len(mesh.faces)) + vertices.tobytes() + face_bytes(mesh.faces)


def _named(path: Path, error: ValueError) -> ValueError:
    return error if str(error).startswith(str(path)) else ValueError(f"{path}: {error}")

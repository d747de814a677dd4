"""Clouds and meshes, which travel from depth maps over surfaces to pictures, and their only reader and writer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.geometry.glb import glb_bytes, textured_glb_bytes
from recon.geometry.obj import mtl_text, obj_text
from recon.geometry.ply import (
    FLOAT_NORMAL,
    UINT8_COLOUR,
    ply_bytes,
    point_columns,
    read_ply,
    triangles,
    vector_columns,
)
from recon.storage.files import whole_file

RED, BLUE, GREY = np.array([178, 24, 43]), np.array([33, 102, 172]), 128  # ends of ColorBrewer's RdBu
LIMIT_SHARE = 95  # percentile of the errors that gets the full colour
LEAST_LIMIT_MM = 1e-3  # the rounding errors of an exact surface stay white


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
        """Choose points by a mask (N,) or by indices (M,)."""
        sigma = None if self.sigma is None else self.sigma[chosen]
        return Cloud(self.points[chosen], self.normals[chosen], self.colours[chosen], sigma)


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture that colours a mesh.

    Parameters
    ----------
    pixels : uint8 (H, W, 3), sRGB
    uv : float32 (N, 2), place of each vertex in the picture: (0, 0) is its lower left corner, (1, 1) its upper right
        one, as in OBJ; beyond them the picture repeats

    Raises
    ------
    ValueError
        If an array has another type or shape, or a place is not finite.
    """

    pixels: NDArray[np.uint8]
    uv: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.pixels.dtype != np.uint8 or self.pixels.ndim != 3 or self.pixels.shape[2] != 3 or not self.pixels.size:
            raise ValueError(f"pixels are {self.pixels.dtype} {self.pixels.shape}, expected uint8 (H, W, 3) in sRGB")
        object.__setattr__(self, "uv", _finite(self.uv, "uv", columns=2))


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the world frame with a colour on every vertex, or a texture.

    Parameters
    ----------
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3), counter-clockwise seen from outside
    normals : float32 (N, 3), unit length, outwards
    colours : uint8 (N, 3), sRGB
    texture : of the same N vertices, shown instead of their colours; None for none

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
    texture: Texture | None = None

    def __post_init__(self) -> None:
        vertices = _finite(self.vertices, "vertices")
        if self.texture is not None and len(self.texture.uv) != len(vertices):
            raise ValueError(f"the texture has places for {len(self.texture.uv)} vertices, expected {len(vertices)}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "normals", _finite(self.normals, "normals", len(vertices)))
        object.__setattr__(self, "colours", _colours(self.colours, len(vertices)))
        object.__setattr__(self, "faces", _faces(self.faces, len(vertices)))


@dataclass(frozen=True, eq=False)
class Splats:
    """A cloud to be drawn as it is: every point a round disc.

    Parameters
    ----------
    cloud : the points
    radius_mm : of the discs, mm

    Raises
    ------
    ValueError
        If the radius is not positive and finite.
    """

    cloud: Cloud
    radius_mm: float

    def __post_init__(self) -> None:
        if not 0 < self.radius_mm < float("inf"):
            raise ValueError(f"radius_mm is {self.radius_mm}, expected a length above 0")


Model = Mesh | Splats  # what can be filmed


def merge_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Join meshes into one: the union of their vertices and faces, in the order given.

    Raises
    ------
    ValueError
        If there is no mesh, or one has a texture: the merged mesh could show only one of them.
    """
    if not meshes:
        raise ValueError("merging needs at least one mesh, found none")
    textured = [number for number, mesh in enumerate(meshes, 1) if mesh.texture is not None]
    if textured:
        raise ValueError(f"mesh {textured[0]} of {len(meshes)} has a texture; only meshes without can be merged")
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.colours for mesh in meshes]),
    )


def error_colours(errors: NDArray[np.floating], limit: float) -> NDArray[np.uint8]:
    """Colour signed errors (N,), uint8 (N, 3): blue at -limit and below, white at 0, red at limit, mid grey at NaN.

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


def error_limit(errors: NDArray[np.floating]) -> float:
    """Choose the error that gets the full colour, mm: 95 % of the errors (N,), mm, are nearer to 0."""
    return max(float(np.percentile(np.abs(errors), LIMIT_SHARE)), LEAST_LIMIT_MM)


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
    sigma = {} if cloud.sigma is None else {"sigma": cloud.sigma}
    return _write(path, ply_bytes(_oriented(cloud.points, cloud.normals, cloud.colours) | sigma))


def write_no_cloud(path: Path) -> Path:
    """Write the PLY of a cloud without points, which `read_cloud` refuses: ask `holds_points` first."""
    _check_suffix(path, (".ply",))
    return _write(path, _no_cloud())


def no_cloud_digest() -> str:
    """SHA-256, hexadecimal, of the file that `write_no_cloud` writes."""
    return sha256(_no_cloud()).hexdigest()


def holds_points(path: Path) -> bool:
    """Tell a PLY with points from one that `write_no_cloud` wrote."""
    return path.stat().st_size != len(_no_cloud()) or path.read_bytes() != _no_cloud()


def write_mesh(path: Path, mesh: Mesh) -> Path:
    """Write a mesh as binary PLY or GLB, a textured one as GLB or OBJ; the same mesh gives the same bytes.

    Every file is whole or absent. Beside a.obj come its material a.mtl and its picture a.png.

    Convention
    ----------
    PLY and OBJ keep millimetres and sRGB bytes. GLB, as glTF 2.0 wants it, is scaled to metres by its node and holds
    linear colours in 16 bits, from which the sRGB bytes come back exactly, or a PNG; its material is unlit, because
    the studio's light is already in the colours.

    Raises
    ------
    ValueError
        If the mesh has no face, or the name does not end in .ply, .glb or .obj, or the format cannot hold its colours.
    """
    _check_suffix(path, (".ply", ".glb", ".obj"))
    if not len(mesh.faces):
        raise ValueError(f"{path}: the mesh has no face, nothing to write")
    if path.suffix.lower() == ".obj":
        return _write_obj(path, mesh)
    if path.suffix.lower() == ".glb":
        return _write(path, _glb_of(mesh))
    _check_no_texture(path, mesh)
    return _write(path, ply_bytes(_oriented(mesh.vertices, mesh.normals, mesh.colours), mesh.faces))


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
    return _write(path, ply_bytes(_oriented(points, model.normals, model.colours) | {"error": errors}, faces))


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
    return _write(path, ply_bytes(columns, faces if len(faces) else None))


def read_cloud(path: Path) -> Cloud:
    """Read a PLY of coloured, oriented points.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, or points lack normals or colours.
    """
    ply = read_ply(path)
    with _named(path):
        sigma = point_columns(path, ply, ("sigma",))[:, 0] if "sigma" in ply["vertex"] else None
        points, normals, colours = (point_columns(path, ply, names) for names in ("xyz", FLOAT_NORMAL, UINT8_COLOUR))
        return Cloud(points, normals, colours, sigma)


def read_mesh(path: Path) -> Mesh:
    """Read a PLY of coloured triangles; vertices stay as they are in the file, coincident ones included.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, vertices lack normals or
        colours, or faces are missing or no triangles.
    """
    ply = read_ply(path)
    with _named(path):
        points, normals, colours = (point_columns(path, ply, names) for names in ("xyz", FLOAT_NORMAL, UINT8_COLOUR))
        return Mesh(points, _faces(triangles(path, ply), len(points)), normals, colours)


def read_points(path: Path) -> NDArray[np.float32]:
    """Read the points (N, 3), mm, of any PLY, whatever else it holds.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, or a coordinate is not a number.
    """
    ply = read_ply(path)
    with _named(path):
        return _finite(point_columns(path, ply, "xyz"), "points")


def read_surface(path: Path) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Read the points (N, 3), mm, and triangles (M, 3) of any PLY; M is 0 where the file holds no faces.

    Raises
    ------
    ValueError
        If the file is missing, empty or damaged, a coordinate is not a number, or a face is no triangle.
    """
    ply = read_ply(path)
    with _named(path):
        points = _finite(point_columns(path, ply, "xyz"), "points")
        if "face" not in ply or not ply["face"].count:
            return points, np.zeros((0, 3), np.int32)
        return points, _faces(triangles(path, ply), len(points))


def _finite(values: ArrayLike, name: str, length: int | None = None, columns: int = 3) -> NDArray[np.float32]:
    array = np.ascontiguousarray(values, dtype=np.float32)
    if array.ndim != 2 or array.shape[1] != columns or (length is not None and len(array) != length):
        raise ValueError(f"{name} have shape {array.shape}, expected ({'N' if length is None else length}, {columns})")
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


def _check_points(path: Path, points: NDArray[np.floating]) -> None:
    _check_suffix(path, (".ply",))
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


def _glb_of(mesh: Mesh) -> bytes:
    if mesh.texture is None:
        return glb_bytes(mesh.vertices, mesh.faces, mesh.normals, mesh.colours)
    return textured_glb_bytes(mesh.vertices, mesh.faces, mesh.normals, mesh.texture.uv, _png(mesh.texture))


def _write_obj(path: Path, mesh: Mesh) -> Path:
    """Write the picture and the material first: an OBJ that exists has both."""
    if mesh.texture is None:
        raise ValueError(f"{path}: OBJ holds colours as a texture, and the mesh has none; write it as .ply or .glb")
    stem = "_".join(path.stem.split())  # many readers end a name at a space
    picture, material = path.with_name(f"{stem}.png"), path.with_name(f"{stem}.mtl")
    _write(picture, _png(mesh.texture))
    _write(material, mtl_text(picture.name).encode())
    text = obj_text(mesh.vertices, mesh.faces, mesh.normals, mesh.texture.uv, material.name)
    return _write(path, text.encode())


def _png(texture: Texture) -> bytes:
    return bytes(cv2.imencode(".png", texture.pixels[..., ::-1])[1].tobytes())


def _write(path: Path, content: bytes) -> Path:
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
    return path


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Begin the sentence of a ValueError with the file's path."""
    try:
        yield
    except ValueError as error:
        raise error if str(error).startswith(str(path)) else ValueError(f"{path}: {error}") from error

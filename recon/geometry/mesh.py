"""Clouds and meshes, which travel from depth maps over surfaces to pictures; `mesh_files` reads and writes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.geometry.splats import Splats

RED, BLUE, GREY = np.array([178, 24, 43]), np.array([33, 102, 172]), 128  # ends of ColorBrewer's RdBu
LIMIT_SHARE = 95  # percentile of the errors that gets the full colour
LEAST_LIMIT_MM = 1e-3  # the rounding errors of an exact surface stay white
FINEST = 4000  # steps of single precision across a shape; with fewer, half a millimetre of a person is lost


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
        points = finite_rows(self.points, "points")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", finite_rows(self.normals, "normals", len(points)))
        object.__setattr__(self, "colours", colour_rows(self.colours, len(points)))
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
        object.__setattr__(self, "uv", finite_rows(self.uv, "uv", columns=2))

    def at_vertices(self) -> NDArray[np.uint8]:
        """Return the texel at each vertex, uint8 (N, 3), sRGB."""
        height, width = self.pixels.shape[:2]
        is_beyond = (self.uv < 0) | (self.uv > 1)
        uv = np.where(is_beyond, self.uv - np.floor(self.uv), self.uv)
        columns, rows = np.floor(uv * (width, -height)).astype(int).T
        return np.asarray(self.pixels[np.clip(rows + height, 0, height - 1), np.clip(columns, 0, width - 1)], np.uint8)


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
    filled : bool (N,), where a hole was filled and nothing measured; None where that is not known. What is made of the
        mesh does not inherit it

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
    filled: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        vertices = finite_rows(self.vertices, "vertices")
        if self.texture is not None and len(self.texture.uv) != len(vertices):
            raise ValueError(f"the texture has places for {len(self.texture.uv)} vertices, expected {len(vertices)}")
        if self.filled is not None and self.filled.shape != (len(vertices),):
            raise ValueError(f"filled has shape {self.filled.shape}, expected ({len(vertices)},)")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "normals", finite_rows(self.normals, "normals", len(vertices)))
        object.__setattr__(self, "colours", colour_rows(self.colours, len(vertices)))
        object.__setattr__(self, "faces", face_indices(self.faces, len(vertices)))


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface to be measured: points, with what a file of any program says of them.

    Parameters
    ----------
    points : floating (N, 3), mm; vertices, or a cloud's points
    faces : int32 (M, 3); M is 0 for a cloud
    normals : floating (N, 3), of any length; None where the file does not give all of them
    colours : uint8 (N, 3), sRGB, of the vertices or of their texels; None where the file does not give all of them
    """

    points: NDArray[np.floating]
    faces: NDArray[np.int32]
    normals: NDArray[np.floating] | None = None
    colours: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Discs:
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


Model = Mesh | Discs | Splats  # what can be filmed


def measured_part(mesh: Mesh) -> Mesh:
    """Leave out the faces of a mesh that lie on filled vertices alone; its vertices stay."""
    if mesh.filled is None:
        return mesh
    return replace(mesh, faces=mesh.faces[~mesh.filled[mesh.faces].all(axis=1)])


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
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        stacked_faces([mesh.faces for mesh in meshes], [len(mesh.vertices) for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.colours for mesh in meshes]),
    )


def stacked_faces(faces: Sequence[NDArray[np.integer]], n_vertices: Sequence[int]) -> NDArray[np.int32]:
    """Number the triangles (M, 3) of several meshes, int32, as those of one that has their vertices in turn."""
    starts = np.cumsum([0, *n_vertices[:-1]])
    return np.concatenate([(part + start).astype(np.int32) for part, start in zip(faces, starts, strict=True)])


def error_colours(errors: NDArray[np.floating], limit: float) -> NDArray[np.uint8]:
    """Colour signed errors (N,), uint8 (N, 3): blue at -limit and below, white at 0, red at limit, mid grey at NaN.

    Raises
    ------
    ValueError
        If the limit is not positive and finite.
    """
    if not 0 < limit < np.inf:
        raise ValueError(f"limit is {limit}, expected an error above 0")
    share = np.clip(np.asarray(errors, dtype=np.float64) / limit, -1, 1)[:, None]
    colours = 255 + np.maximum(share, 0) * (RED - 255.0) + np.maximum(-share, 0) * (BLUE - 255.0)
    return np.asarray(np.where(np.isnan(share), GREY, np.rint(colours)), dtype=np.uint8)


def error_limit(errors: NDArray[np.floating]) -> float:
    """Choose the error that gets the full colour, mm: 95 % of the errors (N,), mm, are nearer to 0."""
    return max(float(np.percentile(np.abs(errors), LIMIT_SHARE)), LEAST_LIMIT_MM)


def finite_rows(values: ArrayLike, name: str, length: int | None = None, columns: int = 3) -> NDArray[np.float32]:
    """Return values as float32 (N, columns), unit unchanged, if they are finite numbers.

    Parameters
    ----------
    values : numbers of any type, (N, columns)
    name : of the values in messages
    length : N where it is known
    columns : how many numbers a row has

    Raises
    ------
    ValueError
        Naming the shape, or the first row that is not finite.
    """
    with np.errstate(over="ignore"):  # infinity is told below
        array = np.ascontiguousarray(values, dtype=np.float32)
    if array.ndim != 2 or array.shape[1] != columns or (length is not None and len(array) != length):
        raise ValueError(f"{name} have shape {array.shape}, expected ({'N' if length is None else length}, {columns})")
    if not np.isfinite(array).all():
        row = int(np.argmin(np.isfinite(array).all(axis=1)))
        raise ValueError(f"{name} hold values that are not finite numbers: row {row} is {array[row].tolist()}")
    return array


def check_resolved(points: NDArray[np.floating], place: str = "") -> None:
    """Raise a ValueError if points (N, 3) lie so far from the origin that float32 blurs the shape they have.

    Parameters
    ----------
    points : floating (N, 3), of any unit
    place : that the message begins with
    """
    size, largest = float(np.linalg.norm(np.ptp(points, axis=0))), float(np.abs(points).max())
    step = float(np.spacing(np.float32(largest)))
    if size > 0 and step * FINEST > size:
        raise ValueError(
            f"{place}its points, {size:.3g} across, lie up to {largest:.3g} from the origin, where single precision "
            f"has steps of {step:.3g}; move them near the origin"
        )


def colour_rows(values: ArrayLike, length: int) -> NDArray[np.uint8]:
    """Return colours as uint8 (length, 3), or raise a ValueError if they have another type or shape."""
    array = np.asarray(values)
    if array.shape != (length, 3) or array.dtype != np.uint8:
        raise ValueError(f"colours are {array.dtype} {array.shape}, expected uint8 ({length}, 3) in sRGB")
    return np.ascontiguousarray(array)


def face_indices(values: ArrayLike, n_vertices: int) -> NDArray[np.int32]:
    """Return triangles as int32 (M, 3), indices of vertices.

    Raises
    ------
    ValueError
        If the shape or type is another, or a face names a vertex that is not there.
    """
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"faces are {array.dtype} {array.shape}, expected integers (M, 3)")
    if array.size and (array.min() < 0 or array.max() >= n_vertices):
        raise ValueError(f"faces name vertices {array.min()} to {array.max()}, but there are {n_vertices}")
    return np.ascontiguousarray(array, dtype=np.int32)

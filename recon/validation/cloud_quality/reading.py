"""Clouds and meshes from files, as points to be compared; meshes are sampled."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData

from recon.geometry.ply import FACE_LISTS, FLOAT_NORMAL, UINT8_COLOUR, point_columns, read_ply, triangles
from recon.models.shape import SHAPE_SUFFIXES, read_model_shape
from recon.validation.cloud_quality.points import PointSet
from recon.validation.clouds import TEXT_SUFFIXES, read_measured
from recon.validation.sampling import spread_over_triangles, triangle_areas

USUAL_POINTS = 100_000  # on a mesh for which no density is given; a figure is then some millimetres between points
MOST_POINTS = 20_000_000  # on a mesh; more would not fit into memory


@dataclass(frozen=True)
class Sampling:
    """How meshes become points.

    Parameters
    ----------
    density : points per squared unit of length; None for what puts `USUAL_POINTS` on each mesh
    seed : of the samples; that of all meshes, so that equal meshes give equal points
    """

    density: float | None = None
    seed: int = 1

    def __post_init__(self) -> None:
        if self.density is not None and not 0 < self.density < float("inf"):
            raise ValueError(f"the density is {self.density:g}, expected a positive number of points per squared unit")


@dataclass(frozen=True, eq=False)
class Shape:
    """What a file holds: points, and triangles (M, 3) between them; M is 0 for a cloud."""

    vertices: PointSet
    faces: NDArray[np.integer]

    @property
    def area(self) -> float:
        """Area of the triangles, in the squared unit of length."""
        return float(triangle_areas(self.vertices.points, self.faces).sum())


def read_shape(path: Path) -> Shape:
    """Read a PLY, an OBJ or glTF (in mm) with textures beside it, or a text file with x, y, z in the first columns.

    Raises
    ------
    ValueError
        If the file cannot be read or is empty, a value is not finite, or a face is not a triangle of its points.
    """
    none = np.zeros((0, 3), np.int32)
    if path.suffix.lower() in TEXT_SUFFIXES:
        return Shape(PointSet(str(path), read_measured(path)), none)
    if path.suffix.lower() in SHAPE_SUFFIXES:
        model = read_model_shape(path)
        return Shape(PointSet(str(path), model.points, model.normals, model.colours), model.faces)
    ply = read_ply(path)
    normals, colours = (_optional(path, ply, names) for names in (FLOAT_NORMAL, UINT8_COLOUR))
    if normals is not None and not normals.any():
        normals = None  # written by a program that knew none
    if colours is not None and colours.dtype != np.uint8:
        colours = None  # floating ones have no stated range
    vertices = PointSet(str(path), point_columns(path, ply, "xyz"), normals, colours)
    has_faces = "face" in ply and ply["face"].count and any(name in ply["face"] for name in FACE_LISTS)
    faces = triangles(path, ply) if has_faces else none
    if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise ValueError(
            f"{path}: its faces name vertices {faces.min()} to {faces.max()}, but there are {len(vertices)}"
        )
    return Shape(vertices, faces)


def sampled(shape: Shape, sampling: Sampling) -> PointSet:
    """Return a cloud's points as they are, a mesh's as spread uniformly over its area.

    Normals and colours are interpolated between the corners; normals have unit length again. A mesh without normals
    gets those of its triangles, by the order of their corners.

    Parameters
    ----------
    shape : as read
    sampling : density and seed

    Raises
    ------
    ValueError
        If the triangles have no area, or the density asks for too many points.
    """
    vertices, faces = shape.vertices, shape.faces
    if not len(faces):
        return vertices
    n = USUAL_POINTS if sampling.density is None else max(1, round(sampling.density * shape.area))
    if n > MOST_POINTS:
        raise ValueError(
            f"{vertices.name}: {sampling.density:g} points per squared unit on an area of {shape.area:.3g} are {n} "
            f"points, expected {MOST_POINTS} at most; choose a lower density"
        )
    try:
        chosen, weights = spread_over_triangles(vertices.points, faces, n, np.random.default_rng(sampling.seed))
    except ValueError as error:
        raise ValueError(f"{vertices.name}: {error}") from error
    corners = faces[chosen]

    def between(values: NDArray[np.generic]) -> NDArray[np.float64]:
        return np.asarray(sum(weights[:, c, None] * values[corners[:, c]] for c in range(3)))

    normals = _face_normals(vertices.points, corners) if vertices.normals is None else between(vertices.normals)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    colours = None if vertices.colours is None else np.rint(between(vertices.colours)).astype(np.uint8)
    points = between(vertices.points).astype(np.float32)
    return PointSet(vertices.name, points, (normals / np.where(lengths > 0, lengths, 1)).astype(np.float32), colours)


def _face_normals(points: NDArray[np.float32], corners: NDArray[np.integer]) -> NDArray[np.float64]:
    a, b, c = (points[corners[:, corner]].astype(np.float64) for corner in range(3))
    return np.asarray(np.cross(b - a, c - a))


def _optional(path: Path, ply: PlyData, names: tuple[str, ...]) -> NDArray[Any] | None:
    """Return properties of the points (N, 3), or None if one is missing."""
    return point_columns(path, ply, names) if all(name in ply["vertex"] for name in names) else None

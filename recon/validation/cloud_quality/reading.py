"""Clouds and meshes from files, as points to be compared; meshes are sampled."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.geometry.mesh import Shape
from recon.geometry.normals import are_unit, area_vectors, unit_normals
from recon.runtime.files import naming
from recon.validation.cloud_quality.points import PointSet
from recon.validation.clouds import read_shape
from recon.validation.sampling import between_corners, spread_over_triangles, triangle_areas

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


def area_of(shape: Shape) -> float:
    """Return the area of the triangles, in the squared unit of length."""
    return float(triangle_areas(shape.points, shape.faces).sum())


def read_point_set(path: Path, sampling: Sampling = Sampling()) -> PointSet:
    """Read a cloud or mesh as points; a ValueError as of `read_shape` and `sampled`."""
    return sampled(read_shape(path), str(path), sampling)


def sampled(shape: Shape, name: str, sampling: Sampling) -> PointSet:
    """Return a cloud's points as they are, or points spread uniformly over the area of a mesh.

    Normals get unit length. On a mesh, they and colours are interpolated between the corners. A mesh without normals
    gets those of its triangles, by the order of their corners.

    Parameters
    ----------
    shape : as read
    name : of its file, for messages
    sampling : density and seed

    Raises
    ------
    ValueError
        If a value is not finite, the triangles have no area, or the density asks for too many points.
    """
    normals, faces = shape.normals, shape.faces
    if normals is not None and not are_unit(normals):
        normals = unit_normals(normals, np.zeros_like(normals))
    vertices = PointSet(name, shape.points, normals, shape.colours)
    if not len(faces):
        return vertices
    n = USUAL_POINTS if sampling.density is None else max(1, round(sampling.density * area_of(shape)))
    if n > MOST_POINTS:
        raise ValueError(
            f"{name}: {sampling.density:g} points per squared unit on an area of {area_of(shape):.3g} are {n} "
            f"points, expected {MOST_POINTS} at most; choose a lower density"
        )
    with naming(name):
        chosen, weights = spread_over_triangles(vertices.points, faces, n, np.random.default_rng(sampling.seed))
    corners = faces[chosen]
    points, normals, colours = vertices.points, vertices.normals, vertices.colours
    directions = area_vectors(points, corners) if normals is None else between_corners(normals, corners, weights)
    if colours is not None:
        colours = np.rint(between_corners(colours, corners, weights)).astype(np.uint8)
    places = between_corners(points, corners, weights).astype(np.float32)
    return PointSet(name, places, unit_normals(directions, np.zeros_like(directions)), colours)

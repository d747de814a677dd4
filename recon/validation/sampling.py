"""Samples of clouds and meshes, evenly drawn or spread; orders and trees to search them; axes of a view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from recon.geometry.normals import area_vectors, vector_sums

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Value = TypeVar("Value", bound=np.generic)

LARGEST_SAMPLE = 30_000  # points that scale and first steps are estimated from
CELLS_A_SIDE = 32  # so that a cell's number fits into 16 bits


def subsample(points: NDArray[Value], seed: int, most: int = LARGEST_SAMPLE) -> NDArray[Value]:
    """Draw at most `most` of the points, one out of each run of equal length.

    Parameters
    ----------
    points : (N, 3), or (N,) for their numbers
    seed : of the random numbers
    most : points that are drawn
    """
    if len(points) <= most:
        return points
    edges = np.linspace(0, len(points), most + 1).astype(np.int64)
    at = np.random.default_rng(seed).random(most)
    return points[edges[:-1] + (at * np.diff(edges)).astype(np.int64)]


def spread_over_triangles(
    points: NDArray[np.floating], faces: NDArray[np.integer], n: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose places on triangles, uniformly by area.

    Parameters
    ----------
    points : floating (N, 3)
    faces : integer (M, 3)
    n : number of places
    rng : chooses them

    Returns
    -------
    chosen : int64 (n,), the triangle of each place
    weights : float64 (n, 3), of the triangle's corners, adding up to 1

    Raises
    ------
    ValueError
        If the triangles have no area.

    Source
    ------
    G. Turk, "Generating random points in triangles", Graphics Gems (1990).
    """
    areas = triangle_areas(points, faces)
    if not areas.sum() > 0:
        raise ValueError(f"the mesh's {len(areas)} triangles have no area")
    chosen = np.searchsorted(np.cumsum(areas), rng.random(n) * areas.sum(), side="right").clip(max=len(areas) - 1)
    root, second = np.sqrt(rng.random((n, 1))), rng.random((n, 1))
    return chosen, np.concatenate([1 - root, root * (1 - second), root * second], axis=1)


def triangle_areas(points: NDArray[np.floating], faces: NDArray[np.integer]) -> NDArray[np.float64]:
    """Compute the areas (M,) of triangles (M, 3) between points (N, 3), in the squared unit of length."""
    return np.asarray(np.linalg.norm(area_vectors(points, faces), axis=1))


def between_corners(
    values: NDArray[Any], corners: NDArray[np.integer], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate values (N, C) of vertices at places on triangles: float64 (n, C).

    Parameters
    ----------
    values : of any numbers
    corners : integer (n, 3), the vertices of each place's triangle
    weights : float64 (n, 3), from `spread_over_triangles`
    """
    return np.asarray(sum(weights[:, corner, None] * values[corners[:, corner]] for corner in range(3)))


def thinned(points: NDArray[np.floating], cell: float) -> NDArray[np.floating]:
    """Return the first of points (N, 3) in every occupied cell of a grid: dense parts then count by their area."""
    return points[first_in_cells(points, cell)]


def first_in_cells(points: NDArray[np.floating], cell: float) -> NDArray[np.int64]:
    """Return the index of the first of points (N, 3) in every occupied cell of a grid."""
    cells = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    keys = (cells[:, 0] * 2_000_003 + cells[:, 1]) * 2_000_003 + cells[:, 2]
    return np.sort(np.unique(keys, return_index=True)[1])


def order_by_cells(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """Order the rows (N,) of points (N, 3) by cells, CELLS_A_SIDE along each axis: neighbours then stand together."""
    if not len(points):
        return np.zeros(0, np.int64)
    low = points.min(axis=0)
    length = float(np.max(points.max(axis=0) - low)) or 1.0
    cells = np.minimum((points - low) * (CELLS_A_SIDE / length), CELLS_A_SIDE - 1).astype(np.uint16)
    keys = (cells[:, 0] * CELLS_A_SIDE + cells[:, 1]) * CELLS_A_SIDE + cells[:, 2]
    return np.argsort(keys, kind="stable")  # 16 bits are sorted by their digits, in linear time


def search_tree(points: NDArray[np.floating]) -> cKDTree:
    """Build a search tree of points (N, 3) of a surface: without balance it takes half the time there."""
    from scipy.spatial import cKDTree

    return cKDTree(points.astype(np.float64), balanced_tree=False, compact_nodes=False)


def cell_means(points: NDArray[np.floating], cell: float) -> NDArray[np.float64]:
    """Return the mean (M, 3) of the points (N, 3) in every occupied cell of a grid, mm.

    Convention: the grid begins half a cell below the lowest coordinates, like that of Open3D's `voxel_down_sample`,
    which the evaluation of Tanks and Temples calls.
    """
    low = points.min(axis=0) - cell / 2
    cells = np.floor((points - low) / cell).astype(np.int64)
    _, place, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    return vector_sums(points, place.reshape(-1), len(counts)) / counts[:, None]


def fibonacci_sphere(n: int) -> NDArray[np.float64]:
    """Return evenly spread directions (n, 3) of unit length."""
    index = np.arange(n) + 0.5
    y, turn = 1 - 2 * index / n, np.pi * (1 + 5**0.5) * index
    sine = np.sqrt(1 - y**2)
    return np.stack([sine * np.cos(turn), y, sine * np.sin(turn)], axis=1)


def axes_facing(towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes of a view, float64 (3, 3): right, up and towards the viewer; up is near the world's y."""
    z = towards / np.linalg.norm(towards)
    right = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.95 else (1.0, 0.0, 0.0), z)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(z, right), z])

"""Normals of meshes that come without them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ROUNDED = 1e-3  # how far a length may be from 1
UPWARDS = (0.0, 1.0, 0.0)  # where nothing tells a direction


def surface_normals(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> NDArray[np.float32]:
    """Compute smooth normals: the mean of the faces around each place, weighted by their areas.

    Vertices in the same place get the same normal, so that seams of a texture do not show in the light.

    Parameters
    ----------
    vertices : floating (N, 3)
    faces : integer (M, 3), counter-clockwise seen from outside

    Returns
    -------
    float32 (N, 3), unit length; straight up where no face has an area
    """
    place = _places(vertices)
    areas = area_vectors(vertices, faces)
    sums = vector_sums(np.repeat(areas, 3, axis=0), place[faces].ravel(), int(place.max()) + 1)
    return unit_normals(sums, np.broadcast_to(UPWARDS, sums.shape))[place]


def are_unit(normals: NDArray[np.floating]) -> bool:
    """Tell whether all vectors (N, 3) have unit length, but for rounding; never if one is no number."""
    return bool((np.abs(_lengths(normals) - 1) <= ROUNDED).all())


def area_vectors(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return the normal of each triangle, float64 (M, 3), as long as its area.

    Parameters
    ----------
    vertices : floating (N, 3)
    faces : integer (M, 3), counter-clockwise seen from outside
    """
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    return np.asarray(np.cross(b - a, c - a) / 2)


def vector_sums(vectors: NDArray[np.number], groups: NDArray[np.integer], n: int) -> NDArray[np.float64]:
    """Add up the vectors (L, 3) of each of n groups, float64 (n, 3).

    Parameters
    ----------
    vectors : (L, 3)
    groups : integer (L,), the group of each, from 0
    n : number of groups
    """
    return np.stack([np.bincount(groups, vectors[:, axis], n) for axis in range(3)], axis=1)


def unit_normals(vectors: NDArray[np.floating], otherwise: NDArray[np.floating]) -> NDArray[np.float32]:
    """Scale vectors (N, 3) to unit length, float32 (N, 3); take `otherwise` (N, 3) where they have no direction."""
    length = _lengths(vectors)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(np.isfinite(length) & (length > 0), vectors / length, otherwise).astype(np.float32)


def _lengths(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Measure vectors (N, 3), float64 (N,): in float32 the squares of long ones overflow, of short ones vanish."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors, dtype=np.float64)))


def _places(vertices: NDArray[np.floating]) -> NDArray[np.int64]:
    """Number the different places of vertices (N, 3); returns each vertex's number (N,)."""
    order = np.lexsort(vertices.T)
    is_new = (np.diff(vertices[order], axis=0) != 0).any(axis=1)
    place = np.empty(len(vertices), np.int64)
    place[order] = np.concatenate([[0], np.cumsum(is_new)])
    return place

"""Normals of meshes that come without them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def mesh_normals(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> NDArray[np.float32]:
    """Compute area-weighted unit normals, float32 (N, 3), of vertices (N, 3) with triangles (M, 3).

    Convention: triangles are counter-clockwise seen from outside. A vertex that no triangle with an area uses gets
    (0, 0, 1).
    """
    a, b, c = np.asarray(vertices, dtype=np.float64)[faces].transpose(1, 0, 2)
    areas = np.cross(b - a, c - a)  # (M, 3), twice the triangle's area long
    corners = np.asarray(faces).ravel()
    sums = [np.bincount(corners, np.repeat(areas[:, axis], 3), len(vertices)) for axis in range(3)]
    normals = np.column_stack(sums)
    lengths = np.linalg.norm(normals, axis=1)
    normals[lengths == 0] = (0, 0, 1)
    lengths[lengths == 0] = 1
    return np.asarray(normals / lengths[:, None], dtype=np.float32)

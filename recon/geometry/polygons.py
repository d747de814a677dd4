"""Cut the polygons of models into triangles: around the first corner where that covers them, else by clipping ears."""

from __future__ import annotations

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

ROUNDING = 1e-12  # of a polygon's squared area; what turns back by less has no area


def cut_polygons(
    points: NDArray[np.floating], corners: NDArray[np.integer], n_corners: NDArray[np.integer]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cut polygons, concave ones included, into triangles that are seen from the same side.

    Parameters
    ----------
    points : floating (N, 3)
    corners : integer (K,), points at the corners of all polygons one after another; one that is not there spoils no
        other polygon, and its own keeps its name
    n_corners : integer (P,), how many each polygon has, at least 3

    Returns
    -------
    triangles : int64 (M, 3), places in `corners`, those of a polygon one after another
    polygons : int64 (M,), the polygon of each triangle
    """
    n_triangles = n_corners.astype(np.int64) - 2
    fans, polygons = _fans(n_corners), np.repeat(np.arange(len(n_corners)), n_triangles)
    if not len(fans) or (n_triangles == 1).all():
        return fans, polygons
    at = np.asarray(points, np.float64)[np.clip(corners, 0, len(points) - 1)]  # (K, 3)
    first = np.cumsum(n_triangles) - n_triangles
    a, b, c = at[fans].transpose(1, 0, 2)
    with np.errstate(invalid="ignore", over="ignore"):  # coordinates that are no numbers are refused later
        areas = np.cross(b - a, c - a)
        normals = np.add.reduceat(areas, first)
        turned = np.einsum("mc,mc->m", areas, normals[polygons])
        is_back = turned < -ROUNDING * np.einsum("pc,pc->p", normals, normals)[polygons]
    if not is_back.any():
        return fans, polygons
    concave = np.unique(polygons[is_back])
    starts = np.cumsum(n_corners, dtype=np.int64) - n_corners
    parts = np.split(fans, first[1:])
    for polygon in concave:
        start = int(starts[polygon])
        ears = _ears(at[start : start + int(n_corners[polygon])], normals[polygon])
        if len(ears):
            parts[polygon] = ears + start
    return np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])


def _fans(n_corners: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the triangles (M, 3) around each polygon's first corner, places in the corners of all."""
    starts = np.cumsum(n_corners) - n_corners
    first = np.repeat(starts, n_corners - 2)
    within = np.arange(len(first)) - np.repeat(np.cumsum(n_corners - 2) - (n_corners - 2), n_corners - 2)
    return np.asarray(np.stack([first, first + within + 1, first + within + 2], axis=1), dtype=np.int64)


def _ears(outline: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.int64]:
    """Cut one polygon, float64 (C, 3), as it is seen along the axis nearest to its normal."""
    axis = int(np.argmax(np.abs(normal)))
    seen = np.ascontiguousarray(outline[:, [(axis + 1) % 3, (axis + 2) % 3]])
    ends = np.array([len(outline)], np.uint32)
    triangles = mapbox_earcut.triangulate_float64(seen, ends).reshape(-1, 3).astype(np.int64)  # counter-clockwise
    return triangles if normal[axis] > 0 else triangles[:, ::-1]

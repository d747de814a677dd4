"""Height maps: how far a model reaches towards a plane, from which shadows follow."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Discs, Model
from recon.geometry.splats import Splats
from recon.render.scene import TexelGrid

CASTING_OPACITY = 0.5  # of splats that cast a shadow
SPLAT_REACH = 1.5  # standard deviations to which they do
LEAST_RADIUS = float(np.sqrt(0.5))  # texels; a smaller disc could lie between all centres of texels


def height_map(model: Model, grid: TexelGrid) -> NDArray[np.float32]:
    """Find the smallest depth at which a model meets each texel; discs and splats face along the grid's depth.

    Returns
    -------
    float32 (rows, columns), mm, infinite where the model does not reach
    """
    if isinstance(model, Splats):
        casting = model.select(model.opacities >= CASTING_OPACITY)
        radii = SPLAT_REACH * np.sqrt(np.sort(casting.scales, axis=1)[:, 1:].prod(axis=1))
        return disc_heights(grid.project(casting.centres), radii / grid.texel, grid.shape)
    if isinstance(model, Discs):
        return disc_heights(grid.project(model.cloud.points), model.radius_mm / grid.texel, grid.shape)
    return triangle_heights(grid.project(model.vertices), model.faces, grid.shape)


def triangle_heights(
    points: NDArray[np.float32], faces: NDArray[np.int32], shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Find the smallest third coordinate that triangles reach at each texel.

    Parameters
    ----------
    points : float32 (N, 3): column, row, depth of each vertex
    faces : int32 (M, 3)
    shape : (rows, columns)

    Returns
    -------
    float32 (rows, columns), infinite where there is no triangle
    """
    heights = np.full(shape, np.inf, dtype=np.float32)
    _draw_triangles(points, faces, heights)
    return heights


def disc_heights(
    points: NDArray[np.float32], radius: float | NDArray[np.floating], shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Find the smallest third coordinate of the discs over each texel; every disc inside meets a texel at least.

    Parameters
    ----------
    points : float32 (N, 3): column, row, depth of each disc's middle
    radius : of all discs, or of each (N,), texels
    shape : (rows, columns)

    Returns
    -------
    float32 (rows, columns), infinite where there is no disc
    """
    heights = np.full(shape, np.inf, dtype=np.float32)
    radii = np.broadcast_to(np.maximum(radius, LEAST_RADIUS), len(points)).astype(np.float32)
    _draw_discs(points, radii, heights)
    return heights


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_triangles(points, faces, heights):  # type: ignore[no-untyped-def]  # numba
    """Lower each pixel of `heights` to the smallest depth of the triangles over its centre."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
        cx, cy = points[c, 0], points[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0 or not np.isfinite(area):
            continue
        left, right = max(0, int(np.ceil(min(ax, bx, cx)))), min(heights.shape[1] - 1, int(np.floor(max(ax, bx, cx))))
        top, bottom = max(0, int(np.ceil(min(ay, by, cy)))), min(heights.shape[0] - 1, int(np.floor(max(ay, by, cy))))
        if left > right or top > bottom:
            continue
        scale = np.float32(1) / area
        a_dx, a_dy, b_dx, b_dy = (by - cy) * scale, (cx - bx) * scale, (cy - ay) * scale, (ax - cx) * scale
        za, zb, zc = points[a, 2], points[b, 2], points[c, 2]
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                dx, dy = np.float32(x) - cx, np.float32(y) - cy
                wa, wb = a_dx * dx + a_dy * dy, b_dx * dx + b_dy * dy
                wc = np.float32(1) - wa - wb
                if wa >= 0 and wb >= 0 and wc >= 0:
                    heights[y, x] = min(heights[y, x], wa * za + wb * zb + wc * zc)


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_discs(points, radii, heights):  # type: ignore[no-untyped-def]  # numba
    """Lower each texel of `heights` to the smallest depth of the discs over its centre."""
    beyond = np.float32(2 * (heights.shape[0] + heights.shape[1]))
    for i in range(points.shape[0]):
        x, y, depth, radius = points[i, 0], points[i, 1], points[i, 2], radii[i]
        farthest = beyond + radius
        if not (abs(x) < farthest and abs(y) < farthest):
            continue
        left, right = max(0, int(np.ceil(x - radius))), min(heights.shape[1] - 1, int(np.floor(x + radius)))
        top, bottom = max(0, int(np.ceil(y - radius))), min(heights.shape[0] - 1, int(np.floor(y + radius)))
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                dx, dy = np.float32(column) - x, np.float32(row) - y
                if dx * dx + dy * dy <= radius * radius:
                    heights[row, column] = min(heights[row, column], depth)

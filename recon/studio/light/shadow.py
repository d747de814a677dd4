"""Shadows: what the key light reaches, and how much light the actors take from the floor."""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

MAP_SIZE = 448
FLOOR_CELLS = 256
FLOOR_HALF_MM = 1800.0
LOW_MM = 550.0  # surfaces below this height cast a sharper shadow
CONTACT_MM = 260.0  # and below this one darken the floor under them
LIFT_MM = 4.0  # a surface is compared from so far outside it


def cast(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], direction: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Map the surfaces nearest to the key light.

    Parameters
    ----------
    vertices : float64 (N, 3), mm, world
    faces : int32 (M, 3)
    direction : float64 (3,), towards the light

    Returns
    -------
    nearest : float32 (MAP_SIZE, MAP_SIZE), coordinate towards the light of the surface nearest to it, mm
    frame : float64 (3, 4), map column, map row and coordinate towards the light from world points
    """
    right = np.cross((0.0, 1.0, 0.0), direction)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(direction, right), direction])
    turned = vertices @ axes.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    scale = (MAP_SIZE - 5) / max(high[0] - low[0], high[1] - low[1])
    factors = np.array([scale, scale, 1.0])
    frame = np.concatenate(
        [axes * factors[:, None], np.array([[2 - scale * low[0]], [2 - scale * low[1]], [0.0]])], axis=1
    )
    nearest = np.full((MAP_SIZE, MAP_SIZE), -1e9, np.float32)
    _nearest(turned * factors + frame[:, 3], faces, nearest)
    return nearest, frame


def floor_shade(vertices: NDArray[np.float64], floor_y: float, direction: NDArray[np.float64]) -> NDArray[np.float32]:
    """Compute how much the actors darken the floor.

    Returns float32 (FLOOR_CELLS, FLOOR_CELLS), factor on the floor's display values, over z (rows) and x (columns).

    Parameters
    ----------
    vertices : float64 (N, 3), mm, world
    floor_y : mm
    direction : float64 (3,), towards the key light
    """
    height = vertices[:, 1] - floor_y
    x, z = vertices[:, 0] - height * direction[0] / direction[1], vertices[:, 2] - height * direction[2] / direction[1]
    low, contact = height < LOW_MM, height < CONTACT_MM
    sharp, soft, under = np.zeros((3, FLOOR_CELLS, FLOOR_CELLS), np.float32)
    _splat(x[low], z[low], sharp)
    _splat(x[~low], z[~low], soft)
    _splat(vertices[contact, 0], vertices[contact, 2], under)
    key = np.maximum(cv2.GaussianBlur(sharp, (0, 0), 2.5), cv2.GaussianBlur(soft, (0, 0), 6.0))
    light = (1.0 - 0.45 * key) * (1.0 - 0.75 * cv2.GaussianBlur(under, (0, 0), 3.0))
    return np.asarray(np.power(light, 1.0 / 2.2), dtype=np.float32)


def key_share(
    vertices: NDArray[np.float64],
    normals: NDArray[np.float64],
    faces: NDArray[np.int32],
    direction: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Compute the share of the key light, float32 (N,), 0 to 1, that reaches each vertex, soft at the shadow's edge.

    Parameters
    ----------
    vertices, normals : float64 (N, 3), mm, world
    faces : int32 (M, 3)
    direction : float64 (3,), towards the light
    """
    nearest, frame = cast(vertices, faces, direction)
    return np.asarray(_key_share(vertices + LIFT_MM * normals, nearest, frame))


@numba.njit(cache=True, nogil=True)
def _key_share(
    points: NDArray[np.float64], nearest: NDArray[np.float32], frame: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Compare each point 16 times with the map of nearest surfaces."""
    h, w = nearest.shape
    share = np.ones(len(points), np.float32)
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        column = int(frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z + frame[0, 3])
        row = int(frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z + frame[1, 3])
        limit = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z + frame[2, 3] + 22.0
        if row < 3 or column < 3 or row >= h - 3 or column >= w - 3:
            continue
        lit = 0
        for j in range(-3, 4, 2):
            for i in range(-3, 4, 2):
                if nearest[row + j, column + i] <= limit:
                    lit += 1
        share[p] = lit / 16.0
    return share


@numba.njit(cache=True, nogil=True)
def _splat(xs: NDArray[np.float64], zs: NDArray[np.float64], cells: NDArray[np.float32]) -> None:
    for i in range(len(xs)):
        column, row = int((xs[i] + 1800.0) * (256 / 3600.0)), int((zs[i] + 1800.0) * (256 / 3600.0))
        if 0 <= column < 256 and 0 <= row < 256:
            cells[row, column] = 1.0


@numba.njit(cache=True, nogil=True)
def _nearest(points: NDArray[np.float64], faces: NDArray[np.int32], nearest: NDArray[np.float32]) -> None:
    h, w = nearest.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
        cx, cy = points[c, 0], points[c, 1]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area <= 0.0:
            continue
        for y in range(max(0, int(np.ceil(min(ay, min(by, cy))))), min(h - 1, int(max(ay, max(by, cy)))) + 1):
            for x in range(max(0, int(np.ceil(min(ax, min(bx, cx))))), min(w - 1, int(max(ax, max(bx, cx)))) + 1):
                u = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
                v = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
                t = 1.0 - u - v
                if u >= 0.0 and v >= 0.0 and t >= 0.0:
                    nearest[y, x] = max(nearest[y, x], u * points[a, 2] + v * points[b, 2] + t * points[c, 2])

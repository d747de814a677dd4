"""Holes inside the sensors' masks, filled with points that continue the surface around them.

A mask shows the object where a sensor measured nothing: what only one camera of the pair sees, or sees too obliquely.
There the surface goes on behind what stands before it, along its own plane, up to a stated number of pixels. The points
take their colours from the picture. They are kept apart from what was measured, so that measures can leave them out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud
from recon.surface import spacing
from recon.surface.photographs import Photograph

LEAST_FACING = 0.2  # cosine between normal and line of sight; planes seen more obliquely say nothing of what goes on
LEAST_RADIUS_PX = 1.0  # of a point as a camera sees it
JUMP_WIDTHS = 8.0  # between surfaces that are not one, in distances of neighbouring points
SIGMAS = 2.0  # of measured points: how uncertain filled ones are


def fill_holes(clouds: Sequence[Cloud], photographs: Sequence[Photograph], reach_px: int) -> list[Cloud]:
    """Fill what no cloud shows inside the masks of photographs: a cloud per photograph, some without points.

    Parameters
    ----------
    clouds : what was measured, one per sensor, some without points
    photographs : those without a mask have no holes
    reach_px : how far from what was measured, pixels
    """
    seen = [cloud for cloud in clouds if len(cloud)]
    if not seen:
        return [clouds[0] for _ in photographs]
    points = np.concatenate([cloud.points for cloud in seen]).astype(np.float64)
    normals = np.concatenate([cloud.normals for cloud in seen]).astype(np.float64)
    widths = np.repeat([spacing(cloud) for cloud in seen], [len(cloud) for cloud in seen])
    sigmas = [cloud.sigma for cloud in seen if cloud.sigma is not None]
    sigma = SIGMAS * float(np.median(np.concatenate(sigmas))) if sigmas else None
    return [_filled(points, normals, widths, sigma, photograph, reach_px) for photograph in photographs]


def _filled(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    widths: NDArray[np.float64],
    sigma: float | None,
    photograph: Photograph,
    reach_px: int,
) -> Cloud:
    camera, mask = photograph.camera, photograph.mask
    jump = JUMP_WIDTHS * float(np.median(widths))
    width, height = camera.size
    places, directions = np.zeros((2, height, width, 3))
    order = np.zeros((height, width), np.int32)  # 0 where nothing is, 1 what was measured, then by distance
    if mask is not None:
        projected = camera.points_in_camera(points) @ camera.K.T
        _draw(points, normals, widths, projected, camera.K[0, 0], camera.centre, places, directions, order)
        columns, rows = np.meshgrid(np.arange(width), np.arange(height))
        rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera.K).T @ camera.rotation
        _grow(places, directions, order, mask, rays, camera.centre, reach_px, jump)
    new = order > 1
    return Cloud(
        places[new].astype(np.float32),
        directions[new].astype(np.float32),
        photograph.pixels[new],
        None if sigma is None else np.full(np.count_nonzero(new), sigma, np.float32),
    )


@njit(cache=True)
def _draw(points, normals, widths, projected, focal, centre, places, directions, order):  # type: ignore[no-untyped-def]  # numba
    """Draw points that face a camera as squares, the nearest in front."""
    height, width = order.shape
    nearest = np.full((height, width), np.inf)
    for i in range(len(points)):
        p, n = points[i], normals[i]
        if (centre[0] - p[0]) * n[0] + (centre[1] - p[1]) * n[1] + (centre[2] - p[2]) * n[2] <= 0:
            continue
        x, y, z = projected[i]
        if z <= 0:
            continue
        column, row, radius = x / z, y / z, max(LEAST_RADIUS_PX, widths[i] * focal / z)
        if not (-radius <= column < width + radius and -radius <= row < height + radius):
            continue
        for v in range(max(int(np.ceil(row - radius)), 0), min(int(np.floor(row + radius)) + 1, height)):
            for u in range(max(int(np.ceil(column - radius)), 0), min(int(np.floor(column + radius)) + 1, width)):
                if z < nearest[v, u]:
                    nearest[v, u], order[v, u] = z, 1
                    places[v, u], directions[v, u] = p, n


@njit(cache=True)
def _grow(places, directions, order, mask, rays, centre, reach, jump):  # type: ignore[no-untyped-def]  # numba
    """Continue planes into the pixels of a mask where nothing is, ring by ring; what lies a jump behind wins."""
    height, width = order.shape
    depths = np.zeros((height, width))  # along the ray; of what is continued
    ring = [(v, u) for v in range(height) for u in range(width) if order[v, u] == 1]
    for now in range(2, reach + 2):
        following = [(v, u) for v, u in ring if order[v, u] == 0]  # empty, of the right type
        for v, u in ring:
            for y in range(max(v - 1, 0), min(v + 2, height)):
                for x in range(max(u - 1, 0), min(u + 2, width)):
                    if order[y, x] == 1 or not mask[y, x]:
                        continue
                    n, ray = directions[v, u], rays[y, x]
                    along = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2]
                    length = np.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
                    if along > -LEAST_FACING * length:
                        continue
                    depth = (n * (places[v, u] - centre)).sum() / along * length
                    if depth <= (depths[y, x] if order[y, x] in (0, now) else depths[y, x] + jump):
                        continue
                    if order[y, x] != now:
                        following.append((y, x))
                    depths[y, x], order[y, x], directions[y, x] = depth, now, n
                    places[y, x] = centre + depth / length * ray
        ring = following

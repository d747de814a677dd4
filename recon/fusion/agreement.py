"""What the sensors measured, made to agree before it is fused: every point is held against all that see its place.

A point that lies in front of what another sensor measured floats where that sensor looks through; unless as many others
measured it, too, it goes. Where others measured the same surface, the point moves along its own line of sight to the
mean of all, each weighted by its certainty. So every sensor keeps a cloud of its own, in its own pixels.

Source
------
Merrell, Akbarzadeh, Wang, Mordohai, Frahm, Yang, Nister and Pollefeys, Real-time visibility-based fusion of depth maps,
ICCV 2007: the counts of confidence and of violated visibility.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud
from recon.geometry.rig import Camera
from recon.runtime.workers import in_bands

SAME_SIGMAS = 5.0  # apart, two measurements are of one surface; on the temple 3 gains .1 dB less, 8 as much
IN_FRONT_SIGMAS = 6.0  # before another's surface, a point floats
JUMP_SIGMAS = 15.0  # between neighbouring pixels, beyond which their surfaces are not one: 1.5 pixels of disparity
LEAST_FACING = 0.15  # cosine between normal and line of sight, as of `CloudParameters`


def agreed(clouds: Sequence[Cloud], cameras: Sequence[Camera]) -> list[Cloud]:
    """Drop the points that the other sensors contradict, and draw the others to what they measured.

    Parameters
    ----------
    clouds : one per sensor, each point from the middle of a pixel; clouds without sigma are left as they are
    cameras : of the pixels, without distortion
    """
    seen = [seen_by(camera, cloud) for cloud, camera in zip(clouds, cameras, strict=True)]
    after = list(clouds)
    for number, cloud in enumerate(clouds):
        if seen[number] is not None:
            others = [view for view in seen[:number] + seen[number + 1 :] if view is not None]
            after[number] = _agreed_with(cloud, cameras[number], others)
    return after


class Seen(NamedTuple):
    """What a sensor measured, in its pixels: depth and sigma, float32 (H, W), mm, NaN where there is none."""

    camera: Camera
    depth: NDArray[np.float32]
    sigma: NDArray[np.float32]


class Say(NamedTuple):
    """What other sensors say of points.

    Parameters
    ----------
    rays : (N, 3), unit vectors along the own lines of sight
    votes : int32 (N, 2), how many sensors measured the same, and how many look through
    weights, moves : float64 (N,), certainties, 1/mm^2, and ways along the rays to what was measured, mm, times these
    """

    rays: NDArray[np.float64]
    votes: NDArray[np.int32]
    weights: NDArray[np.float64]
    moves: NDArray[np.float64]


def seen_by(camera: Camera, cloud: Cloud) -> Seen | None:
    """Put a cloud back into the pixels of its camera; None where it has no points, or does not say how certain."""
    if cloud.sigma is None or not len(cloud):
        return None
    width, height = camera.size
    depth, sigma = np.full((2, height, width), np.nan, np.float32)
    columns, rows = np.rint(camera.project(cloud.points)).astype(np.int64).T
    depth[rows, columns] = camera.points_in_camera(cloud.points)[:, 2]
    sigma[rows, columns] = cloud.sigma
    return Seen(camera, depth, sigma)


def say_of(others: Sequence[Seen], cloud: Cloud, camera: Camera) -> Say:
    """Hold the points of a sensor's cloud, which has sigmas, against what other sensors measured.

    Parameters
    ----------
    others : what the other sensors measured
    cloud, camera : the points, and whose they are
    """
    assert cloud.sigma is not None
    rays = cloud.points - camera.centre
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    votes = np.zeros((len(cloud), 2), np.int32)  # sensors that measured the same, and that look through
    weights, moves = 1.0 / cloud.sigma.astype(np.float64) ** 2, np.zeros(len(cloud))
    for other, depth, sigma in others:
        compare = partial(
            _compare, cloud.points.astype(np.float64), cloud.normals.astype(np.float64), cloud.sigma, rays,
            other.points_in_camera(cloud.points) @ other.K.T, other.centre, depth, sigma, votes, weights, moves,
        )  # fmt: skip
        in_bands(len(cloud), compare)
    return Say(rays, votes, weights, moves)


def _agreed_with(cloud: Cloud, camera: Camera, others: Sequence[Seen]) -> Cloud:
    rays, votes, weights, moves = say_of(others, cloud, camera)
    kept = votes[:, 1] <= votes[:, 0]
    points = (cloud.points + rays * (moves / weights)[:, None]).astype(np.float32)
    return Cloud(points, cloud.normals, cloud.colours, (weights**-0.5).astype(np.float32)).select(kept)


@njit(cache=True, nogil=True)
def _compare(  # type: ignore[no-untyped-def]  # numba
    points, normals, sigmas, rays, projected, centre, depth, sigma, votes, weights, moves, start, stop
):
    """Count one more sensor's say on points, and add its weighted moves along their rays."""
    height, width = depth.shape
    for i in range(start, stop):
        x, y, z = projected[i]
        if z <= 0:
            continue
        column, row = x / z, y / z
        if not (0 <= column < width - 1 and 0 <= row < height - 1):
            continue
        u, v = int(column), int(row)
        s, t = column - u, row - v
        nearest, farthest, error, mean = np.inf, 0.0, 0.0, 0.0
        for j in range(2):
            for k in range(2):
                d = float(depth[v + j, u + k])
                mean += d * (t if j else 1 - t) * (s if k else 1 - s)
                nearest, farthest, error = min(nearest, d), max(farthest, d), max(error, float(sigma[v + j, u + k]))
        if not mean > 0 or farthest - nearest > JUMP_SIGMAS * error:  # NaN where one of the four is
            continue
        gap = z - mean
        both = np.sqrt(error * error + float(sigmas[i]) ** 2)
        if gap < -IN_FRONT_SIGMAS * both:
            votes[i, 1] += 1
        elif abs(gap) <= SAME_SIGMAS * both:
            votes[i, 0] += 1
            across = facing = 0.0  # the way to the other's surface along its line of sight, and the ray, on the normal
            for axis in range(3):
                across -= gap / z * (points[i, axis] - centre[axis]) * normals[i, axis]
                facing += rays[i, axis] * normals[i, axis]
            weight = 1.0 / (error * error)
            weights[i] += weight
            moves[i] += weight * across / min(facing, -LEAST_FACING)

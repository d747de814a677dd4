"""Agreement of the depth maps of two sensors where both see the same place.

A point of a sensor's depth map lies in front of, on, or behind the surface that the other sensor measured. Far behind,
it is hidden from the other sensor and is not compared; in front, it floats where the other looks through.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.depth_maps import depth_view, sensor_view
from recon.capture.recording import GIVEN
from recon.capture.rectify import Rectification
from recon.depth.disparity_io import read_disparity
from recon.methods.approaches import parse_approach
from recon.pipeline.run import Run, View

HIDDEN_STEPS = 8.0  # thresholds behind another sensor's surface from which a point counts as hidden from it
JUMP_PX = 1.0  # of disparity between neighbours that lie on different surfaces


def depth_step(run: Run) -> float:
    """Compute the depth of a pixel of disparity in the middle of the bounds, mean of the sensors, mm.

    Depth maps count as disparities of their imagined pair.
    """
    steps = []
    middle = run.capture.bounds.mean(axis=0)
    for stream in run.capture.sensors:
        view = sensor_view(stream, run.capture.bounds)
        z = float(view.left.points_in_camera(middle[None])[0, 2])
        steps.append(z * z / (view.focal * view.baseline))
    return float(np.mean(steps))


def cross_sensor_rows(run: Run, frames: Sequence[int], threshold: float) -> list[dict[str, Any]]:
    """Compare each depth method's maps in each frame for each ordered pair of sensors, a row each.

    Parameters
    ----------
    run : no rows for a rig with a single sensor
    frames : of the run
    threshold : mm, within which two depths agree
    """
    rows = []
    known = {parse_approach(approach).depth: run.frames_of(approach) for approach in run.approaches}
    for method, frames_known in known.items():
        view_of = depth_view if method == GIVEN else sensor_view
        views = {s.id: view_of(s, run.capture.bounds) for s in run.capture.sensors_for(method)}
        for frame in (frame for frame in frames if frame in frames_known):
            maps = {name: read_disparity(run.folder / View(method, name, frame).depth) for name in views}
            points = {name: depth_points(maps[name], views[name], run.capture.bounds) for name in views}
            for measured, seen_by in permutations(views, 2):
                gaps = depth_gaps(points[measured], maps[seen_by], views[seen_by])
                n_points = len(points[measured])
                pair = {"depth": method, "frame": frame, "of": measured, "by": seen_by, "n_points": n_points}
                rows.append(pair | _described(gaps, threshold))
    return rows


def depth_points(
    disparity: NDArray[np.float32], view: Rectification, bounds: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn a disparity map into the points (N, 3) within the bounds, in the world, mm.

    Parameters
    ----------
    disparity : float32 (H, W), pixels, NaN where unmatched
    view : of the sensor, rectified
    bounds : float64 (2, 3), mm
    """
    z = view.depth(disparity)
    rows, columns = np.nonzero(np.isfinite(z))
    z, K = z[rows, columns], view.left.K
    in_camera = np.stack([(columns - K[0, 2]) * z / K[0, 0], (rows - K[1, 2]) * z / K[1, 1], z], axis=1)
    points = in_camera @ view.left.rotation + view.left.centre
    return np.asarray(points[((points >= bounds[0]) & (points <= bounds[1])).all(axis=1)])


def depth_gaps(points: NDArray[np.float64], disparity: NDArray[np.float32], view: Rectification) -> NDArray[np.float64]:
    """Measure how far points lie behind the surface that another sensor measured, mm, negative in front of it.

    Points where that sensor has no depth, or beside jumps of its depth, are left out.

    Parameters
    ----------
    points : float64 (N, 3), mm
    disparity : float32 (H, W), pixels, of the other sensor
    view : of the other sensor, rectified

    Returns
    -------
    float64 (M,), mm
    """
    in_camera = view.left.points_in_camera(points)
    pixels = view.left.project(points)
    height, width = disparity.shape
    inside = (in_camera[:, 2] > 0) & (pixels >= 0).all(axis=1) & (pixels < (width - 1, height - 1)).all(axis=1)
    columns, rows = np.floor(pixels[inside]).astype(int).T
    u, v = (pixels[inside] - np.floor(pixels[inside])).T
    corners = np.stack([disparity[rows + i, columns + j] for i in (0, 1) for j in (0, 1)])  # (4, M)
    weights = np.stack([(1 - v) * (1 - u), (1 - v) * u, v * (1 - u), v * u])
    depth = view.depth((weights * corners).sum(axis=0))
    usable = np.isfinite(depth) & (corners.max(axis=0) - corners.min(axis=0) <= JUMP_PX)
    return np.asarray(in_camera[inside, 2][usable] - depth[usable])


def _described(gaps: NDArray[np.float64], threshold: float) -> dict[str, Any]:
    compared = gaps[gaps <= HIDDEN_STEPS * threshold]
    n = len(compared)
    return {
        "n_compared": n,
        "hidden": len(gaps) - n,
        "agree": float(np.mean(np.abs(compared) <= threshold)) if n else None,
        "in_front": float(np.mean(compared < -threshold)) if n else None,
        "median_abs_mm": float(np.median(np.abs(compared))) if n else None,
        "median_mm": float(np.median(compared)) if n else None,
    }

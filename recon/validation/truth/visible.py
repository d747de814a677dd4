"""Which points of a true surface some sensor can see: completeness counts no back that nobody could measure."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import Capture
from recon.geometry.mesh import Shape
from recon.geometry.rig import Camera
from recon.studio.rasterise import see

BEHIND_MM = 3.0  # the surface at a pixel, beside what the pixels around allow


def seen_by_sensors(truth: Shape, points: NDArray[np.float64], capture: Capture) -> NDArray[np.bool_]:
    """Mark the points (N, 3), mm, that all cameras of some sensor see, bool (N,).

    Parameters
    ----------
    truth : a mesh, which hides what lies behind it
    points : on it
    capture : whose sensors look

    Raises
    ------
    ValueError
        If the truth has no faces.
    """
    if not len(truth.faces):
        raise ValueError("the truth is a cloud, which hides nothing; expected a mesh to tell what sensors can see")
    seen = np.zeros(len(points), np.bool_)
    for stream in capture.sensors:
        seen |= np.logical_and.reduce([_seen(each.camera, truth, points) for each in stream.cameras])
    return seen


def _seen(camera: Camera, truth: Shape, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark the points that a camera sees: in its picture, and not behind the front of the truth."""
    depths = see(camera, truth.points.astype(np.float64), truth.faces).depths(camera.size)
    farthest = np.asarray(cv2.dilate(depths, np.ones((3, 3), np.uint8)))  # of the pixels around, where it slopes
    height, width = depths.shape
    columns, rows = np.rint(camera.project(points)).astype(int).T
    z = camera.points_in_camera(points)[:, 2]
    inside = (z > 0) & (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    seen = np.zeros(len(points), np.bool_)
    seen[inside] = z[inside] <= farthest[rows[inside], columns[inside]] + BEHIND_MM
    return seen

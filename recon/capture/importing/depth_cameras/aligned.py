"""Depth maps of a camera beside that of the pictures, brought into the pictures' camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.depth_maps import rays
from recon.capture.rectify import scaled_camera
from recon.geometry.rig import Camera

SPACING = 0.8  # of a target's pixel, between the depth maps' own on a plane before both: no pixel stays empty


@dataclass(frozen=True, eq=False)
class Alignment:
    """What brings depth maps into another camera.

    Convention: the pose of each camera is `cam_from_world` in one world, mm.

    Parameters
    ----------
    depth : the camera of the depth maps
    pictures : that of the pictures
    """

    depth: Camera
    pictures: Camera

    @cached_property
    def target(self) -> Camera:
        """The pictures' camera in the size of the depth maps to be, so large that they leave no holes."""
        scale = min(1.0, SPACING * float(self.depth.K[0, 0] / self.pictures.K[0, 0]))
        width, height = (max(1, round(length * scale)) for length in self.pictures.size)
        return scaled_camera(self.pictures, (width, height))

    @cached_property
    def _rays(self) -> NDArray[np.float64]:
        return rays(self.depth)

    def moved(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a depth map, float32 (H, W), mm, as the target sees it, the nearest surface in front; NaN for none."""
        points = (self._rays * depth[..., None])[np.isfinite(depth)]
        move = self.target.cam_from_world @ np.linalg.inv(self.depth.cam_from_world)
        seen = points @ move[:3, :3].T + move[:3, 3]
        seen = seen[seen[:, 2] > 0]
        width, height = self.target.size
        moved = np.full(height * width, np.inf, np.float32)
        if len(seen):
            dist = self.target.dist if self.target.dist.size else np.zeros(4)
            pixels = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), self.target.K, dist)[0][:, 0]
            columns, rows = np.rint(pixels).T
            inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
            places = (rows[inside] * width + columns[inside]).astype(np.intp)
            np.minimum.at(moved, places, seen[inside, 2].astype(np.float32))
        return np.where(np.isfinite(moved), moved, np.float32(np.nan)).reshape(height, width)

"""Matched points of two pictures, and how far they are from what a calibration says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.rectify import viewing_directions
from recon.geometry.rig import Sensor

MAX_RATIO = 0.8  # Lowe, "Distinctive image features from scale-invariant keypoints", 2004, section 7.1
MAX_FEATURES = 4000


@dataclass(frozen=True, eq=False)
class Matches:
    """Points that show the same spot in two pictures, float64 (N, 2) pixels each."""

    left: NDArray[np.float64]
    right: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.left)

    def __getitem__(self, which: NDArray[np.integer] | NDArray[np.bool_]) -> Matches:
        """Select matches by their indices or a mask (N,)."""
        return Matches(self.left[which], self.right[which])


NO_MATCHES = Matches(np.zeros((0, 2)), np.zeros((0, 2)))


def match_pictures(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    masks: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None,
) -> Matches:
    """Match SIFT features whose descriptors are mutually nearest and clearly nearer than the second nearest.

    No match is dropped for its position, so that a wrong calibration shows.

    Parameters
    ----------
    left, right : uint8 (H, W, 3)
    masks : bool (H, W) each, where features may lie, None for everywhere
    """
    sift = cv2.SIFT.create(nfeatures=MAX_FEATURES)
    areas = masks or (np.ones(left.shape[:2], dtype=bool), np.ones(right.shape[:2], dtype=bool))
    (left_points, left_features), (right_points, right_features) = (
        _features(sift, image, area) for image, area in zip((left, right), areas, strict=True)
    )
    if min(len(left_points), len(right_points)) < 2:
        return NO_MATCHES
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(right_features, left_features)}
    kept = [
        (first.queryIdx, first.trainIdx)
        for first, second in matcher.knnMatch(left_features, right_features, k=2)
        if first.distance < MAX_RATIO * second.distance and back[first.trainIdx] == first.queryIdx
    ]
    pairs = np.array(kept, dtype=np.intp).reshape(-1, 2)
    return Matches(left_points[pairs[:, 0]], right_points[pairs[:, 1]])


def joined(several: Sequence[Matches]) -> Matches:
    """Join the matches of several pictures of the same cameras."""
    if not several:
        return NO_MATCHES
    return Matches(
        np.concatenate([matches.left for matches in several]), np.concatenate([matches.right for matches in several])
    )


def epipolar_errors(sensor: Sensor, matches: Matches) -> NDArray[np.float64]:
    """Measure how far matches are from the calibration's epipolar lines, signed, float64 (N,), pixels.

    Source of Sampson's distance: Hartley, Zisserman, "Multiple view geometry", 2nd edition, equation 11.9.
    """
    relative = sensor.right_from_left
    x, y, z = relative[:3, 3]
    essential = np.array([[0.0, -z, y], [z, 0, -x], [-y, x, 0]]) @ relative[:3, :3]
    left, right = viewing_directions(sensor.left, matches.left), viewing_directions(sensor.right, matches.right)
    on_right, on_left = left @ essential.T, right @ essential
    slope = np.sqrt((on_right[:, :2] ** 2).sum(axis=1) + (on_left[:, :2] ** 2).sum(axis=1))
    focal = float(np.mean([np.diag(camera.K)[:2] for camera in (sensor.left, sensor.right)]))
    return np.asarray((right * on_right).sum(axis=1) / slope * focal)


def _features(
    sift: Any, image: NDArray[np.uint8], mask: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    features, descriptors = sift.detectAndCompute(grey, mask.astype(np.uint8))
    return np.array([feature.pt for feature in features], dtype=np.float64).reshape(-1, 2), descriptors

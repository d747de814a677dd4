"""A person who draws strokes on a frame of the studio, and how well masks agree with the studio's own."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.morphology import skeletonize

from recon.capture.format import Capture, read_masks
from recon.studio.truth import MASK

SIDES = ("left", "right")
STROKE_PX = 3
RING_PX = 12  # between the object and the stroke around it
GAP_PX = 4  # half the width of the narrowest gap that gets a stroke of its own


def write_strokes(folder: Path, capture: Capture, frame: int) -> Path:
    """Strokes on one frame of the first sensor."""
    for side in SIDES:
        path = folder / f"S1/{side}/{frame:04d}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), drawn(true_mask(capture, side, frame))[..., ::-1])
    return folder


def true_mask(capture: Capture, side: str, frame: int) -> NDArray[np.bool_]:
    """The studio's own mask, bool (H, W)."""
    picture = cv2.imread(str(capture.folder / MASK.format(view=f"S1/{side}", frame=frame)), cv2.IMREAD_GRAYSCALE)
    return np.asarray(picture) > 0


def intersection_over_union(capture: Capture) -> list[float]:
    """Of every picture of the first sensor."""
    overlaps = []
    for frame in range(capture.n_frames):
        masks = read_masks(capture, "S1", frame)
        assert masks is not None
        for side, mask in zip(SIDES, masks, strict=True):
            truth = true_mask(capture, side, frame)
            overlaps.append(float((mask & truth).sum() / (mask | truth).sum()))
    return overlaps


def drawn(truth: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Strokes: green along the middle of the object's parts, red around it and in its gaps, uint8 (H, W, 3)."""
    picture = np.zeros((*truth.shape, 3), dtype=np.uint8)
    away = cv2.distanceTransform((~truth).astype(np.uint8), cv2.DIST_L2, 5)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (4 * RING_PX + 1, 4 * RING_PX + 1))
    gaps = (cv2.morphologyEx(truth.astype(np.uint8), cv2.MORPH_CLOSE, disc) > 0) & ~truth
    picture[_stroke(gaps) & (away > GAP_PX)] = (255, 0, 0)
    picture[(away > RING_PX) & (away < RING_PX + STROKE_PX)] = (255, 0, 0)
    picture[_stroke(truth) & truth] = (0, 255, 0)
    return picture


def _stroke(area: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A line along the middle of an area's parts."""
    return np.asarray(cv2.dilate(skeletonize(area).astype(np.uint8), np.ones((STROKE_PX, STROKE_PX), np.uint8)) > 0)

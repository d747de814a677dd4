"""How noisy a picture is, from the picture alone."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
NOISE_GAIN = 6 * 0.6745  # the kernel's norm; a normal distribution's median absolute deviation


def noise_deviation(grey: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None) -> float:
    """Estimate the standard deviation of the noise of an image, uint8 (H, W): grey levels; texture counts little.

    Source: Immerkaer, Fast noise variance estimation, Computer Vision and Image Understanding 64, 1996, with the
    median in place of the mean.
    """
    response = np.abs(cv2.filter2D(grey, cv2.CV_16S, NOISE_KERNEL))
    inside = response if mask is None else response[mask]
    half = np.searchsorted(np.cumsum(np.bincount(inside.ravel())), inside.size / 2)
    return float(half) / NOISE_GAIN

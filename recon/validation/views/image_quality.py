"""Likeness of a rendering and a photograph inside a region: PSNR, SSIM, and similarity of gradients."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.quality import psnr_db, ssim_maps

GRADIENT_C = 170.0  # Xue et al. (2014), for values up to 255
PREWITT = np.array([[1, 0, -1], [1, 0, -1], [1, 0, -1]], np.float32) / 3
LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709
BEST_PSNR_DB = 99.0  # at most, of pictures that are the same


def psnr(picture: NDArray[np.uint8], photograph: NDArray[np.uint8], where: NDArray[np.bool_]) -> float | None:
    """Compute the peak signal-to-noise ratio of two pictures in a region, dB; None where the region is empty.

    Parameters
    ----------
    picture, photograph : uint8 (H, W, 3), sRGB
    where : bool (H, W), the region
    """
    if not where.any():
        return None
    difference = picture[where].astype(np.float64) - photograph[where]
    error = float(np.mean(difference**2))
    return min(BEST_PSNR_DB, psnr_db(error))


def ssim_map(picture: NDArray[np.uint8], photograph: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Compute the structural similarity of the luma of RGB pictures at each pixel, float32 (H, W)."""
    return ssim_maps(luma(picture), luma(photograph))[1]


def gradient_map(picture: NDArray[np.uint8], photograph: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Compute the similarity of the gradients' lengths at each pixel, float32 (H, W): 1 where edges are equally strong.

    Source
    ------
    Xue, Zhang, Mou, Bovik, "Gradient magnitude similarity deviation" (2014), equation 4, at full resolution.
    """
    a, b = _gradient(luma(picture)), _gradient(luma(photograph))
    return np.asarray((2 * a * b + GRADIENT_C) / (a * a + b * b + GRADIENT_C), dtype=np.float32)


def luma(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Convert an RGB picture (H, W, 3) to luma, float32 (H, W), 0 to 255."""
    return np.asarray(picture.astype(np.float32) @ LUMA)


def _gradient(values: NDArray[np.float32]) -> NDArray[np.float32]:
    across, down = cv2.filter2D(values, -1, PREWITT), cv2.filter2D(values, -1, PREWITT.T)
    return np.asarray(np.hypot(across, down))

"""Grey, colour and background of a picture, as the matchers take them."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

LUMA_256THS = np.array([77, 150, 29], np.uint16)  # ITU-R BT.601


def grey_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert an sRGB image, uint8 (H, W, 3), to luma, uint8 (H, W); a grey image (H, W) stays as it is."""
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def colour_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Give a grey image, uint8 (H, W), three equal channels; a colour image (H, W, 3) stays as it is."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


def on_black(image: NDArray[np.uint8], mask: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Blacken the background of an image.

    Parameters
    ----------
    image : uint8 (H, W, 3) or (H, W)
    mask : bool (H, W), True on the foreground; without one, the image stays as it is
    """
    if mask is None:
        return image
    return np.asarray(cv2.bitwise_and(image, image, mask=mask.view(np.uint8)), dtype=np.uint8)


def fine_grey_image(image: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Convert an image, uint8 (H, W, 3) or (H, W), to luma in 256ths of a grey level, uint16 (H, W).

    Blurring weak texture gives fractions of a grey level, which whole levels would hide.
    """
    weights = LUMA_256THS if image.ndim == 3 else np.array([256], np.uint16)
    grey = np.empty(image.shape[:2], np.uint16)
    _grey_kernel(image.reshape(*image.shape[:2], -1), weights, grey)
    return grey


@njit(cache=True, nogil=True)
def _grey_kernel(image: NDArray[np.uint8], weights: NDArray[np.uint16], grey: NDArray[np.uint16]) -> None:
    height, width, n_channels = image.shape
    for y in range(height):
        for x in range(width):
            luma = np.uint32(0)
            for channel in range(n_channels):
                luma += np.uint32(image[y, x, channel]) * np.uint32(weights[channel])
            grey[y, x] = luma

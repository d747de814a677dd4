"""Census transform: what a pixel's surroundings look like, whatever the exposure.

Source: Zabih and Woodfill, Non-parametric local transforms for computing visual correspondence, ECCV 1994.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

RADIUS = 2  # Table 2: a window of 5x5
N_BITS = 24  # one for each neighbour
BEHIND = np.uint32(0xFF000000)  # bits above the code, set on the background: costly to match from the foreground


def grey_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Luma (H, W) of an sRGB image (H, W, 3); a grey image as it is."""
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def census(grey: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """The census code of every pixel: one bit for each neighbour in a 5x5 window that is darker than the centre.

    Parameters
    ----------
    grey : uint8 (H, W); beyond the border the nearest pixel is repeated

    Returns
    -------
    codes : uint32 (H, W), 24 bits, the top-left neighbour in the highest
    """
    codes = np.empty(grey.shape, dtype=np.uint32)
    _census_kernel(np.pad(grey, RADIUS, mode="edge"), codes)
    return codes


@njit(cache=True, nogil=True)
def _census_kernel(padded: NDArray[np.uint8], codes: NDArray[np.uint32]) -> None:
    height, width = codes.shape
    for y in range(height):
        codes[y] = 0
        for row in range(2 * RADIUS + 1):
            for column in range(2 * RADIUS + 1):
                if row == RADIUS and column == RADIUS:
                    continue
                for x in range(width):
                    darker = np.uint32(padded[y + row, x + column] < padded[y + RADIUS, x + RADIUS])
                    codes[y, x] = np.uint32(codes[y, x] << np.uint32(1)) | darker

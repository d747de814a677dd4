"""The guide of the permeability filter: a picture without its noise, and how freely costs pass between its pixels.

Source: Cigla and Alatan, Information permeability for stereo matching, Signal Processing: Image Communication 28, 2013.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.capture.noise import largest_channel, noise_deviation

CLOSED = 255  # a change of the guide that nothing passes
GUIDE_WINDOW = 5  # pixels, of the bilateral filter
GUIDE_REACH = 2.0  # pixels, its spatial deviation
STRONG_NOISE = 2.0  # grey levels, from which the filter is applied twice
ONE_PASS, TWO_PASSES = (2.5,), (1.5, 1.5)  # its deviations in grey levels, in units of the image's noise
MIN_NOISE = 0.1  # grey levels; a rendered image has none, the filter needs some
MAX_NOISE = 8.0  # grey levels; what varies more is texture
NOISE_SHARE = 0.7  # mean change of a still scene's guide, in units of the images' noise; measured at 4 grey levels
NEIGHBOURHOOD = 5  # pixels: the picture counts as changed where the mean over the census window has


def noise_level(grey: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None) -> float:
    """Estimate the standard deviation of the noise of an image, uint8 (H, W): grey levels, between 0.1 and 8."""
    return min(max(noise_deviation(grey, mask), MIN_NOISE), MAX_NOISE)


def guide_image(image: NDArray[np.uint8], noise: float) -> NDArray[np.uint8]:
    """Make the image whose edges stop the flow of costs: noise taken out, edges kept.

    A 3x3 median, then a bilateral filter as wide as the noise, twice if that is strong: noise left in the guide closes
    every passage, and a second narrow pass loses fewer edges than one wide pass.

    Parameters
    ----------
    image : uint8 (H, W, 3) or (H, W)
    noise : standard deviation, grey levels
    """
    smooth = cv2.medianBlur(np.ascontiguousarray(image), 3)
    for tolerance in ONE_PASS if noise < STRONG_NOISE else TWO_PASSES:
        smooth = cv2.bilateralFilter(smooth, GUIDE_WINDOW, tolerance * noise, GUIDE_REACH)
    return np.asarray(smooth, dtype=np.uint8)


def change_beyond_noise(before: NDArray[np.uint8], after: NDArray[np.uint8], noise: float) -> NDArray[np.float32]:
    """Measure how much a guide changed in time, float32 (H, W), grey levels, less what noise alone explains.

    Of the channel that changed most, the mean over a census window, because an edge that moves past changes what is
    seen around it.

    Parameters
    ----------
    before, after : guides, uint8 (H, W, 3) or (H, W)
    noise : of the images, standard deviation, grey levels
    """
    change = largest_channel(cv2.absdiff(before, after)).astype(np.float32)
    mean = np.asarray(cv2.blur(change, (NEIGHBOURHOOD, NEIGHBOURHOOD)), np.float32)
    return np.asarray(np.maximum(mean - np.float32(NOISE_SHARE * noise), np.float32(0)))


class Passages(NamedTuple):
    """How freely costs pass from each pixel to its right and its lower neighbour: `passage[across]`, `passage[down]`.

    across, down : uint8 (H, W), how much the guide changes, grey levels; 255 where nothing passes
    passage : float32 (256,), exp(-change / sigma), 0 for 255
    """

    across: NDArray[np.uint8]
    down: NDArray[np.uint8]
    passage: NDArray[np.float32]


def permeabilities(guide: NDArray[np.uint8], *, sigma: float, mask: NDArray[np.bool_] | None = None) -> Passages:
    """Compute how freely costs pass between neighbours; none pass beyond the last column and the last row.

    Parameters
    ----------
    guide : uint8 (H, W, 3) or (H, W); the channel that differs most decides
    sigma : grey levels
    mask : bool (H, W); nothing passes its border

    Source: Cigla and Alatan 2013, equation 2.
    """
    passage = np.exp(-np.arange(256, dtype=np.float64) / sigma).astype(np.float32)
    passage[CLOSED] = 0
    across, down = np.empty(guide.shape[:2], np.uint8), np.empty(guide.shape[:2], np.uint8)
    _change_kernel(guide.reshape(*guide.shape[:2], -1), across, down)
    if mask is not None:
        across[:, :-1][mask[:, 1:] != mask[:, :-1]] = CLOSED
        down[:-1][mask[1:] != mask[:-1]] = CLOSED
    return Passages(across, down, passage)


@njit(cache=True, nogil=True)
def _change_kernel(guide: NDArray[np.uint8], across: NDArray[np.uint8], down: NDArray[np.uint8]) -> None:
    height, width, n_channels = guide.shape
    across[:, width - 1] = CLOSED
    down[height - 1] = CLOSED
    for y in range(height):
        for x in range(width):
            to_right, to_below = np.int32(0), np.int32(0)
            for channel in range(n_channels):
                here = np.int32(guide[y, x, channel])
                if x + 1 < width:
                    to_right = max(to_right, abs(here - np.int32(guide[y, x + 1, channel])))
                if y + 1 < height:
                    to_below = max(to_below, abs(here - np.int32(guide[y + 1, x, channel])))
            if x + 1 < width:
                across[y, x] = to_right
            if y + 1 < height:
                down[y, x] = to_below

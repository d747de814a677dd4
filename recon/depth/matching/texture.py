"""A view as PatchMatch's windows read it: colour, grey and gradient, packed so that a window's row is one register."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.channels import colour_image
from recon.depth.matching.lanes import N_LANES
from recon.depth.matching.views import View

WINDOW_REACH = (
    16  # pixels: a window spans 33 rows and columns (Bleyer et al.: 35), of which every other column is looked at
)
PAD = WINDOW_REACH  # columns repeated left and right, flagged in the colours' fourth byte
FINE = 4  # places a pixel at which the other view is sampled
GREY_SCALE = 256  # grey levels are held in 256ths


@dataclass(frozen=True, eq=False)
class Texture:
    """A view as windows read it: even columns, then odd ones, so that every other column is a register's lane.

    colours : uint32 (H, 2, half), packed RGB, the fourth byte 255 outside the foreground
    words : int32 (H, 2, half), x-gradient in the upper and grey in the lower 16 bits, in 256ths of a grey level
    fine : int32 (H, 4 (W - 1) + 1), the same words at every quarter of a column
    """

    colours: NDArray[np.uint32]
    words: NDArray[np.int32]
    fine: NDArray[np.int32]


def texture_of(view: View) -> Texture:
    """Pack what windows read of a view; the gradient always points to the right of the scene."""
    grey, mask = view.mirrored(view.grey), None if view.mask is None else view.mirrored(view.mask)
    scale = -0.5 if view.is_right else 0.5
    slope = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=1, scale=scale, borderType=cv2.BORDER_REPLICATE)
    grey = grey.astype(np.float32)
    words = cv2.copyMakeBorder(_words(grey, slope, 1), 0, 0, PAD, PAD, cv2.BORDER_REPLICATE)
    return Texture(
        _by_parity(_packed(view.mirrored(view.image), mask)),
        _by_parity(words),
        _words(grey, slope, FINE),
    )


def _packed(image: NDArray[np.uint8], mask: NDArray[np.bool_] | None) -> NDArray[np.uint32]:
    outside = np.zeros(image.shape[:2], np.uint8) if mask is None else np.where(mask, np.uint8(0), np.uint8(255))
    framed = [cv2.copyMakeBorder(colour_image(image), 0, 0, PAD, PAD, cv2.BORDER_REPLICATE)]
    framed.append(cv2.copyMakeBorder(outside, 0, 0, PAD, PAD, cv2.BORDER_CONSTANT, value=255)[..., None])
    return np.ascontiguousarray(np.concatenate(framed, axis=2)).view(np.uint32)[..., 0]


@njit(cache=True, nogil=True)
def _words(grey: NDArray[np.float32], slope: NDArray[np.float32], fine: int) -> NDArray[np.int32]:
    """Pack grey and gradient (H, W), interpolated linearly at `fine` places a column: (H, fine (W - 1) + 1)."""
    height, width = grey.shape
    words = np.empty((height, fine * (width - 1) + 1), np.int32)
    for y in range(height):
        for place in range(words.shape[1]):
            before = min(place // fine, width - 2)
            part = np.float32(place / fine - before)
            rest = np.float32(1) - part
            upper = np.rint(slope[y, before] * rest + slope[y, before + 1] * part)
            lower = np.rint(grey[y, before] * rest + grey[y, before + 1] * part)
            words[y, place] = np.int32(min(max(upper, -32768), 32767)) << 16 | np.int32(lower)
    return words


def _by_parity(values: NDArray[Any]) -> NDArray[Any]:
    """Sort even columns, then odd ones, into (H, 2, half), with room for a last load."""
    height, width = values.shape
    half = width // 2 + N_LANES + 1
    sorted_ = np.zeros((height, 2, half), values.dtype)
    sorted_[:, 0, : (width + 1) // 2] = values[:, 0::2]
    sorted_[:, 1, : width // 2] = values[:, 1::2]
    return sorted_

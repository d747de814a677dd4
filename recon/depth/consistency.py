"""Left/right check: a match counts when both views found it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Disparities = NDArray[np.int32] | NDArray[np.float32]


def consistent(
    view: Disparities, mirrored: Disparities, *, min_disparity: int = 0, threshold: float = 0
) -> NDArray[np.bool_]:
    """Check each disparity of a view against the pixel of the other view that it points to: bool (H, W).

    A match that lies outside the other image is not confirmed.

    Parameters
    ----------
    view : int32 or float32 (H, W), disparity indices of the one view
    mirrored : int32 or float32 (H, W), those of the other view, columns from right to left; so the check of either
        view against the other is the same
    min_disparity : the disparity of index 0, pixels
    threshold : pixels by which the two may differ; 0 is the total check (Table 2)
    """
    confirmed = np.empty(view.shape, np.bool_)
    _consistency_kernel(
        view.astype(np.float32, copy=False),
        mirrored.astype(np.float32, copy=False),
        min_disparity,
        np.float32(threshold),
        confirmed,
    )
    return confirmed


def lands_inside(disparity: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell where a disparity, float32 (H, W), pixels, points inside the other image: bool (H, W)."""
    width = disparity.shape[1]
    matched = np.arange(width, dtype=np.float32) - disparity
    return np.asarray((matched >= -0.5) & (matched <= width - 0.5))


@njit(cache=True, nogil=True)
def _consistency_kernel(
    view: NDArray[np.float32],
    mirrored: NDArray[np.float32],
    min_disparity: int,
    threshold: float,
    out: NDArray[np.bool_],
) -> None:
    height, width = view.shape
    for y in range(height):
        for x in range(width):
            there = width - 1 - x + np.int64(np.rint(view[y, x])) + min_disparity
            out[y, x] = 0 <= there < width and abs(view[y, x] - mirrored[y, there]) <= threshold

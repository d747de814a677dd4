"""Left/right check: a match counts when both views found it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def consistent(
    view: NDArray[np.int32], mirrored: NDArray[np.int32], *, min_disparity: int = 0, threshold: int = 0
) -> NDArray[np.bool_]:
    """Where a view's disparity is confirmed by the pixel of the other view that it points to.

    Parameters
    ----------
    view : int32 (H, W), disparity indices of the one view
    mirrored : int32 (H, W), those of the other view, columns from right to left; so the check of either view against
        the other is the same
    min_disparity : the disparity of index 0, pixels
    threshold : pixels by which the two may differ; 0 is the total check (Table 2)

    Returns
    -------
    confirmed : bool (H, W); False where the match lies outside the other image
    """
    confirmed = np.empty(view.shape, np.bool_)
    _consistency_kernel(view, mirrored, min_disparity, threshold, confirmed)
    return confirmed


@njit(cache=True, nogil=True)
def _consistency_kernel(
    view: NDArray[np.int32], mirrored: NDArray[np.int32], min_disparity: int, threshold: int, out: NDArray[np.bool_]
) -> None:
    height, width = view.shape
    for y in range(height):
        for x in range(width):
            there = width - 1 - x + view[y, x] + min_disparity
            out[y, x] = 0 <= there < width and abs(view[y, x] - mirrored[y, there]) <= threshold

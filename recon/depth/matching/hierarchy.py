"""Hierarchical matching: where a finer level has to search.

The coarsest level is searched in full. A finer level searches two windows of sixteen disparities around everything
seen in a pixel's surroundings: one from the farthest, one from the nearest. So a large jump is covered from
both sides, and a thin structure by what its neighbours saw of it.
"""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.matching.lanes import N_LANES

Depth = TypeVar("Depth", np.uint8, np.uint16)

TILE_BITS = 3  # a tile of 8x8 fine pixels searches the same windows
TILE = 4  # the same in coarse pixels
REACH = 4  # coarse pixels: how far around its tile a pixel looks for disparities
MARGIN = 2  # fine disparities searched beyond those found
COVERED = (N_LANES - 2 * MARGIN) // 2  # coarse disparities that a window covers with its margins
OWN_VOTES = 4  # of a tile's own pixel, where one around it has 1; from 1 to 30 little changes
UNKNOWN = np.int32(np.iinfo(np.int32).max)


def halved(image: NDArray[Depth]) -> NDArray[Depth]:
    """Halve an image (H, W) or (H, W, 3), rounded up: means of 2x2 pixels, an odd last row or column repeated."""
    even = cv2.copyMakeBorder(image, 0, image.shape[0] % 2, 0, image.shape[1] % 2, cv2.BORDER_REPLICATE)
    size = (even.shape[1] // 2, even.shape[0] // 2)
    return np.asarray(cv2.resize(even, size, interpolation=cv2.INTER_AREA), dtype=image.dtype)


def halved_mask(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Halve a mask, bool (H, W), rounded up: foreground where at least half of the 2x2 pixels are."""
    return np.asarray(halved(mask.view(np.uint8) * np.uint8(254)) >= 127)


def search_windows(
    coarse: NDArray[np.int32], valid: NDArray[np.bool_], shape: tuple[int, int], n_disparities: int, *, shift: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Choose the two windows of sixteen disparities that each tile of the finer level searches.

    Parameters
    ----------
    coarse : int32 (h, w), disparity indices of the coarser level
    valid : bool (h, w), where they count; where none counts nearby, all do
    shape : (H, W) of the finer level
    n_disparities : of the finer level
    shift : the finer level's index of twice the disparity of the coarser level's index 0

    Returns
    -------
    far, near : int32 (H / 8, W / 8), rounded up: the first disparity index of each window of a tile of 8x8 pixels;
        equal where one window covers all
    """
    n_rows, n_columns = -(-shape[0] // (2 * TILE)), -(-shape[1] // (2 * TILE))
    starts = np.empty((2, n_rows, n_columns), np.int32)
    votes = np.empty(int(coarse.max()) + 1, np.int32)
    _window_kernel(coarse, valid, shift, max(n_disparities - N_LANES, 0), votes, starts)
    return starts[0], starts[1]


@njit(cache=True, nogil=True)
def _window_kernel(
    coarse: NDArray[np.int32],
    valid: NDArray[np.bool_],
    shift: int,
    last_start: int,
    votes: NDArray[np.int32],
    starts: NDArray[np.int32],
) -> None:
    for row in range(starts.shape[1]):
        for column in range(starts.shape[2]):
            everything = False
            low, high = _range(coarse, valid, row, column, everything)
            if low > high:
                everything = True
                low, high = _range(coarse, valid, row, column, everything)
            far, near = 2 * low + shift - MARGIN, 2 * high + shift + MARGIN + 2 - N_LANES
            if near <= far:
                far = near = (far + near) // 2
            elif near > far + N_LANES:
                _count(coarse, valid, row, column, everything, low, votes[: high - low + 1])
                first, second = _fullest_two(votes[: high - low + 1])
                far, near = 2 * (low + first) + shift - MARGIN, 2 * (low + second) + shift - MARGIN
            starts[0, row, column] = min(max(far, 0), last_start)
            starts[1, row, column] = min(max(near, 0), last_start)


@njit(inline="always")
def _range(
    coarse: NDArray[np.int32], valid: NDArray[np.bool_], row: int, column: int, everything: bool
) -> tuple[np.int32, np.int32]:
    low, high = UNKNOWN, -UNKNOWN
    for y in range(max(row * TILE - REACH, 0), min((row + 1) * TILE + REACH, coarse.shape[0])):
        for x in range(max(column * TILE - REACH, 0), min((column + 1) * TILE + REACH, coarse.shape[1])):
            if everything or valid[y, x]:
                low, high = min(low, coarse[y, x]), max(high, coarse[y, x])
    return low, high


@njit(inline="always")
def _count(
    coarse: NDArray[np.int32],
    valid: NDArray[np.bool_],
    row: int,
    column: int,
    everything: bool,
    low: int,
    votes: NDArray[np.int32],
) -> None:
    """Count the pixels around a tile that have each disparity from `low` on; the tile's own count several times."""
    votes[:] = 0
    for y in range(max(row * TILE - REACH, 0), min((row + 1) * TILE + REACH, coarse.shape[0])):
        for x in range(max(column * TILE - REACH, 0), min((column + 1) * TILE + REACH, coarse.shape[1])):
            if everything or valid[y, x]:
                is_own = y // TILE == row and x // TILE == column
                votes[coarse[y, x] - low] += OWN_VOTES if is_own else 1


@njit(inline="always")
def _fullest_two(votes: NDArray[np.int32]) -> tuple[int, int]:
    """Find the two runs of disparities, each as long as a window covers, that together have the most votes."""
    votes_of_first, votes_of_second = 0, 0  # as both windows slide
    for k in range(COVERED):
        votes_of_first += int(votes[k])
        votes_of_second += int(votes[COVERED + k])
    first, fullest, fullest_pair = 0, -1, -1
    pair = (0, 0)
    for second in range(COVERED, votes.shape[0] - COVERED + 1):
        before = second - COVERED
        if votes_of_first > fullest:
            first, fullest = before, votes_of_first
        if fullest + votes_of_second > fullest_pair:
            fullest_pair = fullest + votes_of_second
            pair = first, second
        if second + COVERED < votes.shape[0]:
            votes_of_first += int(votes[second]) - int(votes[before])
            votes_of_second += int(votes[second + COVERED]) - int(votes[second])
    return pair

"""Permeability filter: costs flow along rows and columns and stop at edges of the picture.

Nothing of size (H, W, disparities) is ever held: a block of disparities is aggregated at a time, the disparity
contiguous in memory, and the winner so far is kept. The upward pass and the winner-takes-all are one loop.

Source: Cigla and Alatan, Information permeability for stereo matching, Signal Processing: Image Communication 28, 2013.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

BLOCK = 16  # disparities aggregated at a time: one vector register of float32
INDEX_MASK = 15  # a disparity's place in its block, kept in the lowest bits of its cost


def permeabilities(
    grey: NDArray[np.uint8], *, sigma: float, mask: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """How freely costs pass from each pixel to its right and its lower neighbour.

    Parameters
    ----------
    grey : uint8 (H, W); a 3x3 median of it is the guide, because noise would close every passage
    sigma : grey levels
    mask : bool (H, W); nothing passes its border

    Returns
    -------
    across, down : float32 (H, W), exp(-|difference| / sigma); zero in the last column and the last row

    Source
    ------
    Cigla and Alatan 2013, equation 2.
    """
    guide = cv2.medianBlur(grey, 3).astype(np.int16)
    passage = np.exp(-np.arange(256, dtype=np.float64) / sigma).astype(np.float32)
    across, down = np.zeros(grey.shape, np.float32), np.zeros(grey.shape, np.float32)
    across[:, :-1] = passage[np.abs(np.diff(guide, axis=1))]
    down[:-1] = passage[np.abs(np.diff(guide, axis=0))]
    if mask is not None:
        across[:, :-1] *= mask[:, 1:] == mask[:, :-1]
        down[:-1] *= mask[1:] == mask[:-1]
    return across, down


@intrinsic
def _bit_count(typing_context: Any, value: Any) -> Any:  # noqa: ARG001  # numba's signature
    """Number of set bits of a uint32, by the processor's own instruction."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001  # numba's signature
        return builder.ctpop(arguments[0])

    return types.uint32(types.uint32), generate


@njit(cache=True, nogil=True)
def aggregate_and_choose(
    codes: NDArray[np.uint32],
    candidates: NDArray[np.uint32],
    across: NDArray[np.float32],
    down: NDArray[np.float32],
    n_disparities: int,
    tie: int,
    best: NDArray[np.int32],
    winner: NDArray[np.int32],
) -> None:
    """Aggregate the Hamming costs of all disparities and keep each pixel's cheapest.

    Parameters
    ----------
    codes : uint32 (H, W), census of the reference view
    candidates : uint32 (H, W - 1 + D), so that pixel x at disparity index k faces `candidates[y, W - 1 - x + k]`;
        D is `n_disparities` rounded up to whole blocks
    across, down : float32 (H, W), see `permeabilities`
    tie : 0, the first of equally cheap disparities wins; 1, the last
    best : int32 (H, W), out: the bits of the winner's float32 cost, with its index in the lowest bits
    winner : int32 (H, W), out: the winner's disparity index
    """
    height, width = codes.shape
    n_blocks = (candidates.shape[1] - width + 1) // BLOCK
    downward = np.empty((height + 1, width, BLOCK), np.float32)
    downward[0] = 0
    cost = np.empty((width, BLOCK), np.float32)
    forward = np.empty((width, BLOCK), np.float32)
    flow = np.empty(BLOCK, np.float32)
    upward = np.empty((width, BLOCK), np.float32)
    total = np.empty(BLOCK, np.float32)
    flip = np.int32(tie * INDEX_MASK)
    best[:] = 0x7F800000
    for step in range(n_blocks):
        first = (n_blocks - 1 - step if tie else step) * BLOCK
        for y in range(height):
            flow[:] = 0
            for x in range(width):
                passage = across[y, x - 1] if x > 0 else np.float32(0)
                start = width - 1 - x + first
                for k in range(BLOCK):
                    cost[x, k] = np.float32(_bit_count(codes[y, x] ^ candidates[y, start + k]))
                    flow[k] = cost[x, k] + passage * flow[k]
                    forward[x, k] = flow[k]
            flow[:] = 0
            for x in range(width - 1, -1, -1):
                from_above = down[y - 1, x] if y > 0 else np.float32(0)
                for k in range(BLOCK):
                    beyond = across[y, x] * flow[k]
                    flow[k] = cost[x, k] + beyond
                    downward[y + 1, x, k] = forward[x, k] + beyond + from_above * downward[y, x, k]
        upward[:] = 0
        for y in range(height - 1, -1, -1):
            for x in range(width):
                from_above = down[y - 1, x] if y > 0 else np.float32(0)
                for k in range(BLOCK):
                    from_below = down[y, x] * upward[x, k]
                    total[k] = downward[y + 1, x, k] + from_below
                    upward[x, k] = downward[y + 1, x, k] - from_above * downward[y, x, k] + from_below
                lowest = np.int32(0x7FFFFFFF)
                keys = total.view(np.int32)
                for k in range(min(BLOCK, n_disparities - first)):
                    key = np.int32((keys[k] & np.int32(~INDEX_MASK)) | np.int32(k ^ flip))
                    lowest = min(lowest, key)
                if lowest & np.int32(~INDEX_MASK) < best[y, x] & np.int32(~INDEX_MASK):
                    best[y, x] = lowest
                    winner[y, x] = first + ((lowest & np.int32(INDEX_MASK)) ^ flip)

"""How the surfaces that a coarser level found rise, so that the costs of a finer level flow along them.

On a slanted wall, costs that flow at one disparity soon leave the wall; where its texture is weak they flow far, and
the wall turns into steps. So each tile takes the mean rise of the surface around it, gathered as far as costs flow.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.guide import Passages
from recon.depth.hierarchy import TILE

SPAN = 2  # coarse pixels: a rise is measured from here before a pixel to here behind it
MAX_RISE = 1.5  # coarse pixels of disparity over that distance; what rises more belongs to two surfaces
FADE = np.float32(np.exp(-1 / 32))  # passes a pixel of a plain picture: a bent surface has other slopes far away
LEVEL_PIXELS = np.float32(20)  # that count as level in every mean: a few rises tell little; with 8, steep walls gain


def tile_slopes(
    disparity: NDArray[np.float32], valid: NDArray[np.bool_], passages: Passages
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Measure how the disparities of a coarser level rise in each tile of the finer level.

    Parameters
    ----------
    disparity : float32 (h, w), disparity indices of the coarser level
    valid : bool (h, w), where they count
    passages : of the coarser level; slopes are averaged as far as costs pass

    Returns
    -------
    across, down : float32 (H / 8, W / 8), rounded up, for tiles of 8x8 pixels of the finer level: pixels of disparity
        a column to the right, and a row down; 0 where nothing is known
    """
    rises = np.zeros((*disparity.shape, 3), np.float32)  # across, down, and how many
    _rise_kernel(disparity, valid, rises)
    for change in (passages.across, passages.down.T):
        passage = np.ascontiguousarray(passages.passage[change] * FADE)
        rises = np.ascontiguousarray(_gathered_along_rows(rises, passage).transpose(1, 0, 2))
    across, down, n = np.moveaxis(rises[::TILE, ::TILE], 2, 0)
    distance = 2 * SPAN * (n + LEVEL_PIXELS)
    return np.ascontiguousarray(across / distance), np.ascontiguousarray(down / distance)


@njit(cache=True, nogil=True)
def _rise_kernel(disparity: NDArray[np.float32], valid: NDArray[np.bool_], rises: NDArray[np.float32]) -> None:
    """Write how much disparities rise around each pixel, and 1, where the places before and behind it count."""
    height, width = disparity.shape
    for y in range(SPAN, height - SPAN):
        for x in range(SPAN, width - SPAN):
            if valid[y, x - SPAN] and valid[y, x + SPAN] and valid[y - SPAN, x] and valid[y + SPAN, x]:
                across = disparity[y, x + SPAN] - disparity[y, x - SPAN]
                down = disparity[y + SPAN, x] - disparity[y - SPAN, x]
                if max(abs(across), abs(down)) <= np.float32(MAX_RISE):
                    rises[y, x, 0], rises[y, x, 1], rises[y, x, 2] = across, down, 1


@njit(cache=True, nogil=True)
def _gathered_along_rows(values: NDArray[np.float32], passage: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add to the values, float32 (H, W, 3), of each pixel those that pass to it along its row from both sides."""
    height, width, n_values = values.shape
    gathered = values.copy()
    from_right = np.empty(n_values, np.float32)
    for y in range(height):
        for x in range(1, width):
            for k in range(n_values):
                gathered[y, x, k] += passage[y, x - 1] * gathered[y, x - 1, k]
        from_right[:] = 0
        for x in range(width - 2, -1, -1):
            for k in range(n_values):
                from_right[k] = passage[y, x] * (from_right[k] + values[y, x + 1, k])
                gathered[y, x, k] += from_right[k]
    return gathered

"""How the surfaces that a coarser level found rise, so that the costs of a finer level flow along them.

On a slanted wall, costs that flow at one disparity soon leave the wall; where its texture is weak they flow far, and
the wall turns into steps. So each tile takes the mean rise of the surface around it, as far as this goes without a
jump. Edges of the picture do not end it: strong texture has them all over a surface.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.matching.hierarchy import TILE

SPAN = 2  # coarse pixels: a rise is measured from here before a pixel to here behind it
MAX_RISE = 2.5  # coarse pixels of disparity over that distance; what rises more belongs to two surfaces
MAX_STEP = 1.0  # coarse pixels of disparity from one pixel of a surface to the next
FADE = np.float32(np.exp(-1 / 16))  # share that passes from pixel to pixel: a bent surface has other slopes far away
LEVEL_PIXELS = np.float32(5)  # that count as level in every mean, because a few rises tell little


def tile_slopes(
    disparity: NDArray[np.float32], valid: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Measure how the disparities of a coarser level rise in each tile of the finer level.

    Parameters
    ----------
    disparity : float32 (h, w), disparity indices of the coarser level
    valid : bool (h, w), where they count

    Returns
    -------
    across, down : float32 (H / 8, W / 8), rounded up, for tiles of 8x8 pixels of the finer level: pixels of disparity
        a column to the right, and a row down; 0 where nothing is known
    """
    rises = np.zeros((*disparity.shape, 3), np.float32)  # across, down, and how many
    _rise_kernel(disparity, valid, rises)
    for surface in (disparity, np.ascontiguousarray(disparity.T)):
        rises = np.ascontiguousarray(_gathered_along_rows(rises, surface).transpose(1, 0, 2))
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
def _gathered_along_rows(values: NDArray[np.float32], surface: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add to the values, float32 (H, W, 3), of each pixel those on both sides in its row, as far as no jump ends it."""
    height, width, n_values = values.shape
    gathered = values.copy()
    from_right = np.empty(n_values, np.float32)
    for y in range(height):
        for x in range(1, width):
            if abs(surface[y, x] - surface[y, x - 1]) <= np.float32(MAX_STEP):
                for k in range(n_values):
                    gathered[y, x, k] += FADE * gathered[y, x - 1, k]
        from_right[:] = 0
        for x in range(width - 2, -1, -1):
            is_same_surface = abs(surface[y, x + 1] - surface[y, x]) <= np.float32(MAX_STEP)
            for k in range(n_values):
                from_right[k] = FADE * (from_right[k] + values[y, x + 1, k]) if is_same_surface else np.float32(0)
                gathered[y, x, k] += from_right[k]
    return gathered

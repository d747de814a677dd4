"""Where a surface can be: the blocks of grid samples near the points.

Only these exist, so that memory grows with the surface and not with the volume around it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.surface.blocks import block_coordinates, block_keys, directions, neighbours_in
from recon.surface.cells import Cells

REACH = 2.0  # voxels; a cell of the grid that the surface crosses has its corners within sqrt(3) of it


@dataclass(frozen=True, eq=False)
class Band:
    """The blocks whose samples may lie beside the surface.

    Parameters
    ----------
    blocks : int64 (B, 3), coordinates; sample (i, j, k) of block b lies at `(8 b + (i, j, k)) voxel`, mm, world
    neighbours : int32 (B, 27), index of each of the blocks around and of itself (13); -1 where there is none
    """

    blocks: NDArray[np.int64]
    neighbours: NDArray[np.int32]


def band_around(cells: Cells) -> Band:
    """Find the blocks with a sample within reach of a cell's mean point."""
    touched = _touched_neighbours(cells.starts, cells.moments, REACH)
    lowest = cells.blocks.min(axis=0) - 1
    owners, towards = np.nonzero(touched)
    blocks = cells.blocks[owners] - lowest + directions()[towards]
    keys = np.unique(block_keys(blocks))
    return Band(block_coordinates(keys) + lowest, neighbours_in(block_coordinates(keys) + lowest, keys, lowest))


def neighbours_of(band: Band, cells: Cells) -> NDArray[np.int32]:
    """Look up the blocks around each of the band's, int32 (B, 27): index in `cells.blocks`, -1 without points."""
    lowest = cells.blocks.min(axis=0) - 2
    return neighbours_in(band.blocks, block_keys(cells.blocks - lowest), lowest)


@njit(cache=True)
def _touched_neighbours(starts: NDArray[np.int64], moments: NDArray[np.float32], reach: float) -> NDArray[np.bool_]:
    """Mark the blocks around each, bool (O, 27), with a sample within `reach` of one of its cells along every axis."""
    touched = np.zeros((len(starts) - 1, 27), np.bool_)
    for block in range(len(starts) - 1):
        for cell in range(starts[block], starts[block + 1]):
            x, y, z = moments[cell, 0], moments[cell, 1], moments[cell, 2]
            for i in range(0 if x <= reach - 1 else 1, 3 if x >= 8 - reach else 2):
                for j in range(0 if y <= reach - 1 else 1, 3 if y >= 8 - reach else 2):
                    for k in range(0 if z <= reach - 1 else 1, 3 if z >= 8 - reach else 2):
                        touched[block, 9 * i + 3 * j + k] = True
    return touched

"""Blocks of grid samples, which exist only near points: their keys and their neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLOCK = 8  # samples along a block's edge
SAMPLES = BLOCK**3
AXIS_BITS = 18  # of a block's coordinate; three axes and nine bits inside a block fill an int64
LARGEST_AXIS = 2**AXIS_BITS - 3  # room for the band on either side, and for its neighbours


def neighbours_in(blocks: NDArray[np.int64], keys: NDArray[np.int64], lowest: NDArray[np.int64]) -> NDArray[np.int32]:
    """Look up the 27 blocks around each block.

    Parameters
    ----------
    blocks : int64 (B, 3), coordinates
    keys : int64 (K,), sorted, of the blocks that exist
    lowest : int64 (3,), the coordinates from which the keys are counted

    Returns
    -------
    int32 (B, 27), index in `keys`, -1 where the block does not exist
    """
    table = np.empty((len(blocks), 27), np.int32)
    for number, direction in enumerate(directions()):
        wanted = block_keys(blocks - lowest + direction)
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        table[:, number] = np.where(keys[place] == wanted, place, -1)
    return table


def directions() -> NDArray[np.int64]:
    """List the steps to a block's neighbours, int64 (27, 3): x, y, z stands at 9 (x + 1) + 3 (y + 1) + z + 1."""
    return np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), axis=-1).reshape(27, 3)


def block_keys(blocks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pack the coordinates of blocks (B, 3), none below 0, into sortable keys int64 (B,)."""
    return np.asarray((blocks[:, 0] << 2 * AXIS_BITS) | (blocks[:, 1] << AXIS_BITS) | blocks[:, 2])


def block_coordinates(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Unpack the keys (B,) of blocks into coordinates int64 (B, 3)."""
    mask = (1 << AXIS_BITS) - 1
    return np.stack([keys >> 2 * AXIS_BITS, (keys >> AXIS_BITS) & mask, keys & mask], axis=1)

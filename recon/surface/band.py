"""Where a surface can be: blocks of grid samples near the points, and the points gathered into cells of that grid.

Only blocks near points exist, so that memory grows with the surface and not with the volume around it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.mesh import Cloud

BLOCK = 8  # samples along a block's edge
SAMPLES = BLOCK**3
REACH = 2.0  # voxels; a cell of the grid that the surface crosses has its corners within sqrt(3) of it
AXIS_BITS = 18  # of a block's coordinate; three axes and nine bits inside a block fill an int64
LARGEST_AXIS = 2**AXIS_BITS - 2  # one block of room on either side
WEIGHT_RANGE = (1 / 16, 4.0)  # of a point against the median: no single sensor is ignored or trusted alone


@dataclass(frozen=True, eq=False)
class Cells:
    """Points gathered by voxel: the sums that an algebraic sphere is fitted to, about each cell's mean point.

    Parameters
    ----------
    blocks : int64 (O, 3), coordinates of the blocks that hold points, in the order of their keys
    starts : int64 (O + 1,), first cell of each block; cells of a block stand together
    moments : float32 (C, 12): mean point from the block's corner (3), weight, mean normal (3), covariance of point
        and normal (trace), spread of the points (trace), mean colour (3); lengths in voxels
    """

    blocks: NDArray[np.int64]
    starts: NDArray[np.int64]
    moments: NDArray[np.float32]


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


def extent_in_blocks(cloud: Cloud, voxel: float) -> int:
    """Blocks along the longest side of the cloud's bounding box."""
    size = float((cloud.points.max(axis=0) - cloud.points.min(axis=0)).max())
    return int(size / (voxel * BLOCK)) + 1


def gather(cloud: Cloud, voxel: float) -> Cells:
    """Gather a cloud's points into cells one voxel wide, in an order that depends on nothing but the points.

    Raises
    ------
    ValueError
        If the bounding box is too many voxels wide to be numbered.
    """
    if extent_in_blocks(cloud, voxel) > LARGEST_AXIS:
        raise ValueError(f"the cloud is more than {LARGEST_AXIS * BLOCK} voxels of {voxel:g} mm wide")
    in_voxels = cloud.points.astype(np.float64) / voxel
    cells = np.floor(in_voxels).astype(np.int64)
    lowest = (cells >> 3).min(axis=0) - 1
    keys = _block_keys((cells >> 3) - lowest) << 9 | _local(cells)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1], [True]]))
    block_keys = keys[starts[:-1]] >> 9
    block_starts = np.flatnonzero(np.concatenate([[True], block_keys[1:] != block_keys[:-1], [True]]))
    moments = cell_moments(in_voxels, cloud.normals, cloud.colours, _weights(cloud), order, starts)
    return Cells(_block_coordinates(block_keys[block_starts[:-1]]) + lowest, block_starts, moments)


def band_around(cells: Cells) -> Band:
    """The blocks with a sample within reach of a cell's mean point."""
    touched = touched_neighbours(cells.starts, cells.moments, REACH)
    lowest = cells.blocks.min(axis=0) - 1
    owners, directions = np.nonzero(touched)
    blocks = cells.blocks[owners] - lowest + _directions()[directions]
    keys = np.unique(_block_keys(blocks))
    return Band(_block_coordinates(keys) + lowest, neighbours_in(_block_coordinates(keys) + lowest, keys, lowest))


def neighbours_in(blocks: NDArray[np.int64], keys: NDArray[np.int64], lowest: NDArray[np.int64]) -> NDArray[np.int32]:
    """Index of each of the 27 blocks around `blocks` (B, 3) among `keys` (sorted, counted from `lowest`)."""
    table = np.empty((len(blocks), 27), np.int32)
    for number, direction in enumerate(_directions()):
        wanted = _block_keys(blocks - lowest + direction)
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        table[:, number] = np.where(keys[place] == wanted, place, -1)
    return table


def neighbours_of(band: Band, cells: Cells) -> NDArray[np.int32]:
    """int32 (B, 27): index among the blocks that hold points of each block around each of the band's."""
    lowest = cells.blocks.min(axis=0) - 2
    return neighbours_in(band.blocks, _block_keys(cells.blocks - lowest), lowest)


def _directions() -> NDArray[np.int64]:
    """int64 (27, 3): the steps to a block's neighbours; number 9 (x + 1) + 3 (y + 1) + z + 1."""
    return np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), axis=-1).reshape(27, 3)


def _block_keys(blocks: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray((blocks[:, 0] << 2 * AXIS_BITS) | (blocks[:, 1] << AXIS_BITS) | blocks[:, 2])


def _block_coordinates(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    mask = (1 << AXIS_BITS) - 1
    return np.stack([keys >> 2 * AXIS_BITS, (keys >> AXIS_BITS) & mask, keys & mask], axis=1)


def _local(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    inside = cells & (BLOCK - 1)
    return np.asarray((inside[:, 0] << 6) | (inside[:, 1] << 3) | inside[:, 2])


def _weights(cloud: Cloud) -> NDArray[np.float64]:
    """float64 (N,): inverse variance of each point against the median one; 1 where no uncertainty is known."""
    if cloud.sigma is None:
        return np.ones(len(cloud))
    relative = (float(np.median(cloud.sigma)) / cloud.sigma.astype(np.float64)) ** 2
    return np.asarray(np.clip(relative, *WEIGHT_RANGE))


@njit(parallel=True, cache=True)
def cell_moments(
    points: NDArray[np.float64],
    normals: NDArray[np.float32],
    colours: NDArray[np.uint8],
    weights: NDArray[np.float64],
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
) -> NDArray[np.float32]:
    """The moments (C, 12) of `Cells`: cell c holds the points `order[starts[c] : starts[c + 1]]`, in voxels."""
    moments = np.empty((len(starts) - 1, 12), np.float32)
    for cell in prange(len(starts) - 1):
        sums = np.zeros(12)
        corner = np.floor(points[order[starts[cell]]] / 8) * 8
        for place in range(starts[cell], starts[cell + 1]):
            index = order[place]
            weight = weights[index]
            along = square = 0.0
            for axis in range(3):
                local = points[index, axis] - corner[axis]
                normal = float(normals[index, axis])
                sums[axis] += weight * local
                sums[4 + axis] += weight * normal
                sums[9 + axis] += weight * colours[index, axis]
                along += local * normal
                square += local * local
            sums[3] += weight
            sums[7] += weight * along
            sums[8] += weight * square
        total = sums[3]
        for moment in range(12):
            sums[moment] /= total
        for axis in range(3):
            sums[7] -= sums[axis] * sums[4 + axis]
            sums[8] -= sums[axis] * sums[axis]
        sums[3] = total
        sums[8] = max(sums[8], 0.0)
        moments[cell] = sums
    return moments


@njit(cache=True)
def touched_neighbours(starts: NDArray[np.int64], moments: NDArray[np.float32], reach: float) -> NDArray[np.bool_]:
    """bool (O, 27): which blocks around each have a sample within `reach` of one of its cells along every axis."""
    touched = np.zeros((len(starts) - 1, 27), np.bool_)
    for block in range(len(starts) - 1):
        for cell in range(starts[block], starts[block + 1]):
            x, y, z = moments[cell, 0], moments[cell, 1], moments[cell, 2]
            for i in range(0 if x <= reach - 1 else 1, 3 if x >= 8 - reach else 2):
                for j in range(0 if y <= reach - 1 else 1, 3 if y >= 8 - reach else 2):
                    for k in range(0 if z <= reach - 1 else 1, 3 if z >= 8 - reach else 2):
                        touched[block, 9 * i + 3 * j + k] = True
    return touched

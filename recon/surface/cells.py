"""A cloud's points gathered into cells one voxel wide, to which algebraic spheres are fitted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud
from recon.runtime.workers import in_bands
from recon.surface.blocks import BLOCK, LARGEST_AXIS, block_coordinates, block_keys, neighbours_in

BLOCKS_PER_AREA = 1.5  # blocks that a block's side of surface crosses, averaged over directions
WEIGHT_RANGE = (1 / 16, 4.0)  # of a point against the median: no single sensor is ignored or trusted alone


@dataclass(frozen=True)
class Reach:
    """How far a point's influence goes: the largest of three lengths, at most the eight voxels of a block.

    Parameters
    ----------
    voxels, spacings, sigmas : in voxels, in distances of neighbouring points, in standard deviations of their depth
    """

    voxels: float
    spacings: float
    sigmas: float


@dataclass(frozen=True, eq=False)
class Cells:
    """Points gathered by voxel: the sums that an algebraic sphere is fitted to, about each cell's mean point.

    Parameters
    ----------
    blocks : int64 (O, 3), coordinates of the blocks that hold points, in the order of their keys
    starts : int64 (O + 1,), first cell of each block; cells of a block stand together
    moments : float32 (C, 14): mean point from the block's corner (3), weight, mean normal (3), covariance of point
        and normal (trace), spread of the points (trace), mean colour (3), radius of influence, number of
        points; lengths in voxels
    """

    blocks: NDArray[np.int64]
    starts: NDArray[np.int64]
    moments: NDArray[np.float32]


def extent_in_blocks(cloud: Cloud, voxel: float) -> int:
    """Count the blocks along the longest side of the cloud's bounding box."""
    lowest, highest = _bounding_box(cloud.points)
    return int((highest - lowest).max() / (voxel * BLOCK)) + 1


def gather(cloud: Cloud, voxel: float, reach: Reach) -> Cells:
    """Gather a cloud's points into cells one voxel wide, in an order that depends on nothing but the points.

    Parameters
    ----------
    cloud : at least one point
    voxel : mm
    reach : of a point's influence

    Raises
    ------
    ValueError
        If the bounding box is too many voxels wide to be numbered.
    """
    if extent_in_blocks(cloud, voxel) > LARGEST_AXIS:
        raise ValueError(f"the cloud is more than {LARGEST_AXIS * BLOCK} voxels of {voxel:g} mm wide")
    blocks, order, point_starts = numbered_by_block(cloud.points, voxel)
    sigma = np.zeros(len(cloud), np.float32) if cloud.sigma is None else cloud.sigma
    n_cells = np.zeros(len(point_starts), np.int64)
    in_bands(len(blocks), partial(_count_cells, cloud.points, order, point_starts, voxel, n_cells))
    starts = np.cumsum(n_cells)
    moments = np.empty((starts[-1], 14), np.float32)
    points = _Points(cloud.points, cloud.normals, cloud.colours, _weights(cloud), sigma)
    in_bands(len(blocks), partial(_sum_cells, points, order, point_starts, voxel, starts, moments))
    cells = Cells(blocks, starts, moments)
    _set_radius(cells, np.diff(point_starts), reach)
    return cells


def numbered_by_block(
    points: NDArray[np.float32], voxel: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Sort points (N, 3), mm, into blocks of cells one voxel wide.

    Returns
    -------
    blocks : int64 (B, 3), coordinates of those that hold points, in the order of their keys
    order, starts : int64 (N,) and (B + 1,), block b holds the points `order[starts[b] : starts[b + 1]]`
    """
    lowest = np.floor(_bounding_box(points)[0] / voxel).astype(np.int64) // BLOCK - 1
    numbers, keys = _number_blocks(points, voxel, lowest)
    rank = np.empty(len(keys), np.int64)
    rank[np.argsort(keys)] = np.arange(len(keys))
    order, starts = _sort_by_block(rank[numbers], len(keys))
    return block_coordinates(np.sort(keys)) + lowest, order, starts


class _Points(NamedTuple):
    """A cloud, with the weight of each point and its standard deviation, mm."""

    places: NDArray[np.float32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
    weights: NDArray[np.float64]
    sigma: NDArray[np.float32]


def _set_radius(cells: Cells, n_points: NDArray[np.int64], reach: Reach) -> None:
    """Turn each cell's depth error, column 12, into its radius of influence; `n_points` (O,) in each block."""
    lowest = cells.blocks.min(axis=0) - 1
    around = neighbours_in(cells.blocks, block_keys(cells.blocks - lowest), lowest)
    points = np.where(around >= 0, n_points[around], 0).sum(axis=1)
    area = BLOCK**2 / BLOCKS_PER_AREA * (around >= 0).sum(axis=1)
    spacing = np.repeat(np.sqrt(area / points), np.diff(cells.starts))
    radius = np.maximum(reach.spacings * spacing, reach.sigmas * cells.moments[:, 12])
    cells.moments[:, 12] = np.clip(radius, reach.voxels, BLOCK)


def _weights(cloud: Cloud) -> NDArray[np.float64]:
    """Weigh each point by its inverse variance over the median one, float64 (N,); 1 where no uncertainty is known."""
    if cloud.sigma is None:
        return np.ones(len(cloud))
    relative = (float(np.median(cloud.sigma)) / cloud.sigma.astype(np.float64)) ** 2
    return np.asarray(np.clip(relative, *WEIGHT_RANGE))


@njit(cache=True)
def _bounding_box(points: NDArray[np.float32]) -> NDArray[np.float64]:
    """Find the lowest and highest corner (2, 3); numpy takes ten times as long along the short axis."""
    box = np.empty((2, 3))
    box[0], box[1] = np.inf, -np.inf
    for index in range(len(points)):
        for axis in range(3):
            box[0, axis] = min(box[0, axis], points[index, axis])
            box[1, axis] = max(box[1, axis], points[index, axis])
    return box


@njit(cache=True)
def _block_of(point: NDArray[np.float32], axis: int, voxel: float) -> int:
    """Find the coordinate along an axis of the block whose cells hold a point."""
    return int(np.floor(np.floor(float(point[axis]) / voxel) / 8))


@njit(cache=True)
def _number_blocks(
    points: NDArray[np.float32], voxel: float, lowest: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number the blocks in the order in which points meet them: each point's number (N,), and the blocks' keys."""
    size = 16
    while size < 2 * len(points):
        size *= 2
    table = np.full(size, -1, np.int64)
    keys = np.empty(len(points), np.int64)
    numbers = np.empty(len(points), np.int64)
    n_blocks = 0
    key = number = -1
    for index in range(len(points)):
        x = _block_of(points[index], 0, voxel) - lowest[0]
        y = _block_of(points[index], 1, voxel) - lowest[1]
        z = _block_of(points[index], 2, voxel) - lowest[2]
        wanted = (x << 36) | (y << 18) | z
        if wanted != key:
            key = wanted
            slot = (x * 73856093 ^ y * 19349663 ^ z * 83492791) & (size - 1)
            while table[slot] >= 0 and keys[table[slot]] != key:
                slot = (slot + 1) & (size - 1)
            if table[slot] < 0:
                table[slot] = n_blocks
                keys[n_blocks] = key
                n_blocks += 1
            number = table[slot]
        numbers[index] = number
    return numbers, keys[:n_blocks].copy()


@njit(cache=True)
def _sort_by_block(numbers: NDArray[np.int64], n_blocks: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sort points (N,) by block, in their given order within each, and find each block's first (n_blocks + 1,)."""
    starts = np.zeros(n_blocks + 1, np.int64)
    for index in range(len(numbers)):
        starts[numbers[index] + 1] += 1
    for block in range(n_blocks):
        starts[block + 1] += starts[block]
    following = starts.copy()
    order = np.empty(len(numbers), np.int64)
    for index in range(len(numbers)):
        order[following[numbers[index]]] = index
        following[numbers[index]] += 1
    return order, starts


@njit(cache=True)
def cell_in_block(point: NDArray[np.float32], voxel: float) -> int:
    """Number the cell of a point, float32 (3,), within its block, 0 to 511."""
    x = int(np.floor(float(point[0]) / voxel)) & 7
    y = int(np.floor(float(point[1]) / voxel)) & 7
    return x << 6 | y << 3 | int(np.floor(float(point[2]) / voxel)) & 7


@njit(cache=True, nogil=True)
def _count_cells(
    points: NDArray[np.float32],
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    voxel: float,
    counts: NDArray[np.int64],
    first: int,
    last: int,
) -> None:
    """Count the cells that hold points of each block `first` to `last`, one place later than the block's.

    Block b holds the points `order[starts[b] : starts[b + 1]]`.
    """
    for block in range(first, last):
        is_cell = np.zeros(512, np.bool_)
        for index in order[starts[block] : starts[block + 1]]:
            is_cell[cell_in_block(points[index], voxel)] = True
        counts[block + 1] = is_cell.sum()


@njit(cache=True, nogil=True)
def _sum_cells(
    points: _Points,
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    voxel: float,
    cell_starts: NDArray[np.int64],
    moments: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    """Write the moments (C, 14) of `Cells` in blocks `first` to `last`, with the mean sigma in place of the radius."""
    for block in range(first, last):
        sums = np.zeros((512, 14))
        corner = np.empty(3)
        for axis in range(3):
            corner[axis] = 8.0 * _block_of(points.places[order[starts[block]]], axis, voxel)
        for index in order[starts[block] : starts[block + 1]]:
            _add_point(points, index, corner, voxel, sums[cell_in_block(points.places[index], voxel)])
        count = cell_starts[block]
        for cell in range(512):
            if sums[cell, 3] > 0:
                _finish_moments(sums[cell], moments[count])
                count += 1


@njit(cache=True)
def _add_point(
    points: _Points, index: int, corner: NDArray[np.float64], voxel: float, sums: NDArray[np.float64]
) -> None:
    """Add a point to its cell's sums (14,)."""
    point, normal, colour = points.places[index], points.normals[index], points.colours[index]
    weight = points.weights[index]
    along = square = 0.0
    for axis in range(3):
        local = float(point[axis]) / voxel - corner[axis]
        sums[axis] += weight * local
        sums[4 + axis] += weight * float(normal[axis])
        sums[9 + axis] += weight * colour[axis]
        along += local * float(normal[axis])
        square += local * local
    sums[3] += weight
    sums[7] += weight * along
    sums[8] += weight * square
    sums[12] += weight * float(points.sigma[index]) / voxel
    sums[13] += 1


@njit(cache=True)
def _finish_moments(sums: NDArray[np.float64], moments: NDArray[np.float32]) -> None:
    """Turn a cell's sums into means, covariance and spread about the mean point."""
    total = sums[3]
    along, spread = sums[7] / total, sums[8] / total
    for axis in range(3):
        mean = sums[axis] / total
        along -= mean * sums[4 + axis] / total
        spread -= mean * mean
    for moment in range(13):
        moments[moment] = sums[moment] / total
    moments[3] = total
    moments[13] = sums[13]
    moments[7] = along
    moments[8] = max(spread, 0.0)

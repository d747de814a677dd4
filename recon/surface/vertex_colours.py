"""Colours of a surface's vertices from the points around them, by distance along the surface and by view.

A shape bears more smoothing than a picture: depth errs along the line of sight, colours hardly beside it. So a vertex
takes its colour from the points within about a voxel beside it, however far they lie before or behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Mesh
from recon.runtime.workers import in_bands
from recon.surface.blocks import BLOCK, block_coordinates, block_keys, neighbours_in
from recon.surface.cells import cell_in_block, numbered_by_block

RADIUS_VOXELS = 1.0  # beside a vertex, where the weight of a colour ends
MOST_DEPTH_VOXELS = 6.0  # before and behind a vertex; with the radius less than a block
DEPTH_SIGMAS = 3.0
SAME_SIDE = 0.3  # cosine between the normals of a vertex and of a point that may colour it
WIDENED = 2.0  # the radius where nothing lies within it
VIEW_POWER = 2  # of what each sensor has there, so that the best view decides and no seam shows


def colour_vertices(mesh: Mesh, clouds: Sequence[Cloud], voxel: float) -> Mesh:
    """Colour the vertices by the points beside them; those without any keep their colours.

    Parameters
    ----------
    mesh : a surface of these points, with unit normals
    clouds : one per sensor, at most 16; none without points
    voxel : mm
    """
    return replace(mesh, colours=_gathered(mesh, clouds, voxel)[0])


def supports(mesh: Mesh, clouds: Sequence[Cloud], voxel: float) -> NDArray[np.float32]:
    """Measure how many points of each cloud lie beside each vertex, by their weights: float32 (N, S).

    A sensor that looks at a surface from the side, or sees only its edge, has fewer of them.

    Parameters
    ----------
    mesh, clouds, voxel : as of `colour_vertices`
    """
    return _gathered(mesh, clouds, voxel)[1]


def _gathered(mesh: Mesh, clouds: Sequence[Cloud], voxel: float) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the colours (N, 3) and the supports (N, S) of the vertices."""
    points, normals, colours = (
        np.concatenate([getattr(cloud, part) for cloud in clouds]) for part in ("points", "normals", "colours")
    )
    sources = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    blocks, order, starts = numbered_by_block(points, voxel)
    offsets = np.zeros((len(blocks), BLOCK**3 + 1), np.int32)
    _sort_by_cell(points, voxel, starts, order, offsets)
    vertex_blocks, number = _blocks_of(mesh.vertices, voxel)
    lowest = np.minimum(blocks.min(axis=0), vertex_blocks.min(axis=0)) - 1
    around = neighbours_in(vertex_blocks, block_keys(blocks - lowest), lowest)
    gathered, weights = mesh.colours.copy(), np.zeros((len(mesh.vertices), len(clouds)), np.float32)
    beside = _Points(points, normals, colours, sources, order, starts, offsets, voxel, _depth(clouds, voxel))
    vertices = _Vertices(mesh.vertices, mesh.normals, vertex_blocks[number], around[number])
    in_bands(len(mesh.vertices), partial(_gather, vertices, beside, gathered, weights))
    return gathered, weights


class _Points(NamedTuple):
    """The points of all clouds, each with its cloud's number, sorted by `_sort_by_cell`; depth: as of `_depth`."""

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
    sources: NDArray[np.int64]
    order: NDArray[np.int64]
    starts: NDArray[np.int64]
    offsets: NDArray[np.int32]
    voxel: float
    depth: float


class _Vertices(NamedTuple):
    """Vertices and their normals, (N, 3), the block of each, and the numbers of the blocks of points around it."""

    places: NDArray[np.float32]
    normals: NDArray[np.float32]
    blocks: NDArray[np.int64]
    around: NDArray[np.int32]


def _depth(clouds: Sequence[Cloud], voxel: float) -> float:
    """Return how far before and behind a vertex points colour it, voxels."""
    sigmas = [cloud.sigma for cloud in clouds if cloud.sigma is not None]
    sigma = float(np.median(np.concatenate(sigmas))) if sigmas else 0.0
    return float(np.clip(DEPTH_SIGMAS * sigma / voxel, RADIUS_VOXELS, MOST_DEPTH_VOXELS))


def _blocks_of(places: NDArray[np.float32], voxel: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """List the blocks (B, 3) that places (N, 3) lie in, and the number (N,) of each place's."""
    block = np.floor(np.floor(places.astype(np.float64) / voxel) / BLOCK).astype(np.int64)
    lowest = block.min(axis=0)
    keys, number = np.unique(block_keys(block - lowest), return_inverse=True)
    return block_coordinates(keys) + lowest, number.ravel()


@njit(cache=True)
def _sort_by_cell(
    points: NDArray[np.float32],
    voxel: float,
    starts: NDArray[np.int64],
    order: NDArray[np.int64],
    offsets: NDArray[np.int32],
) -> None:
    """Sort the points of each block in `order` by cell, and count those before each cell in `offsets` (B, 513)."""
    for block in range(len(starts) - 1):
        before = order[starts[block] : starts[block + 1]].copy()
        cells = np.empty(len(before), np.int64)
        for index in range(len(before)):
            cells[index] = cell_in_block(points[before[index]], voxel)
            offsets[block, cells[index] + 1] += 1
        for cell in range(512):
            offsets[block, cell + 1] += offsets[block, cell]
        following = offsets[block].copy()
        for index in range(len(before)):
            order[starts[block] + following[cells[index]]] = before[index]
            following[cells[index]] += 1


@njit(cache=True, nogil=True)
def _gather(vertices, points, gathered, weights, first, last):  # type: ignore[no-untyped-def]  # numba
    """Write the colours (N, 3) and the weights (N, S) of vertices `first` to `last`."""
    sums = np.zeros((weights.shape[1], 4))
    for vertex in range(first, last):
        radius = RADIUS_VOXELS
        for _ in range(2):
            sums[:] = 0.0
            _sum_beside(vertices, vertex, points, radius, sums)
            if sums[:, 3].sum() > 0:
                weights[vertex] = sums[:, 3]
                _blend(sums, gathered[vertex])
                break
            radius *= WIDENED


@njit(cache=True, nogil=True)
def _sum_beside(vertices, vertex, points, radius, sums):  # type: ignore[no-untyped-def]  # numba
    """Add the weighted colours and the weights of the points beside a vertex to the sums (S, 4) of their sensors."""
    places, normals, colours, sources, order, starts, offsets, voxel, depth = points
    place, normal, block = vertices.places[vertex], vertices.normals[vertex], vertices.blocks[vertex]
    around = vertices.around[vertex]
    x, y, z = place[0] / voxel, place[1] / voxel, place[2] / voxel
    nx, ny, nz = float(normal[0]), float(normal[1]), float(normal[2])
    cx, cy, cz = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    wide_x, wide_y, wide_z = (
        _cells_beside(nx, radius, depth),
        _cells_beside(ny, radius, depth),
        _cells_beside(nz, radius, depth),
    )
    corner = np.float64(0.87)  # of a cell, from its middle
    for i in range(cx - wide_x, cx + wide_x + 1):
        dx = i + 0.5 - x
        for j in range(cy - wide_y, cy + wide_y + 1):
            dy = j + 0.5 - y
            for k in range(cz - wide_z, cz + wide_z + 1):
                dz = k + 0.5 - z
                along = dx * nx + dy * ny + dz * nz
                if dx * dx + dy * dy + dz * dz - along * along > (radius + corner) ** 2 or abs(along) > depth + corner:
                    continue
                bx, by, bz = (i >> 3) - block[0] + 1, (j >> 3) - block[1] + 1, (k >> 3) - block[2] + 1
                other = around[9 * bx + 3 * by + bz]
                if other < 0:
                    continue
                cell = (i & 7) << 6 | (j & 7) << 3 | k & 7
                for number in range(starts[other] + offsets[other, cell], starts[other] + offsets[other, cell + 1]):
                    index = order[number]
                    agreement = nx * normals[index, 0] + ny * normals[index, 1] + nz * normals[index, 2]
                    if agreement < SAME_SIDE:
                        continue
                    px, py = places[index, 0] / voxel - x, places[index, 1] / voxel - y
                    pz = places[index, 2] / voxel - z
                    away = px * nx + py * ny + pz * nz
                    beside = 1 - (px * px + py * py + pz * pz - away * away) / (radius * radius)
                    if beside <= 0 or abs(away) >= depth:
                        continue
                    weight = beside * beside * (1 - (away / depth) ** 2) * agreement
                    of_sensor = sums[sources[index]]
                    for channel in range(3):
                        of_sensor[channel] += weight * colours[index, channel]
                    of_sensor[3] += weight


@njit(cache=True, nogil=True)
def _cells_beside(cosine, radius, depth):  # type: ignore[no-untyped-def]  # numba
    """Count the cells to either side of a vertex's along an axis with that cosine to its normal."""
    return int(np.ceil(radius * np.sqrt(max(1 - cosine * cosine, 0.0)) + depth * abs(cosine)))


@njit(cache=True, nogil=True)
def _blend(sums, colour):  # type: ignore[no-untyped-def]  # numba
    """Write the colour (3,) of sums (S, 4), each sensor's mean weighted by a power of what it has."""
    total = 0.0
    for source in range(len(sums)):
        total += sums[source, 3] ** VIEW_POWER
    for channel in range(3):
        value = 0.0
        for source in range(len(sums)):
            value += sums[source, channel] * sums[source, 3] ** (VIEW_POWER - 1)
        colour[channel] = np.uint8(min(max(np.rint(value / total), 0.0), 255.0))

"""Colours of a surface's vertices from the points around them, by distance along the surface and by view.

A shape bears more smoothing than a picture: depth errs along the line of sight, colours hardly beside it. So a vertex
takes its colour from the points within about a voxel beside it, and farther before or behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Mesh
from recon.runtime.workers import in_bands
from recon.surface.blocks import BLOCK, block_coordinates, block_keys, neighbours_in
from recon.surface.cells import numbered_by_block

RADIUS_VOXELS = 1.0  # beside a vertex, where the weight of a colour ends
MOST_DEPTH_VOXELS = 6.0  # before and behind a vertex; with the radius less than a block
DEPTH_SIGMAS = 3.0
SAME_SIDE = 0.3  # cosine between the normals of a vertex and of a point that may colour it
WIDENED = 2.0  # the radius where nothing lies within it
VIEW_POWER = 2  # of what each sensor has there, so that the best view decides and no seam shows


@dataclass(frozen=True, eq=False)
class Beside:
    """The points of clouds, sorted by cell, to find those beside vertices.

    Parameters
    ----------
    voxel : mm
    depth : how far before and behind a vertex points count, voxels
    n_clouds : how many clouds there are
    blocks : int64 (B, 3), coordinates of the blocks that hold points
    starts : int64 (B + 1,), first point of each block
    offsets : int32 (B, 513), points before each cell of a block
    points : float32 (N, 6), place from the corner of the point's block, voxels, and normal
    colours : uint8 (N, 4), sRGB, and the number of the cloud
    """

    voxel: float
    depth: float
    n_clouds: int
    blocks: NDArray[np.int64]
    starts: NDArray[np.int64]
    offsets: NDArray[np.int32]
    points: NDArray[np.float32]
    colours: NDArray[np.uint8]

    def gather(
        self,
        vertices: NDArray[np.float32],
        normals: NDArray[np.float32],
        colours: NDArray[np.uint8],
        colouring: range | None = None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return the colours (N, 3) of vertices and the weights (N, S) of what each cloud has beside them.

        Parameters
        ----------
        vertices, normals : (N, 3) of a surface of these points
        colours : (N, 3), which vertices without any point beside them keep
        colouring : numbers of the clouds that colour; None for all
        """
        gathered, weights = colours.copy(), np.zeros((len(vertices), self.n_clouds), np.float32)
        if not len(vertices):
            return gathered, weights
        colouring = range(self.n_clouds) if colouring is None else colouring
        vertex_blocks, number = _blocks_of(vertices, self.voxel)
        lowest = np.minimum(self.blocks.min(axis=0), vertex_blocks.min(axis=0)) - 1
        around = neighbours_in(vertex_blocks, block_keys(self.blocks - lowest), lowest)
        near = _Near(self.starts, self.offsets, self.points, self.colours, self.voxel, self.depth)
        places = _Places(vertices, normals, number, vertex_blocks, around, np.any(around >= 0, axis=1))
        in_bands(len(vertices), partial(_gather, places, near, (colouring.start, colouring.stop), gathered, weights))
        return gathered, weights


class _Near(NamedTuple):
    """The points of a `Beside`."""

    starts: NDArray[np.int64]
    offsets: NDArray[np.int32]
    points: NDArray[np.float32]
    colours: NDArray[np.uint8]
    voxel: float
    depth: float


class _Places(NamedTuple):
    """Vertices with their normals (N, 3), and the number (N,) of each one's block.

    Parameters
    ----------
    blocks, around : int64 (V, 3) and int32 (V, 27), the vertices' blocks, and the points' blocks around each
    has_points : bool (V,), whether any of these holds points
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    number: NDArray[np.int64]
    blocks: NDArray[np.int64]
    around: NDArray[np.int32]
    has_points: NDArray[np.bool_]


def beside(clouds: Sequence[Cloud], voxel: float) -> Beside:
    """Sort the points of clouds, at most 16 and none without points, by cells one voxel (mm) wide."""
    points = np.concatenate([cloud.points for cloud in clouds])
    blocks, order, starts = numbered_by_block(points, voxel)
    offsets = np.zeros((len(blocks), BLOCK**3 + 1), np.int32)
    _sort_by_cell(points, voxel, starts, order, offsets)
    sorted_points, colours = np.empty((len(points), 6), np.float32), np.empty((len(points), 4), np.uint8)
    corners = np.repeat(blocks * BLOCK, np.diff(starts), axis=0)
    sorted_points[:, :3] = points[order] / voxel - corners
    sorted_points[:, 3:] = np.concatenate([cloud.normals for cloud in clouds])[order]
    colours[:, :3] = np.concatenate([cloud.colours for cloud in clouds])[order]
    colours[:, 3] = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])[order]
    return Beside(voxel, _depth(clouds, voxel), len(clouds), blocks, starts, offsets, sorted_points, colours)


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
    return beside(clouds, voxel).gather(mesh.vertices, mesh.normals, mesh.colours)


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
            x = int(np.floor(float(points[before[index], 0]) / voxel)) & 7
            y = int(np.floor(float(points[before[index], 1]) / voxel)) & 7
            cells[index] = x << 6 | y << 3 | int(np.floor(float(points[before[index], 2]) / voxel)) & 7
            offsets[block, cells[index] + 1] += 1
        for cell in range(512):
            offsets[block, cell + 1] += offsets[block, cell]
        following = offsets[block].copy()
        for index in range(len(before)):
            order[starts[block] + following[cells[index]]] = before[index]
            following[cells[index]] += 1


@njit(cache=True, nogil=True)
def _gather(places, near, colouring, gathered, weights, first, last):  # type: ignore[no-untyped-def]  # numba
    """Write the colours, from the clouds `colouring` (2,), and the weights of vertices `first` to `last`."""
    sums = np.zeros((weights.shape[1], 4))
    from_cloud, to_cloud = colouring
    for vertex in range(first, last):
        number = places.number[vertex]
        if not places.has_points[number]:
            continue
        place, normal, block = places.vertices[vertex], places.normals[vertex], places.blocks[number]
        radius, known = RADIUS_VOXELS, False
        for _ in range(2):
            sums[:] = 0.0
            _sum_beside(place, normal, block, places.around[number], near, radius, sums)
            if not known and sums[:, 3].sum() > 0:
                weights[vertex], known = sums[:, 3], True
            if sums[from_cloud:to_cloud, 3].sum() > 0:
                _blend(sums[from_cloud:to_cloud], gathered[vertex])
                break
            radius *= WIDENED


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_beside(vertex, normal, block, around, near, radius, sums):  # type: ignore[no-untyped-def]  # numba
    """Add the weighted colours and the weights of the points beside a vertex to the sums (S, 4) of their sensors.

    The points lie in a cylinder, whose cells are met row by row along z: those of a row in a block stand together.
    """
    starts, offsets, points, colours, voxel, depth = near
    x, y, z = (vertex[0] / voxel - 8 * block[0], vertex[1] / voxel - 8 * block[1], vertex[2] / voxel - 8 * block[2])
    nx, ny, nz = float(normal[0]), float(normal[1]), float(normal[2])
    cx, cy, cz = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    flat = max(1 - nz * nz, 0.0)
    wide_x = int(np.ceil(radius * np.sqrt(max(1 - nx * nx, 0.0)) + depth * abs(nx)))
    wide_y = int(np.ceil(radius * np.sqrt(max(1 - ny * ny, 0.0)) + depth * abs(ny)))
    wide_z = int(np.ceil(radius * np.sqrt(flat) + depth * abs(nz)))
    corner = np.float64(0.87)  # of a cell, from its middle
    square, inverse_square, inverse_depth = (radius + corner) ** 2, 1 / (radius * radius), 1 / depth
    inverse_flat, inverse_nz = 1 / flat, 1 / nz
    for i in range(cx - wide_x, cx + wide_x + 1):
        dx = i + 0.5 - x
        from_y, to_y = cy - wide_y, cy + wide_y
        if abs(nx) > 1e-3:  # seen along z, the cylinder is a strip along (nx, ny)
            middle, reach = dx * ny / nx + y - 0.5, (radius + corner) * np.sqrt(nx * nx + ny * ny) / abs(nx)
            from_y = int(np.ceil(max(from_y, middle - reach - 0.001)))
            to_y = int(np.floor(min(to_y, middle + reach + 0.001)))
        for j in range(from_y, to_y + 1):
            dy = j + 0.5 - y
            along = dx * nx + dy * ny
            # dz such that |along + nz dz| <= depth and flat dz^2 - 2 along nz dz + dx^2 + dy^2 - along^2 <= square
            lowest, highest = cz - wide_z + 0.5 - z, cz + wide_z + 0.5 - z
            across = dx * dx + dy * dy - along * along - square
            if flat > 1e-9:
                root = along * along * nz * nz - flat * across
                if root < 0:
                    continue
                root = np.sqrt(root)
                lowest = max(lowest, (along * nz - root) * inverse_flat)
                highest = min(highest, (along * nz + root) * inverse_flat)
            elif across > 0:
                continue
            if abs(nz) > 1e-9:
                middle, reach = -along * inverse_nz, (depth + corner) * abs(inverse_nz)
                lowest, highest = max(lowest, middle - reach), min(highest, middle + reach)
            elif abs(along) > depth + corner:
                continue
            first, last = int(np.ceil(lowest + z - 0.501)), int(np.floor(highest + z - 0.499))
            side, cell = 9 * ((i >> 3) + 1) + 3 * ((j >> 3) + 1) + 1, (i & 7) << 6 | (j & 7) << 3
            while first <= last:
                above = first >> 3
                other, end = around[side + above], min(last, 8 * above + 7)
                if other >= 0:
                    start = starts[other] + offsets[other, cell | first & 7]
                    stop = starts[other] + offsets[other, (cell | end & 7) + 1]
                    left, before, under = x - 8 * (i >> 3), y - 8 * (j >> 3), z - 8 * above
                    for place in range(start, stop):
                        facing = nx * points[place, 3] + ny * points[place, 4] + nz * points[place, 5]
                        px, py, pz = points[place, 0] - left, points[place, 1] - before, points[place, 2] - under
                        away = px * nx + py * ny + pz * nz
                        closeness = 1 - (px * px + py * py + pz * pz - away * away) * inverse_square
                        if not ((facing >= SAME_SIDE) & (closeness > 0) & (abs(away) < depth)):  # one branch, not three
                            continue
                        far = away * inverse_depth
                        weight = closeness * closeness * (1 - far * far) * facing
                        source = colours[place, 3]
                        for channel in range(3):
                            sums[source, channel] += weight * colours[place, channel]
                        sums[source, 3] += weight
                first = end + 1


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

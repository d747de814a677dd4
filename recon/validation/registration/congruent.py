"""Compiled search for congruent 4-point bases: the two steps of Super4PCS that its name comes from.

Source: Mellado, Aiger, Mitra, "Super 4PCS: fast global pointcloud registration via smart indexing" (2014), sections
4.1 (pairs at a given distance) and 4.2 (intersections of pairs at a given angle, by a grid).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray


class Grid(NamedTuple):
    """Points sorted by the cells that they lie in.

    Parameters
    ----------
    low : float64 (3,), lowest corner
    cell : width of a cell
    shape : int64 (3,), cells along each axis
    starts, entries : int64 (C + 1,) and (N,), cell c holds the points `entries[starts[c] : starts[c + 1]]`
    """

    low: NDArray[np.float64]
    cell: float
    shape: NDArray[np.int64]
    starts: NDArray[np.int64]
    entries: NDArray[np.int64]


@njit(cache=True, nogil=True, inline="always")
def _cell_of(point, low, cell):  # type: ignore[no-untyped-def]  # numba
    return (
        int(np.floor((point[0] - low[0]) / cell)),
        int(np.floor((point[1] - low[1]) / cell)),
        int(np.floor((point[2] - low[2]) / cell)),
    )


@njit(cache=True, nogil=True, inline="always")
def _points_in(grid, x, y, z):  # type: ignore[no-untyped-def]  # numba
    """Return the points of a cell, none beyond the grid."""
    shape, starts = grid.shape, grid.starts
    if not (0 <= x < shape[0] and 0 <= y < shape[1] and 0 <= z < shape[2]):
        return grid.entries[:0]
    key = (x * shape[1] + y) * shape[2] + z
    return grid.entries[starts[key] : starts[key + 1]]


@njit(cache=True, nogil=True)
def cell_table(points: NDArray[np.float64], cell: float) -> Grid:
    """Sort points (N, 3) into a grid."""
    low = np.empty(3)
    shape = np.empty(3, np.int64)
    for axis in range(3):
        low[axis] = points[:, axis].min() - 0.5 * cell
        shape[axis] = int((points[:, axis].max() - low[axis]) / cell) + 1
    starts = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    keys = np.empty(len(points), np.int64)
    for i in range(len(points)):
        x, y, z = _cell_of(points[i], low, cell)
        keys[i] = (x * shape[1] + y) * shape[2] + z
        starts[keys[i] + 1] += 1
    for k in range(len(starts) - 1):
        starts[k + 1] += starts[k]
    filled = starts.copy()
    entries = np.empty(len(points), np.int64)
    for i in range(len(points)):
        entries[filled[keys[i]]] = i
        filled[keys[i]] += 1
    return Grid(low, cell, shape, starts, entries)


@njit(cache=True, nogil=True)
def pairs_at_distance(points: NDArray[np.float64], distance: float, tolerance: float, most: int) -> NDArray[np.int64]:
    """Return ordered pairs (P, 2) of points that are `distance` apart, within the tolerance.

    All pairs are looked at: of a few hundred points it takes a hundredth of the time of the paper's rasterised sphere.

    Parameters
    ----------
    points : float64 (N, 3), mm
    distance, tolerance : mm
    most : pairs that are returned
    """
    pairs = np.empty((most, 2), np.int64)
    n = 0
    least, largest = max(distance - tolerance, 0.0) ** 2, (distance + tolerance) ** 2
    for i in range(len(points)):
        for j in range(len(points)):
            d2 = 0.0
            for axis in range(3):
                d2 += (points[i, axis] - points[j, axis]) ** 2
            if least <= d2 <= largest:
                pairs[n] = i, j
                n += 1
                if n == most:
                    return pairs
    return pairs[:n]


@njit(cache=True, nogil=True)
def congruent_bases(
    points: NDArray[np.float64],
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    at: NDArray[np.float64],
    cosine: float,
    tolerance: float,
    most: int,
) -> NDArray[np.int64]:
    """Return quadruples (B, 4) of points: a pair of each list that cross where the base's diagonals do, at their angle.

    Parameters
    ----------
    points : float64 (N, 3), mm
    first, second : int64 (P, 2), ordered pairs as long as the base's diagonals
    at : float64 (2,), where each diagonal crosses the other, as a share of its length
    cosine : of the angle between the diagonals
    tolerance : mm, between the two crossings; divided by the shorter diagonal's length, half that of the cosine
    most : quadruples that are returned
    """
    bases = np.empty((most, 4), np.int64)
    if len(first) == 0 or len(second) == 0:
        return bases[:0]
    crossings = np.empty((len(first), 3))
    for k in range(len(first)):
        for axis in range(3):
            a, b = points[first[k, 0], axis], points[first[k, 1], axis]
            crossings[k, axis] = a + at[0] * (b - a)
    cell = max(tolerance, 0.01 * (crossings.max() - crossings.min()))  # a table of a million cells at most
    grid = cell_table(crossings, cell)
    n = 0
    for k in range(len(second)):
        c, d = points[second[k, 0]], points[second[k, 1]]
        e = c + at[1] * (d - c)
        cx, cy, cz = _cell_of(e, grid.low, cell)
        length_cd = np.sqrt(((d - c) ** 2).sum())
        for x in range(cx - 1, cx + 2):
            for y in range(cy - 1, cy + 2):
                for z in range(cz - 1, cz + 2):
                    for m in _points_in(grid, x, y, z):
                        gap, dot, length_ab = 0.0, 0.0, 0.0
                        for axis in range(3):
                            gap += (crossings[m, axis] - e[axis]) ** 2
                            along = points[first[m, 1], axis] - points[first[m, 0], axis]
                            dot += along * (d[axis] - c[axis])
                            length_ab += along * along
                        length_ab = np.sqrt(length_ab)
                        slack = 2 * tolerance / min(length_ab, length_cd)
                        if gap > tolerance * tolerance or abs(dot / (length_ab * length_cd) - cosine) > slack:
                            continue
                        bases[n] = first[m, 0], first[m, 1], second[k, 0], second[k, 1]
                        n += 1
                        if n == most:
                            return bases
    return bases[:n]


@njit(cache=True, nogil=True)
def overlaps(
    transforms: NDArray[np.float64],
    points: NDArray[np.float64],
    near: NDArray[np.bool_],
    low: NDArray[np.float64],
    cell: float,
) -> NDArray[np.float64]:
    """Return the share (T,) of the points that each transform brings near the model.

    Parameters
    ----------
    transforms : float64 (T, 3, 4), model_from_cloud
    points : float64 (N, 3), mm, of the cloud
    near : bool (X, Y, Z), which cells of a grid are near the model
    low : float64 (3,), mm, the grid's lowest corner
    cell : mm
    """
    shares = np.zeros(len(transforms))
    for t in range(len(transforms)):
        count = 0
        m = transforms[t]
        for i in range(len(points)):
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            moved = (
                m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3],
                m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3],
                m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3],
            )
            x, y, z = _cell_of(moved, low, cell)
            if 0 <= x < near.shape[0] and 0 <= y < near.shape[1] and 0 <= z < near.shape[2] and near[x, y, z]:
                count += 1
        shares[t] = count / len(points)
    return shares

"""Smooth closed bodies from rounded cones and ellipsoids: the actors' shape at rest, before it moves.

A body is a table of parts; its surface is where the smooth union of the parts' distances is zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray
from skimage.measure import marching_cubes

N_COLUMNS = 21
CONE, ELLIPSOID = 0.0, 1.0
JOIN, CARVE = 1.0, -1.0
MAX_REFINEMENTS = 4
REACH_MM = 66.0  # parts farther from a place on the surface cannot blend into it: no `blend` is wider

Grid = tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float
]


@dataclass(frozen=True)
class Part:
    """One rounded cone from `a` to `b`, or one ellipsoid around `a` with half axes `radii`.

    Parameters
    ----------
    a, b : mm; `b` is None for an ellipsoid
    radii : mm; (at a, at b) of a cone, (x, y, z) of an ellipsoid
    bone : name of the bone that carries it
    blend : mm, width of the smooth union with what came before
    turn : float64 (3, 3), an ellipsoid's axes in its columns
    carve : take away instead of adding
    """

    bone: str
    a: Sequence[float]
    b: Sequence[float] | None
    radii: Sequence[float]
    blend: float = 30.0
    turn: ArrayLike = field(default_factory=lambda: np.eye(3))
    carve: bool = False

    def mirrored(self) -> Part:
        """Return the same part on the other side of the plane x = 0; a bone `name_l` becomes `name_r`."""
        flip = np.array([-1.0, 1.0, 1.0])
        bone = f"{self.bone[:-2]}_r" if self.bone.endswith("_l") else self.bone
        b = None if self.b is None else tuple(flip * self.b)
        turn = flip[:, None] * np.asarray(self.turn) * flip
        return Part(bone, tuple(flip * self.a), b, self.radii, self.blend, turn, self.carve)


@dataclass(frozen=True)
class FineCells:
    """Where cells are smaller than elsewhere: beyond |x|, for hands, and above y, for a head.

    Cells shrink towards the axis of the hands and that of the head, so the grid stays one block of cells: beside hands
    and head it leaves out the air far away.

    Parameters
    ----------
    beyond_x, above_y : mm, where cells begin to shrink, and where they are at their smallest
    hand_y : mm, the height towards which they shrink beyond x
    hand_share, head_share : edge of the smallest cells over that of the others
    """

    beyond_x: tuple[float, float]
    above_y: tuple[float, float]
    hand_y: float
    hand_share: float
    head_share: float


def part_table(parts: Sequence[Part]) -> NDArray[np.float64]:
    """Convert parts to the rows, float64 (P, N_COLUMNS), that the kernels read."""
    table = np.zeros((len(parts), N_COLUMNS))
    for row, part in zip(table, parts, strict=True):
        row[0] = ELLIPSOID if part.b is None else CONE
        row[1] = CARVE if part.carve else JOIN
        row[2] = part.blend
        row[3:6] = part.a
        row[6:9] = part.radii if part.b is None else part.b
        row[9:11] = (max(part.radii), max(part.radii)) if part.b is None else part.radii
        row[12:21] = np.asarray(part.turn, dtype=np.float64).ravel()
    return table


def body_mesh(
    table: NDArray[np.float64],
    cell: float,
    wanted_edge: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    fine: FineCells | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Triangulate the zero level: marching cubes on a coarse grid, then refinement where it is wanted.

    Parameters
    ----------
    table : float64 (P, N_COLUMNS)
    cell : mm, edge of the coarse grid's cells
    wanted_edge : longest edge wanted (N,) at places (N, 3), mm
    fine : where cells are smaller: what is thinner than a cell, or nearer to its neighbour, is lost

    Returns
    -------
    vertices : float64 (N, 3), mm, on the surface to a hundredth of a millimetre where it is smooth
    faces : int32 (M, 3), counter-clockwise seen from outside
    """
    grid = _grid(table, cell, fine)
    indices, faces, _, _ = marching_cubes(grid_distance(table, grid), 0.0, gradient_direction="ascent")
    vertices = project_to_surface(table, _places(indices.astype(np.float64), grid))
    faces = faces[:, ::-1].astype(np.int32)
    for _ in range(MAX_REFINEMENTS):
        n_before = len(vertices)
        vertices, faces = split_long_edges(vertices, faces, wanted_edge)
        if len(vertices) == n_before:
            break
        vertices[n_before:] = project_to_surface(table, vertices[n_before:])
    return vertices, faces


def _grid(table: NDArray[np.float64], cell: float, fine: FineCells | None) -> Grid:
    """Return the grid's coordinates (X,), (Y,), (Z,), how much it shrinks at each x and each y, and towards which y."""
    low, high = _extent(table)
    low, high = low - 1.5 * cell, high + 2.5 * cell
    if fine is None:
        xs, ys, zs = (np.arange(a, b, cell) for a, b in zip(low, high, strict=True))
        return xs, ys, zs, np.ones(len(xs)), np.ones(len(ys)), 0.0
    half = _axis(0.0, high[0], cell, fine.beyond_x, fine.hand_share)
    xs, ys = np.concatenate([-half[:0:-1], half]), _axis(low[1], high[1], cell, fine.above_y, fine.head_share)
    zs = np.arange(low[2] / fine.head_share, high[2] / fine.head_share, cell)
    shrink_x = np.interp(np.abs(xs), fine.beyond_x, (1.0, fine.hand_share))
    return xs, ys, zs, shrink_x, np.interp(ys, fine.above_y, (1.0, fine.head_share)), fine.hand_y


def _axis(low: float, high: float, cell: float, beyond: tuple[float, float], share: float) -> NDArray[np.float64]:
    """Return coordinates from `low` to `high`, `cell` apart and closer `beyond`."""
    coordinates = [low]
    while coordinates[-1] < high:
        coordinates.append(coordinates[-1] + cell * float(np.interp(coordinates[-1], beyond, (1.0, share))))
    return np.array(coordinates)


def _places(indices: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Return places, float64 (N, 3), mm, of fractional indices (N, 3) into a grid."""
    *axes, shrink_x, shrink_y, hand_y = grid
    i, j, k = indices.T
    x, y, z = (np.interp(n, np.arange(len(axis)), axis) for n, axis in zip((i, j, k), axes, strict=True))
    a, b = np.interp(i, np.arange(len(shrink_x)), shrink_x), np.interp(j, np.arange(len(shrink_y)), shrink_y)
    return np.stack(_place.py_func(x, y, z, a, b, hand_y), axis=1)


def split_long_edges(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    wanted_edge: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Split every edge that is longer than wanted at its middle; a closed mesh stays closed.

    Parameters
    ----------
    vertices : float64 (N, 3), mm
    faces : int32 (M, 3)
    wanted_edge : longest edge wanted (N,) at places (N, 3), mm

    Returns
    -------
    vertices : float64 (N', 3), mm, the old ones first
    faces : int32 (M', 3)
    """
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, place = np.unique(edges[:, 0].astype(np.int64) * len(vertices) + edges[:, 1], return_inverse=True)
    a, b = vertices[unique // len(vertices)], vertices[unique % len(vertices)]
    middles = 0.5 * (a + b)
    is_long = np.linalg.norm(a - b, axis=1) > wanted_edge(middles)
    new = np.where(is_long, len(vertices) + np.cumsum(is_long) - 1, -1)
    return np.concatenate([vertices, middles[is_long]]), _split_faces(faces, new[place].reshape(3, -1).T)


def _split_faces(faces: NDArray[np.int32], middles: NDArray[np.int64]) -> NDArray[np.int32]:
    """Split faces (M, 3) at the new vertices (M, 3) on their edges 01, 12, 20; -1 where an edge stays whole."""
    n_split = (middles >= 0).sum(axis=1)
    parts = [faces[n_split == 0]]
    for count in (1, 2, 3):
        # Turn each face so that a split edge comes first and a whole one last.
        chosen = n_split == count
        face, middle = faces[chosen].astype(np.int64), middles[chosen]
        for _ in range(2):
            turn = (middle[:, 0] < 0) | ((count == 2) & (middle[:, 2] >= 0))
            face[turn], middle[turn] = np.roll(face[turn], -1, axis=1), np.roll(middle[turn], -1, axis=1)
        (a, b, c), (ab, bc, ca) = face.T, middle.T
        pieces = {
            1: ((a, ab, c), (ab, b, c)),
            2: ((ab, b, bc), (a, ab, bc), (a, bc, c)),
            3: ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)),
        }[count]
        parts += [np.stack(piece, axis=1) for piece in pieces]
    return np.concatenate(parts).astype(np.int32)


def _extent(table: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and the highest corner of a box around all parts, mm."""
    is_cone = table[:, 0] == CONE
    ends = np.concatenate([table[:, 3:6], table[is_cone, 6:9]])
    reach = np.concatenate([table[:, 9:11].max(axis=1), table[is_cone, 9:11].max(axis=1)])[:, None]
    return np.min(ends - reach, axis=0), np.max(ends + reach, axis=0)


@numba.njit(cache=True, nogil=True)
def _part_distance(row: NDArray[np.float64], x: float, y: float, z: float) -> float:
    px, py, pz = x - row[3], y - row[4], z - row[5]
    if row[0] == 0.0:
        bx, by, bz = row[6] - row[3], row[7] - row[4], row[8] - row[5]
        t = (px * bx + py * by + pz * bz) / (bx * bx + by * by + bz * bz)
        t = min(1.0, max(0.0, t))
        dx, dy, dz = px - t * bx, py - t * by, pz - t * bz
        return float(np.sqrt(dx * dx + dy * dy + dz * dz) - (row[9] + t * (row[10] - row[9])))
    ux = row[12] * px + row[15] * py + row[18] * pz
    uy = row[13] * px + row[16] * py + row[19] * pz
    uz = row[14] * px + row[17] * py + row[20] * pz
    ax, ay, az = ux / row[6], uy / row[7], uz / row[8]
    k0 = np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / row[6], ay / row[7], az / row[8]
    k1 = np.sqrt(ax * ax + ay * ay + az * az)
    if k1 < 1e-12:
        return float(-min(row[6], min(row[7], row[8])))
    return float(k0 * (k0 - 1.0) / k1)


@numba.njit(cache=True, nogil=True)
def _blend(d: float, e: float, k: float, op: float) -> float:
    """Return the polynomial smooth minimum of d and e, or the smooth maximum of d and -e."""
    if op > 0.0:
        h = max(k - abs(d - e), 0.0) / k
        return min(d, e) - 0.25 * h * h * k
    h = max(k - abs(d + e), 0.0) / k
    return max(d, -e) + 0.25 * h * h * k


@numba.njit(cache=True, nogil=True)
def _distance(table: NDArray[np.float64], near: NDArray[np.int64], n_near: int, x: float, y: float, z: float) -> float:
    d = 1e6
    for i in range(n_near):
        row = table[near[i]]
        d = _blend(d, _part_distance(row, x, y, z), row[2], row[1])
    return d


@numba.njit(cache=True, nogil=True)
def distance(table: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute smooth signed distances, float64 (N,), of points (N, 3), negative inside, mm."""
    everything = np.arange(len(table))
    result = np.empty(len(points))
    for i in range(len(points)):
        result[i] = _distance(table, everything, len(table), points[i, 0], points[i, 1], points[i, 2])
    return result


@numba.njit(cache=True, nogil=True)
def clearances(
    table: NDArray[np.float64],
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    reaches: tuple[float, float, float],
) -> NDArray[np.float64]:
    """Compute distances, float64 (N, 3), mm, from three places in front of each surface point.

    Parameters
    ----------
    table : of the parts
    points, directions : float64 (N, 3), places on the surface, mm, and unit vectors
    reaches : how far in front, mm; parts farther than twice the last and longest one count as absent
    """
    near = np.empty(len(table), np.int64)
    result = np.empty((len(points), 3))
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        n = 0
        for part in range(len(table)):
            if _part_distance(table[part], x, y, z) < 2.0 * reaches[2]:
                near[n] = part
                n += 1
        for j in range(3):
            reach = reaches[j]
            x, y, z = points[i] + reach * directions[i]
            result[i, j] = _distance(table, near, n, x, y, z)
    return result


@numba.njit(cache=True, nogil=True)
def group_distances(
    table: NDArray[np.float64], groups: NDArray[np.int64], n_groups: int, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute distances, float64 (N, n_groups), mm, of points to the nearest part of each group alone.

    Parameters
    ----------
    table : of the P parts
    groups : int64 (P,), the group of each part; parts of group -1 count nowhere
    n_groups : how many there are
    points : float64 (N, 3), mm
    """
    result = np.full((len(points), n_groups), np.inf)
    for i in range(len(points)):
        for j in range(len(table)):
            if groups[j] >= 0:
                away = _part_distance(table[j], points[i, 0], points[i, 1], points[i, 2])
                result[i, groups[j]] = min(result[i, groups[j]], away)
    return result


@numba.njit(cache=True, nogil=True)
def project_to_surface(table: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Move points (N, 3) along the gradient onto the zero level: three Newton steps of at most 4 mm."""
    near = np.empty(len(table), np.int64)
    step = 0.05
    result = points.copy()
    for i in range(len(points)):
        x, y, z = result[i, 0], result[i, 1], result[i, 2]
        n = 0
        for part in range(len(table)):
            if _part_distance(table[part], x, y, z) < REACH_MM:
                near[n] = part
                n += 1
        for _ in range(3):
            d = _distance(table, near, n, x, y, z)
            gx = (_distance(table, near, n, x + step, y, z) - d) / step
            gy = (_distance(table, near, n, x, y + step, z) - d) / step
            gz = (_distance(table, near, n, x, y, z + step) - d) / step
            g2 = max(gx * gx + gy * gy + gz * gz, 0.05)
            s = max(-4.0, min(4.0, d / g2))
            x, y, z = x - s * gx, y - s * gy, z - s * gz
        result[i, 0], result[i, 1], result[i, 2] = x, y, z
    return result


@numba.njit(cache=True, nogil=True)
def _place(x: float, y: float, z: float, shrink_x: float, shrink_y: float, hand_y: float) -> tuple[float, float, float]:
    return x * shrink_y, hand_y + (y - hand_y) * shrink_x, z * shrink_x * shrink_y


@numba.njit(cache=True, nogil=True)
def grid_distance(table: NDArray[np.float64], grid: Grid) -> NDArray[np.float32]:
    """Compute distances, float32 (X, Y, Z), mm, negative inside, on a grid.

    Blocks far from the surface hold one rough value.

    Parameters
    ----------
    table : float64 (P, N_COLUMNS), see `part_table`
    grid : as from `_grid`
    """
    xs, ys, zs, shrink_x, shrink_y, hand_y = grid
    result = np.empty((len(xs), len(ys), len(zs)), np.float32)
    n = len(table)
    everything = np.arange(n)
    near = np.empty(n, np.int64)
    for i0 in range(0, len(xs), 8):
        for j0 in range(0, len(ys), 8):
            for k0 in range(0, len(zs), 8):
                i1, j1, k1 = min(i0 + 8, len(xs)), min(j0 + 8, len(ys)), min(k0 + 8, len(zs))
                low, high = np.full(3, np.inf), np.full(3, -np.inf)
                for i in (i0, i1 - 1):
                    for j in (j0, j1 - 1):
                        for k in (k0, k1 - 1):
                            corner = _place(xs[i], ys[j], zs[k], shrink_x[i], shrink_y[j], hand_y)
                            for axis in range(3):
                                low[axis], high[axis] = min(low[axis], corner[axis]), max(high[axis], corner[axis])
                middle = 0.5 * (low + high)
                radius = 0.5 * np.sqrt(np.sum((high - low) ** 2))
                centre = _distance(table, everything, n, middle[0], middle[1], middle[2])
                beside_both = shrink_x[i0] * shrink_x[i1 - 1] < 1.0 and shrink_y[j0] * shrink_y[j1 - 1] < 1.0
                if beside_both:  # the grid overlaps itself in the air beside the head
                    centre = 1e3
                if beside_both or abs(centre) > 1.8 * radius + 40.0:
                    for i in range(i0, i1):
                        for j in range(j0, j1):
                            for k in range(k0, k1):
                                result[i, j, k] = centre
                    continue
                n_near = 0
                for p in range(n):
                    if _part_distance(table[p], middle[0], middle[1], middle[2]) < 2.2 * radius + REACH_MM:
                        near[n_near] = p
                        n_near += 1
                for i in range(i0, i1):
                    for j in range(j0, j1):
                        for k in range(k0, k1):
                            x, y, z = _place(xs[i], ys[j], zs[k], shrink_x[i], shrink_y[j], hand_y)
                            result[i, j, k] = _distance(table, near, n_near, x, y, z)
    return result

"""Nearest neighbours with a stated rule for those that are equally near.

A tree's search returns them in an arbitrary order, and a measure that takes the first then depends on how the tree was
built. On clouds with whole-number coordinates a quarter of the points has several nearest neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

CHUNK = 100_000  # points that are looked up at once, to bound the memory
FIRST_K, STEP_K, MOST_K = 10, 5, 30  # numbers of neighbours that pc_error asks for
JOINED_WITHIN = 1e-8  # squared unit of length; pc_error's threshold, absolute whatever the unit
SPARE = 4  # neighbours looked up beyond those needed, to see whether the last has others equally far


@dataclass(frozen=True, eq=False)
class NearestGroups:
    """For each of N points, the group of the other cloud's points that count as its nearest.

    Parameters
    ----------
    squared : float64 (N,), squared distance to the nearest
    counts : int64 (N,), size of each group
    rows : int64 (L,), the points that the groups belong to, ascending, L being the sum of all sizes
    members : int64 (L,), rows of the other cloud
    is_exact : bool (L,), whether a member is exactly as near as the nearest
    """

    squared: NDArray[np.float64]
    counts: NDArray[np.int64]
    rows: NDArray[np.int64]
    members: NDArray[np.int64]
    is_exact: NDArray[np.bool_]

    def mean(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Average values (L,) of members over each group, (N,)."""
        return np.asarray(np.bincount(self.rows, values, len(self.counts)) / self.counts)


def nearest_groups(points: NDArray[np.float32], others: NDArray[np.float32], tree: cKDTree) -> NearestGroups:
    """Find the groups of nearest neighbours as MPEG's program pc_error does.

    Parameters
    ----------
    points, others : float32 (N, 3) and (M, 3)
    tree : of the others

    Convention
    ----------
    Differences of coordinates are rounded to float32, squares and sums are not. Starting from the nearest, neighbours
    join as long as the squared distance grows by less than 1e-8 from one to the next, in absolute terms: on clouds in
    metres, points that are not equally far join, too. Of ten neighbours that are all exactly equally near, the search
    is widened, to thirty at most.

    Source
    ------
    mpeg-pcc-dmetric 0.14.1, `findMetric`.
    """
    parts = [_groups(points[first : first + CHUNK], others, tree, first) for first in range(0, len(points), CHUNK)]
    squared, counts, rows, members, is_exact = (np.concatenate(column) for column in zip(*parts, strict=True))
    return NearestGroups(squared, counts, rows, members, is_exact)


def _groups(
    points: NDArray[np.float32], others: NDArray[np.float32], tree: cKDTree, first: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Return the columns of `NearestGroups` of a chunk that begins at row `first`."""
    n = len(points)
    squared, counts = np.empty(n), np.empty(n, np.int64)
    rows, members, exact = [], [], []
    wanted = np.arange(n)
    for k in range(FIRST_K, MOST_K + 1, STEP_K):
        k = min(k, len(others))
        near = tree.query(points[wanted].astype(np.float64), range(1, k + 1), workers=-1)[1]
        distances = _squared_in_float32(points[wanted], others[near])
        order = np.argsort(distances, axis=1, kind="stable")
        distances, near = np.take_along_axis(distances, order, 1), np.take_along_axis(near, order, 1)
        is_done = (distances[:, 0] < distances[:, -1]) | (k >= min(MOST_K, len(others)))
        distances, near, done = distances[is_done], near[is_done], wanted[is_done]
        joins = np.abs(np.diff(distances, axis=1)) < JOINED_WITHIN
        is_member = np.ones(distances.shape, np.bool_)
        is_member[:, 1:] = np.logical_and.accumulate(joins, axis=1)
        squared[done], counts[done] = distances[:, 0], is_member.sum(axis=1)
        rows.append(np.repeat(done, counts[done]))
        members.append(near[is_member])
        exact.append((distances == distances[:, :1])[is_member])
        wanted = wanted[~is_done]
        if not len(wanted):
            break
    every = np.concatenate(rows)
    by_row = np.argsort(every, kind="stable")
    return (
        squared,
        counts,
        first + every[by_row],
        np.concatenate(members)[by_row],
        np.concatenate(exact)[by_row],
    )


def lowest_first(
    points: NDArray[np.float32], others: NDArray[np.float32], tree: cKDTree, k: int
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Find the k nearest neighbours; of those equally near, the ones in the lowest rows.

    Parameters
    ----------
    points, others : float32 (N, 3) and (M, 3), M at least k
    tree : of the others
    k : number of neighbours

    Returns
    -------
    rows : int32 (N, k), of the others, nearest first
    distances : float64 (N, k), in the unit of the points
    """
    rows, distances = np.empty((len(points), k), np.int32), np.empty((len(points), k))
    for first in range(0, len(points), CHUNK):
        chunk = slice(first, first + CHUNK)
        rows[chunk], distances[chunk] = _lowest_first(points[chunk].astype(np.float64), others, tree, k)
    return rows, distances


def _lowest_first(
    points: NDArray[np.float64], others: NDArray[np.float32], tree: cKDTree, k: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    rows, squares = np.empty((len(points), k), np.int64), np.empty((len(points), k))
    wanted, width = np.arange(len(points)), k + SPARE
    while len(wanted):
        width = min(width, len(others))
        near = np.sort(tree.query(points[wanted], range(1, width + 1), workers=-1)[1], axis=1)
        squared = np.square(points[wanted, None] - others[near]).sum(axis=2)
        order = np.argsort(squared, axis=1, kind="stable")  # stable: the lowest row first
        near, squared = np.take_along_axis(near, order, 1), np.take_along_axis(squared, order, 1)
        is_done = (squared[:, k - 1] < squared[:, -1]) | (width == len(others))
        done = wanted[is_done]
        rows[done], squares[done] = near[is_done, :k], squared[is_done, :k]
        wanted, width = wanted[~is_done], 2 * width
    return rows, np.sqrt(squares)


def _squared_in_float32(points: NDArray[np.float32], others: NDArray[np.float32]) -> NDArray[np.float64]:
    """Compute squared distances (N, K) of points (N, 3) to others (N, K, 3) from differences rounded to float32."""
    x, y, z = (points[:, None, axis] - others[..., axis] for axis in range(3))
    return np.asarray(x.astype(np.float64) ** 2 + y.astype(np.float64) ** 2 + z.astype(np.float64) ** 2)

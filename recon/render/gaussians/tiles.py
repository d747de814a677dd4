"""Which splats meet which tile of a picture, the nearest first."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.render.gaussians.projection import Ellipses
from recon.render.rasterise import in_threads

TILE = 16  # pixels
DIGIT = 11  # bits that are sorted at once


def nearest_first(depths: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return the numbers of splats that are drawn, the nearest first; equally near ones stay in their order.

    Parameters
    ----------
    depths : float32 (N,), at least 0; 0 for what is not drawn
    """
    return np.asarray(_sorted(depths.view(np.uint32)))


def binned(
    ellipses: Ellipses, order: NDArray[np.int32], size: tuple[int, int], *, threads: int = 1
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """List the splats that meet each tile.

    Parameters
    ----------
    ellipses : of all splats
    order : those that are drawn, the nearest first
    size : (width, height) of the picture, pixels
    threads : how many threads share the splats; the lists do not depend on it

    Returns
    -------
    starts : int64 (T + 1,), and members : int32: the splats of tile t are `members[starts[t] : starts[t + 1]]`
    """
    columns, rows = -(-size[0] // TILE), -(-size[1] // TILE)
    counts = np.zeros((threads, columns * rows), np.int64)
    n = len(order)

    def part(number: int) -> NDArray[np.int32]:
        return order[n * number // threads : n * (number + 1) // threads]

    def count(number: int) -> None:
        _count(ellipses, part(number), columns, rows, counts[number])

    in_threads(count, threads)
    in_tiles = counts.T.ravel()  # of a tile first those of the first part, which are nearer
    ends = np.cumsum(in_tiles)
    filled = np.ascontiguousarray((ends - in_tiles).reshape(-1, threads).T)
    starts = np.concatenate([np.zeros(1, np.int64), ends[threads - 1 :: threads]])
    members = np.empty(int(starts[-1]), np.int32)

    def fill(number: int) -> None:
        _fill(ellipses, part(number), columns, rows, filled[number], members)

    in_threads(fill, threads)
    return starts, members


@njit(cache=True, nogil=True, error_model="numpy")
def _sorted(keys):  # type: ignore[no-untyped-def]  # numba
    """Sort by radix the places of keys above 0: floats of one sign are in the order of their bits."""
    n = 0
    for i in range(keys.shape[0]):
        n += keys[i] > 0
    order, other = np.empty(n, np.int32), np.empty(n, np.int32)
    values, others = np.empty(n, np.uint32), np.empty(n, np.uint32)
    n_digits = (32 + DIGIT - 1) // DIGIT
    counts = np.zeros((n_digits, 1 << DIGIT), np.int64)
    mask = np.uint32((1 << DIGIT) - 1)
    at = 0
    for i in range(keys.shape[0]):
        if keys[i] > 0:
            order[at], values[at] = i, keys[i]
            at += 1
            for digit in range(n_digits):
                counts[digit, (keys[i] >> np.uint32(digit * DIGIT)) & mask] += 1
    for digit in range(n_digits):
        start = 0
        for value in range(1 << DIGIT):
            start, counts[digit, value] = start + counts[digit, value], start
        for i in range(n):
            value = (values[i] >> np.uint32(digit * DIGIT)) & mask
            to = counts[digit, value]
            counts[digit, value] = to + 1
            other[to], others[to] = order[i], values[i]
        order, other, values, others = other, order, others, values
    return order


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _tiles_of(ellipses, i, columns, rows):  # type: ignore[no-untyped-def]  # numba
    """Return the first and the last column and row of the tiles that a splat's box meets."""
    place, reach = ellipses.places[i], ellipses.reaches[i]
    x, y, reach_x, reach_y = place[0], place[1], reach[0], reach[1]
    first, last = int(np.floor((x - reach_x) / TILE)), int(np.floor((x + reach_x) / TILE))
    top, bottom = int(np.floor((y - reach_y) / TILE)), int(np.floor((y + reach_y) / TILE))
    return max(first, 0), min(last, columns - 1), max(top, 0), min(bottom, rows - 1)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _span(ellipses, i, row, first, last):  # type: ignore[no-untyped-def]  # numba
    """Return the first and the last column of the tiles of a row that a splat's ellipse meets.

    Between two lines the ellipse reaches farthest at one of them, or where it reaches farthest at all.
    """
    place, reach, shape = ellipses.places[i], ellipses.reaches[i], ellipses.shapes[i]
    x, y, reach_x, reach_y = np.float64(place[0]), np.float64(place[1]), np.float64(reach[0]), np.float64(reach[1])
    a, b, c = np.float64(shape[0]), np.float64(shape[1]), np.float64(shape[2])
    upper, lower = max(row * TILE - y, -reach_y), min(row * TILE + TILE - 1 - y, reach_y)
    if upper > lower:
        return last, first
    # At a height the ellipse is half * sqrt(1 - (height / reach_y)^2) wide to either side of -b / a * height.
    inner = c - b * b / a
    half = reach_y * np.sqrt(inner / a)  # as extent = reach_y^2 * inner
    low_side, high_side = np.inf, -np.inf
    for height in (upper, lower):
        share = height / reach_y
        width = half * np.sqrt(max(1 - share * share, 0.0))
        middle = -b / a * height
        low_side, high_side = min(low_side, middle - width), max(high_side, middle + width)
    farthest = -b / c * reach_x  # height where the ellipse reaches farthest to the right
    if upper <= farthest <= lower:
        high_side = reach_x
    if upper <= -farthest <= lower:
        low_side = -reach_x
    left, right = int(np.floor((x + low_side - 0.01) / TILE)), int(np.floor((x + high_side + 0.01) / TILE))
    return max(left, first), min(right, last)


@njit(cache=True, nogil=True, error_model="numpy")
def _count(ellipses, order, columns, rows, counts):  # type: ignore[no-untyped-def]  # numba
    """Count the splats that meet each tile."""
    for i in order:
        first, last, top, bottom = _tiles_of(ellipses, i, columns, rows)
        for row in range(top, bottom + 1):
            left, right = _span(ellipses, i, row, first, last)
            for column in range(left, right + 1):
                counts[row * columns + column] += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(ellipses, order, columns, rows, filled, members):  # type: ignore[no-untyped-def]  # numba
    """Enter the splats into the lists of the tiles that they meet, in their order."""
    for i in order:
        first, last, top, bottom = _tiles_of(ellipses, i, columns, rows)
        for row in range(top, bottom + 1):
            left, right = _span(ellipses, i, row, first, last)
            for column in range(left, right + 1):
                tile = row * columns + column
                members[filled[tile]] = i
                filled[tile] += 1

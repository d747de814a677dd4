"""Permeability filter: costs flow along rows and columns, along slanted surfaces too, and stop at edges of the picture.

Nothing of size (H, W, disparities) is ever held: sixteen disparities are aggregated at a time, contiguous in memory,
and the winner so far is kept. The upward pass and the winner-takes-all are one loop.

Source: Cigla and Alatan, Information permeability for stereo matching, Signal Processing: Image Communication 28, 2013.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.matching.guide import Passages
from recon.depth.matching.lanes import (
    N_LANES,
    add,
    add_scaled,
    hamming,
    load,
    lowest,
    moved_down,
    moved_up,
    spread_lane,
    store,
    zeros,
)
from recon.depth.matching.subpixel import vertex

LANE_BITS = np.int32(N_LANES - 1)
FEW_ROWS = 16  # at full HD 2 MiB, which stay near the processor
MAX_HELD = 6 << 20  # float32, 24 MiB: images whose flows are smaller are held whole
WORST = np.int32(0x7F800000)  # the bits of infinity


class Searched(NamedTuple):
    """A view, and in it the sixteen disparities that are searched at every pixel.

    codes : uint32 (2, H, W), two census codes of the reference view, whose Hamming distances are added
    facing_codes : uint32 (2, H, n), those of the other view, mirrored and framed: pixel x at disparity index k faces
        `facing_codes[:, y, origin + W - 1 - x + k]`
    passages : see `guide.permeabilities`
    start : int32, the first of the sixteen disparity indices of each square tile of 2 ** tile_bits pixels; where it
        changes from one pixel to the next, costs flow from lane to lane of the same disparity, and beyond the window
        its outermost cost
    slopes : two float32 arrays of the tiles' shape, pixels of disparity a column and a row, -1 to 1: costs flow from
        lane to lane as far as the surface rises between two pixels, and are interpolated between lanes
    tile_bits : log2 of a tile's side; between two neighbours costs flow along the slope of the left one's, or the upper
        one's, tile
    """

    codes: NDArray[np.uint32]
    facing_codes: NDArray[np.uint32]
    origin: int
    passages: Passages
    start: NDArray[np.int32]
    slopes: tuple[NDArray[np.float32], NDArray[np.float32]]
    tile_bits: int


class Winners(NamedTuple):
    """Each pixel's cheapest disparity so far; both arrays are updated.

    best : int32 (H, W), the winner's cost so far, see `lanes.lowest`
    chosen : float32 (H, W), the vertex of the parabola through the winner and its neighbours, disparity indices; it
        rounds to the winner
    n_disparities : indices below this may win; the outermost lanes of a window only at the ends of the range,
        because a winner needs both neighbours for its parabola
    flip : 0, the first of equally cheap disparities wins; 15, the last
    """

    best: NDArray[np.int32]
    chosen: NDArray[np.float32]
    n_disparities: int
    flip: int


@njit(inline="always")
def _shifted(scratch, lanes, shift):  # type: ignore[no-untyped-def]  # lanes have no Python type
    """Move the lanes down by `shift` places, the outermost repeated: another window on the same costs."""
    store(scratch, 0, spread_lane(lanes, 0))
    store(scratch, N_LANES, lanes)
    store(scratch, 2 * N_LANES, spread_lane(lanes, N_LANES - 1))
    return load(scratch, N_LANES + min(max(shift, -N_LANES), N_LANES))


@njit(inline="always")
def _tilted(lanes, rise):  # type: ignore[no-untyped-def]  # lanes have no Python type
    """Move the lanes up by a part of a place, or down if it is negative: the same surface one pixel further on."""
    if rise > 0:
        return add_scaled(add_scaled(lanes, -rise, lanes), rise, moved_up(lanes))
    if rise < 0:
        return add_scaled(add_scaled(lanes, rise, lanes), -rise, moved_down(lanes))
    return lanes


def rows_held(height: int, width: int) -> int:
    """Choose how many rows' flows to hold: all, or a few where recomputing is faster than reading memory."""
    return height if height * width * N_LANES <= MAX_HELD else FEW_ROWS


@njit(cache=True, nogil=True)
def aggregate_and_choose(view: Searched, winners: Winners, n_held: int) -> None:
    """Aggregate sixteen Hamming costs for every pixel and keep the cheapest if it beats the best so far.

    The upward pass needs the downward flows from the last row to the first. They are held for `n_held` rows at a time
    and computed again from the row above these, which alone is kept.

    Parameters
    ----------
    view : what is searched
    winners : updated
    n_held : rows, see `rows_held`; changes nothing but memory and time
    """
    height, width = view.passages.across.shape
    pitch = width * N_LANES
    n_chunks = (height + n_held - 1) // n_held
    held = np.zeros((n_held + 1) * pitch, np.float32)
    checkpoints = np.zeros(n_chunks * pitch, np.float32)
    upward = np.zeros(pitch, np.float32)
    for chunk in range(n_chunks):
        _copy(held, 0, checkpoints, chunk * pitch, pitch)
        last = min((chunk + 1) * n_held, height)
        _flow_down(view, chunk * n_held, last, held)
        if chunk + 1 < n_chunks:
            _copy(held, n_held * pitch, held, 0, pitch)
    for chunk in range(n_chunks - 1, -1, -1):
        first, last = chunk * n_held, min((chunk + 1) * n_held, height)
        if chunk + 1 < n_chunks:
            _copy(checkpoints, chunk * pitch, held, 0, pitch)
            _flow_down(view, first, last, held)
        _flow_up_and_choose(view, first, last, held, upward, winners)


@njit(cache=True, nogil=True)
def _copy(source: NDArray[np.float32], begin: int, target: NDArray[np.float32], place: int, n: int) -> None:
    """Copy n numbers; assigned as slices they take two seconds more to compile, for the message of an error."""
    for index in range(n):
        target[place + index] = source[begin + index]


@njit(cache=True, nogil=True)
def _flow_down(view: Searched, first: int, last: int, held: NDArray[np.float32]) -> None:
    """Aggregate the costs of rows first to last along rows and from above; held[0] is the row above the first."""
    codes, facing_codes, origin, (across, down, passage), start, (rise, fall), tile_bits = view
    width, pitch = across.shape[1], facing_codes.shape[2]
    sharp, blurred = facing_codes[0].reshape(-1), facing_codes[1].reshape(-1)
    forward = np.empty(width * N_LANES, np.float32)
    scratch = np.empty(3 * N_LANES, np.float32)
    for y in range(first, last):
        flow = zeros()
        open_ = np.float32(0)
        window = start[y >> tile_bits, 0]
        for x in range(width):
            if start[y >> tile_bits, x >> tile_bits] != window:
                flow = _shifted(scratch, flow, start[y >> tile_bits, x >> tile_bits] - window)
                window = start[y >> tile_bits, x >> tile_bits]
            if x > 0:
                flow = _tilted(flow, rise[y >> tile_bits, (x - 1) >> tile_bits])
            facing = y * pitch + origin + width - 1 - x + window
            cost = add(hamming(codes[0, y, x], sharp, facing), hamming(codes[1, y, x], blurred, facing))
            flow = add_scaled(cost, open_, flow)
            store(forward, x * N_LANES, flow)
            open_ = passage[across[y, x]]
        flow = zeros()
        for x in range(width - 1, -1, -1):
            if start[y >> tile_bits, x >> tile_bits] != window:
                flow = _shifted(scratch, flow, start[y >> tile_bits, x >> tile_bits] - window)
                window = start[y >> tile_bits, x >> tile_bits]
            flow = _tilted(flow, -rise[y >> tile_bits, x >> tile_bits])
            facing = y * pitch + origin + width - 1 - x + window
            cost = add(hamming(codes[0, y, x], sharp, facing), hamming(codes[1, y, x], blurred, facing))
            open_ = passage[across[y, x]]
            in_row = add_scaled(load(forward, x * N_LANES), open_, flow)
            flow = add_scaled(cost, open_, flow)
            if y > 0:
                above = load(held, ((y - first) * width + x) * N_LANES)
                if start[(y - 1) >> tile_bits, x >> tile_bits] != window:
                    above = _shifted(scratch, above, window - start[(y - 1) >> tile_bits, x >> tile_bits])
                above = _tilted(above, fall[(y - 1) >> tile_bits, x >> tile_bits])
                in_row = add_scaled(in_row, passage[down[y - 1, x]], above)
            store(held, ((y - first + 1) * width + x) * N_LANES, in_row)


@njit(cache=True, nogil=True)
def _flow_up_and_choose(
    view: Searched, first: int, last: int, held: NDArray[np.float32], upward: NDArray[np.float32], winners: Winners
) -> None:
    """Add what flows up to rows last to first, and keep each pixel's cheapest disparity; `upward` is carried on."""
    _, _, _, (_, down, passage), start, (_, fall), tile_bits = view
    best, chosen, n_disparities, flip = winners
    height, width = down.shape
    scratch = np.empty(3 * N_LANES, np.float32)
    for y in range(last - 1, first - 1, -1):
        for x in range(width):
            window = start[y >> tile_bits, x >> tile_bits]
            below = load(upward, x * N_LANES)
            if y + 1 < height and start[(y + 1) >> tile_bits, x >> tile_bits] != window:
                below = _shifted(scratch, below, window - start[(y + 1) >> tile_bits, x >> tile_bits])
            below = _tilted(below, -fall[y >> tile_bits, x >> tile_bits])
            total = add_scaled(load(held, ((y - first + 1) * width + x) * N_LANES), passage[down[y, x]], below)
            without_above = total
            if y > 0:
                above = load(held, ((y - first) * width + x) * N_LANES)
                if start[(y - 1) >> tile_bits, x >> tile_bits] != window:
                    above = _shifted(scratch, above, window - start[(y - 1) >> tile_bits, x >> tile_bits])
                above = _tilted(above, fall[(y - 1) >> tile_bits, x >> tile_bits])
                without_above = add_scaled(total, -passage[down[y - 1, x]], above)
            store(upward, x * N_LANES, without_above)
            lowest_lane = 0 if window == 0 else 1
            highest_lane = min(n_disparities - window, N_LANES) - 1
            if window + N_LANES < n_disparities:
                highest_lane -= 1
            key = lowest(total, lowest_lane, highest_lane, flip)
            if key & ~LANE_BITS < best[y, x] & ~LANE_BITS:
                lane = (key & LANE_BITS) ^ np.int32(flip)
                best[y, x] = key
                chosen[y, x] = np.float32(window + lane)
                if 0 < window + lane < n_disparities - 1:
                    store(scratch, 0, total)
                    chosen[y, x] += vertex(scratch, lane)

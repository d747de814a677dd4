"""Permeability filter: costs flow along rows and columns and stop at edges of the picture.

Nothing of size (H, W, disparities) is ever held: sixteen disparities are aggregated at a time, contiguous in memory,
and the winner so far is kept. The upward pass and the winner-takes-all are one loop.

Source: Cigla and Alatan, Information permeability for stereo matching, Signal Processing: Image Communication 28, 2013.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.bands import Bands
from recon.depth.lanes import N_LANES, add, add_scaled, hamming, load, lowest, spread_lane, store, zeros

LANE_BITS = np.int32(N_LANES - 1)
MAX_OFFSET = 0.4999  # pixels from a winner to its parabola's vertex: the vertex rounds to the winner
FEW_ROWS = 16  # at full HD 2 MiB, which stay near the processor
MAX_HELD = 6 << 20  # float32, 24 MiB: images whose flows are smaller are held whole
CLOSED = 255  # a change of the guide that nothing passes
WORST = np.int32(0x7F800000)  # the bits of infinity
GUIDE_WINDOW = 5  # pixels, of the bilateral filter
GUIDE_REACH = 2.0  # pixels, its spatial deviation
GUIDE_TOLERANCE = 3.0  # its deviation in grey levels, in units of the image's noise
MIN_NOISE = 0.1  # grey levels; a rendered image has none, the filter needs some
SURFACE_LANE = 7  # of sixteen, the one that stands for the surface itself
SURFACE_REACH = 2  # pixels of disparity by which a surface may move
SURFACE_STEP = 1.5  # pixels of disparity between neighbours of one surface
FRAME = 10  # places before the first and after the last disparity that `aggregate_along_surface` may look at
MAX_NOISE = 8.0  # grey levels; what varies more is texture
NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
NOISE_GAIN = 6 * 0.6745  # the kernel's norm; a normal distribution's median absolute deviation


def noise_level(grey: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None) -> float:
    """Standard deviation of an image's noise, grey levels, between 0.1 and 8.

    Source: Immerkaer, Fast noise variance estimation, Computer Vision and Image Understanding 64, 1996, with the
    median in place of the mean, so that texture counts little.
    """
    response = np.abs(cv2.filter2D(grey, cv2.CV_16S, NOISE_KERNEL))
    inside = response if mask is None else response[mask]
    histogram = np.bincount(inside.ravel())
    half = np.searchsorted(np.cumsum(histogram), inside.size / 2)
    return min(max(float(half) / NOISE_GAIN, MIN_NOISE), MAX_NOISE)


def guide_image(image: NDArray[np.uint8], noise: float) -> NDArray[np.uint8]:
    """The image whose edges stop the flow: noise taken out, edges kept.

    A 3x3 median, then a bilateral filter as wide as the noise: noise left in the guide closes every passage.

    Parameters
    ----------
    image : uint8 (H, W, 3) or (H, W)
    noise : standard deviation, grey levels
    """
    median = cv2.medianBlur(np.ascontiguousarray(image), 3)
    smooth = cv2.bilateralFilter(median, GUIDE_WINDOW, GUIDE_TOLERANCE * noise, GUIDE_REACH)
    return np.asarray(smooth, dtype=np.uint8)


class Passages(NamedTuple):
    """How freely costs pass from each pixel to its right and its lower neighbour: `passage[across]`, `passage[down]`.

    across, down : uint8 (H, W), how much the guide changes, grey levels; 255 where nothing passes
    passage : float32 (256,), exp(-change / sigma), 0 for 255
    """

    across: NDArray[np.uint8]
    down: NDArray[np.uint8]
    passage: NDArray[np.float32]


def permeabilities(guide: NDArray[np.uint8], *, sigma: float, mask: NDArray[np.bool_] | None = None) -> Passages:
    """How freely costs pass between neighbours; not at all beyond the last column and the last row.

    Parameters
    ----------
    guide : uint8 (H, W, 3) or (H, W); the channel that differs most decides
    sigma : grey levels
    mask : bool (H, W); nothing passes its border

    Source
    ------
    Cigla and Alatan 2013, equation 2.
    """
    passage = np.exp(-np.arange(256, dtype=np.float64) / sigma).astype(np.float32)
    passage[CLOSED] = 0
    across, down = np.empty(guide.shape[:2], np.uint8), np.empty(guide.shape[:2], np.uint8)
    _change_kernel(guide.reshape(*guide.shape[:2], -1), across, down)
    if mask is not None:
        across[:, :-1][mask[:, 1:] != mask[:, :-1]] = CLOSED
        down[:-1][mask[1:] != mask[:-1]] = CLOSED
    return Passages(across, down, passage)


@njit(cache=True, nogil=True)
def _change_kernel(guide: NDArray[np.uint8], across: NDArray[np.uint8], down: NDArray[np.uint8]) -> None:
    height, width, n_channels = guide.shape
    across[:, width - 1] = CLOSED
    down[height - 1] = CLOSED
    for y in range(height):
        for x in range(width):
            to_right, to_below = np.int32(0), np.int32(0)
            for channel in range(n_channels):
                here = np.int32(guide[y, x, channel])
                if x + 1 < width:
                    to_right = max(to_right, abs(here - np.int32(guide[y, x + 1, channel])))
                if y + 1 < height:
                    to_below = max(to_below, abs(here - np.int32(guide[y + 1, x, channel])))
            if x + 1 < width:
                across[y, x] = to_right
            if y + 1 < height:
                down[y, x] = to_below


@njit(inline="always")
def _vertex(costs: NDArray[np.float32], lane: int) -> np.float32:
    """Where the parabola through a lane and its two neighbours is lowest, pixels from the lane, less than a half."""
    before, here, after = costs[lane - 1], costs[lane], costs[lane + 1]
    bend = before - np.float32(2) * here + after
    if bend <= 0:
        return np.float32(0)
    vertex = np.float32(0.5) * (before - after) / bend
    return min(max(vertex, np.float32(-MAX_OFFSET)), np.float32(MAX_OFFSET))


@njit(inline="always")
def _shifted(scratch, lanes, shift):  # type: ignore[no-untyped-def]  # lanes have no Python type
    """The lanes moved down by `shift` places, the outermost repeated: another window on the same costs."""
    store(scratch, 0, spread_lane(lanes, 0))
    store(scratch, N_LANES, lanes)
    store(scratch, 2 * N_LANES, spread_lane(lanes, N_LANES - 1))
    return load(scratch, N_LANES + min(max(shift, -N_LANES), N_LANES))


def rows_held(height: int, width: int) -> int:
    """How many rows' flows to hold: all, or a few where memory is farther than computing twice."""
    return height if height * width * N_LANES <= MAX_HELD else FEW_ROWS


@njit(cache=True, nogil=True)
def aggregate_and_choose(
    codes: NDArray[np.uint32],
    facing_codes: NDArray[np.uint32],
    origin: int,
    passages: Passages,
    start: NDArray[np.int32],
    tile_bits: int,
    n_disparities: int,
    flip: int,
    n_held: int,
    best: NDArray[np.int32],
    found: NDArray[np.float32],
) -> None:
    """Aggregate sixteen Hamming costs for every pixel and keep the cheapest if it beats the best so far.

    The upward pass needs the downward flows from the last row to the first. They are held for `n_held` rows at a time
    and computed again from the row above these, which alone is kept.

    Parameters
    ----------
    codes : uint32 (2, H, W), two census codes of the reference view, whose Hamming distances are added
    facing_codes : uint32 (2, H, n), those of the other view, mirrored and framed: pixel x at disparity index k faces
        `facing_codes[:, y, origin + W - 1 - x + k]`
    passages : see `permeabilities`
    start : int32, the first of the sixteen disparity indices of each square tile of 2 ** tile_bits pixels; where it
        changes from one pixel to the next, costs flow from lane to lane of the same disparity, and beyond the window
        its outermost cost
    n_disparities : indices below this may win; the outermost lanes of a window only at the ends of the range,
        because a winner needs both neighbours for its parabola
    flip : 0, the first of equally cheap disparities wins; 15, the last
    n_held : rows, see `rows_held`; changes nothing but memory and time
    best : int32 (H, W), the winner's cost so far, see `lanes.lowest`; updated
    found : float32 (H, W), the vertex of the parabola through the winner and its neighbours, disparity indices; it
        rounds to the winner; updated
    """
    height, width = passages.across.shape
    pitch = width * N_LANES
    n_chunks = (height + n_held - 1) // n_held
    held = np.zeros((n_held + 1) * pitch, np.float32)
    checkpoints = np.zeros(n_chunks * pitch, np.float32)
    upward = np.zeros(pitch, np.float32)
    view = (codes, facing_codes, origin, passages, start, tile_bits)
    for chunk in range(n_chunks):
        checkpoints[chunk * pitch : (chunk + 1) * pitch] = held[:pitch]
        last = min((chunk + 1) * n_held, height)
        _flow_down(view, chunk * n_held, last, held)
        if chunk + 1 < n_chunks:
            held[:pitch] = held[n_held * pitch :]
    for chunk in range(n_chunks - 1, -1, -1):
        first, last = chunk * n_held, min((chunk + 1) * n_held, height)
        if chunk + 1 < n_chunks:
            held[:pitch] = checkpoints[chunk * pitch : (chunk + 1) * pitch]
            _flow_down(view, first, last, held)
        _flow_up_and_choose(view, first, last, held, upward, n_disparities, flip, best, found)


@njit(cache=True, nogil=True)
def _flow_down(view, first, last, held):  # type: ignore[no-untyped-def]  # a tuple of arrays
    """The costs of rows first to last, aggregated along rows and from above; held[0] is the row above the first."""
    codes, facing_codes, origin, (across, down, passage), start, tile_bits = view
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
            facing = y * pitch + origin + width - 1 - x + window
            cost = add(hamming(codes[0, y, x], sharp, facing), hamming(codes[1, y, x], blurred, facing))
            open_ = passage[across[y, x]]
            in_row = add_scaled(load(forward, x * N_LANES), open_, flow)
            flow = add_scaled(cost, open_, flow)
            if y > 0:
                above = load(held, ((y - first) * width + x) * N_LANES)
                if start[(y - 1) >> tile_bits, x >> tile_bits] != window:
                    above = _shifted(scratch, above, window - start[(y - 1) >> tile_bits, x >> tile_bits])
                in_row = add_scaled(in_row, passage[down[y - 1, x]], above)
            store(held, ((y - first + 1) * width + x) * N_LANES, in_row)


@njit(cache=True, nogil=True)
def _flow_up_and_choose(view, first, last, held, upward, n_disparities, flip, best, found):  # type: ignore[no-untyped-def]  # a tuple of arrays
    """Add what flows up to rows last to first, and keep each pixel's cheapest disparity; `upward` is carried on."""
    _, _, _, (_, down, passage), start, tile_bits = view
    height, width = down.shape
    scratch = np.empty(3 * N_LANES, np.float32)
    for y in range(last - 1, first - 1, -1):
        for x in range(width):
            window = start[y >> tile_bits, x >> tile_bits]
            below = load(upward, x * N_LANES)
            if y + 1 < height and start[(y + 1) >> tile_bits, x >> tile_bits] != window:
                below = _shifted(scratch, below, window - start[(y + 1) >> tile_bits, x >> tile_bits])
            total = add_scaled(load(held, ((y - first + 1) * width + x) * N_LANES), passage[down[y, x]], below)
            without_above = total
            if y > 0:
                above = load(held, ((y - first) * width + x) * N_LANES)
                if start[(y - 1) >> tile_bits, x >> tile_bits] != window:
                    above = _shifted(scratch, above, window - start[(y - 1) >> tile_bits, x >> tile_bits])
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
                found[y, x] = np.float32(window + lane)
                if 0 < window + lane < n_disparities - 1:
                    store(scratch, 0, total)
                    found[y, x] += _vertex(scratch, lane)


def aggregate_along_surface(
    codes: NDArray[np.uint32],
    facing_codes: NDArray[np.uint32],
    origin: int,
    passages: Passages,
    surface: NDArray[np.float32],
    n_disparities: int,
    in_bands: Bands,
) -> NDArray[np.float32]:
    """Refine a surface: aggregate the costs around it along its slant and move it to the parabola's vertex.

    Lane k of a pixel stands for its surface + k - 7, so costs flow from pixel to pixel of a slanted surface without
    leaving their lane, and to no other surface. Costs between whole disparities are interpolated.

    Parameters
    ----------
    codes, facing_codes, origin, passages : as in `aggregate_and_choose`
    surface : float32 (H, W), disparity indices
    in_bands : does the work given for rows or columns first to last, in as many parts as there are threads

    Returns
    -------
    refined : float32 (H, W), disparity indices
    """
    height, width = surface.shape
    flows = np.empty(height * width * N_LANES, np.float32)
    refined = np.empty((height, width), np.float32)
    in_bands(height, partial(_surface_rows, codes, facing_codes, origin, passages, surface, flows))
    in_bands(width, partial(_surface_columns, passages, surface, n_disparities, flows, refined))
    return refined


@njit(cache=True, nogil=True)
def _surface_rows(
    codes: NDArray[np.uint32],
    facing_codes: NDArray[np.uint32],
    origin: int,
    passages: Passages,
    surface: NDArray[np.float32],
    flows: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    across, passage = passages.across, passages.passage
    width = surface.shape[1]
    pitch = facing_codes.shape[2]
    sharp, blurred = facing_codes[0].reshape(-1), facing_codes[1].reshape(-1)
    costs = np.empty(width * N_LANES, np.float32)
    for y in range(first, last):
        flow = zeros()
        open_ = np.float32(0)
        for x in range(width):
            whole = np.int64(np.floor(surface[y, x]))
            part = surface[y, x] - np.float32(whole)
            facing = y * pitch + origin + width - 1 - x + whole - SURFACE_LANE
            cost = add(hamming(codes[0, y, x], sharp, facing), hamming(codes[1, y, x], blurred, facing))
            next_cost = add(hamming(codes[0, y, x], sharp, facing + 1), hamming(codes[1, y, x], blurred, facing + 1))
            cost = add_scaled(add_scaled(cost, part, next_cost), -part, cost)
            store(costs, x * N_LANES, cost)
            flow = add_scaled(cost, open_, flow)
            store(flows, (y * width + x) * N_LANES, flow)
            open_ = passage[across[y, x]]
            if x + 1 < width and abs(surface[y, x + 1] - surface[y, x]) > np.float32(SURFACE_STEP):
                open_ = np.float32(0)
        flow = zeros()
        for x in range(width - 1, -1, -1):
            open_ = passage[across[y, x]]
            if x + 1 < width and abs(surface[y, x + 1] - surface[y, x]) > np.float32(SURFACE_STEP):
                open_ = np.float32(0)
            place = (y * width + x) * N_LANES
            store(flows, place, add_scaled(load(flows, place), open_, flow))
            flow = add_scaled(load(costs, x * N_LANES), open_, flow)


@njit(cache=True, nogil=True)
def _surface_columns(
    passages: Passages,
    surface: NDArray[np.float32],
    n_disparities: int,
    flows: NDArray[np.float32],
    refined: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    down, passage = passages.down, passages.passage
    height, width = surface.shape
    upward = np.zeros((last - first) * N_LANES, np.float32)
    scratch = np.empty(N_LANES, np.float32)
    for y in range(1, height):
        for x in range(first, last):
            if abs(surface[y, x] - surface[y - 1, x]) <= np.float32(SURFACE_STEP):
                place = (y * width + x) * N_LANES
                above = load(flows, place - width * N_LANES)
                store(flows, place, add_scaled(load(flows, place), passage[down[y - 1, x]], above))
    for y in range(height - 1, -1, -1):
        for x in range(first, last):
            place = (y * width + x) * N_LANES
            total = load(flows, place)
            if y + 1 < height and abs(surface[y + 1, x] - surface[y, x]) <= np.float32(SURFACE_STEP):
                total = add_scaled(total, passage[down[y, x]], load(upward, (x - first) * N_LANES))
            without_above = total
            if y > 0 and abs(surface[y, x] - surface[y - 1, x]) <= np.float32(SURFACE_STEP):
                above = load(flows, place - width * N_LANES)
                without_above = add_scaled(total, -passage[down[y - 1, x]], above)
            store(upward, (x - first) * N_LANES, without_above)
            lane = lowest(total, SURFACE_LANE - SURFACE_REACH, SURFACE_LANE + SURFACE_REACH, 0) & LANE_BITS
            store(scratch, 0, total)
            found = surface[y, x] + np.float32(lane - SURFACE_LANE) + _vertex(scratch, lane)
            refined[y, x] = min(max(found, np.float32(0)), np.float32(n_disparities - 1))

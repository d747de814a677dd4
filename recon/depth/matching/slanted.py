"""Aggregation along a slanted surface: what moves DR's disparities from slices to the surface itself.

Source: the permeability filter of Cigla and Alatan 2013, its costs taken around a surface instead of at a disparity.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.matching.guide import Passages
from recon.depth.matching.lanes import (
    N_LANES,
    add,
    add_scaled,
    hamming,
    load_eight,
    lowest,
    moved_down,
    store,
    store_eight,
    zeros,
)
from recon.depth.matching.subpixel import vertex
from recon.runtime.workers import in_bands

N_KEPT = N_LANES // 2  # lanes that are held: all that a winner and its parabola may need
CENTRE = 3  # the lane that stands for the surface itself
MOST_MOVED = 2  # pixels of disparity by which a surface may move
SURFACE_STEP = 1.5  # pixels of disparity between neighbours of one surface
SPARE = N_LANES - CENTRE + 1  # places before the first and after the last disparity that may be looked at
STRIP = 64  # columns whose flows stay near the processor on their way down and up: 2 MiB at full HD


def aggregate_along_surface(
    codes: NDArray[np.uint32],
    facing_codes: NDArray[np.uint32],
    origin: int,
    passages: Passages,
    surface: NDArray[np.float32],
    n_disparities: int,
) -> NDArray[np.float32]:
    """Refine a surface, float32 (H, W): aggregate costs around it along its slant, move it to the parabola's vertex.

    Lane k of a pixel stands for its surface + k - 3, so costs flow from pixel to pixel of a slanted surface without
    leaving their lane, and to no other surface. Costs between whole disparities are interpolated.

    Parameters
    ----------
    codes, facing_codes, origin, passages : as in `permeability.Searched`
    surface : float32 (H, W), disparity indices
    n_disparities : how many are searched
    """
    height, width = surface.shape
    flows = np.empty(height * width * N_KEPT, np.float32)
    refined = np.empty((height, width), np.float32)
    in_bands(height, partial(_flow_along_rows, codes, facing_codes, origin, passages, surface, flows))
    in_bands(width, partial(_flow_along_columns, passages, surface, n_disparities, flows, refined))
    return refined


@njit(cache=True, nogil=True)
def _flow_along_rows(
    codes: NDArray[np.uint32],
    facing_codes: NDArray[np.uint32],
    origin: int,
    passages: Passages,
    surface: NDArray[np.float32],
    flows: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    """Aggregate the costs around the surface along rows first to last: N_KEPT flows a pixel."""
    across, passage = passages.across, passages.passage
    width = surface.shape[1]
    pitch = facing_codes.shape[2]
    sharp, blurred = facing_codes[0].reshape(-1), facing_codes[1].reshape(-1)
    costs = np.empty(width * N_KEPT, np.float32)
    open_ = np.zeros(width + 1, np.float32)
    for y in range(first, last):
        for x in range(1, width):
            is_same_surface = abs(surface[y, x] - surface[y, x - 1]) <= np.float32(SURFACE_STEP)
            open_[x] = passage[across[y, x - 1]] if is_same_surface else np.float32(0)
        flow = zeros()
        for x in range(width):
            whole = np.int64(np.floor(surface[y, x]))
            part = surface[y, x] - np.float32(whole)
            facing = y * pitch + origin + width - 1 - x + whole - CENTRE
            cost = add(hamming(codes[0, y, x], sharp, facing), hamming(codes[1, y, x], blurred, facing))
            cost = add_scaled(add_scaled(cost, part, moved_down(cost)), -part, cost)
            store_eight(costs, x * N_KEPT, cost)
            flow = add_scaled(cost, open_[x], flow)
            store_eight(flows, (y * width + x) * N_KEPT, flow)
        flow = zeros()
        for x in range(width - 1, -1, -1):
            place = (y * width + x) * N_KEPT
            store_eight(flows, place, add_scaled(load_eight(flows, place), open_[x + 1], flow))
            flow = add_scaled(load_eight(costs, x * N_KEPT), open_[x + 1], flow)


@njit(cache=True, nogil=True)
def _flow_along_columns(
    passages: Passages,
    surface: NDArray[np.float32],
    n_disparities: int,
    flows: NDArray[np.float32],
    refined: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    """Aggregate columns first to last, and move each pixel's surface to where its costs are lowest."""
    down, passage = passages.down, passages.passage
    height, width = surface.shape
    held = np.empty(height * STRIP * N_KEPT, np.float32)
    upward = np.empty(STRIP * N_KEPT, np.float32)
    scratch = np.empty(N_LANES, np.float32)
    for begin in range(first, last, STRIP):
        end = min(begin + STRIP, last)
        for y in range(height):
            for x in range(begin, end):
                place = (y * STRIP + x - begin) * N_KEPT
                flow = load_eight(flows, (y * width + x) * N_KEPT)
                if y > 0 and abs(surface[y, x] - surface[y - 1, x]) <= np.float32(SURFACE_STEP):
                    flow = add_scaled(flow, passage[down[y - 1, x]], load_eight(held, place - STRIP * N_KEPT))
                store_eight(held, place, flow)
        for y in range(height - 1, -1, -1):
            for x in range(begin, end):
                place = (y * STRIP + x - begin) * N_KEPT
                total = load_eight(held, place)
                if y + 1 < height and abs(surface[y + 1, x] - surface[y, x]) <= np.float32(SURFACE_STEP):
                    total = add_scaled(total, passage[down[y, x]], load_eight(upward, (x - begin) * N_KEPT))
                without_above = total
                if y > 0 and abs(surface[y, x] - surface[y - 1, x]) <= np.float32(SURFACE_STEP):
                    above = load_eight(held, place - STRIP * N_KEPT)
                    without_above = add_scaled(total, -passage[down[y - 1, x]], above)
                store_eight(upward, (x - begin) * N_KEPT, without_above)
                lane = lowest(total, CENTRE - MOST_MOVED, CENTRE + MOST_MOVED, 0) & np.int32(N_LANES - 1)
                store(scratch, 0, total)
                moved = surface[y, x] + np.float32(lane - CENTRE) + vertex(scratch, lane)
                refined[y, x] = min(max(moved, np.float32(0)), np.float32(n_disparities - 1))

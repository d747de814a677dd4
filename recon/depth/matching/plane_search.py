"""PatchMatch's search: what a pixel does in one sweep to find a plane of lower energy.

A plane is three float32: the disparity at its pixel, and its change a column and a row. Its energy is the cost of the
pixel's window along it, every other pixel of 33x33, plus how far it is from the four neighbours' planes.

A pixel looks only where there is news: at neighbours whose planes changed since it looked last, at the pixel that it
matches if either's plane changed, and around its own plane while that is changing. Most pixels soon rest.

numba counts who holds an array that is handed on, which took half of the time here: `_nrt=False` has it not count. So
nothing here makes an array.

Source: Bleyer, Rhemann and Rother, PatchMatch stereo: stereo matching with slanted support windows, BMVC 2011.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from recon.depth.matching.lanes import (
    N_LANES,
    add,
    add_scaled,
    byte_distance,
    falling,
    gather,
    load,
    lower_half,
    multiply,
    store,
    total,
    truncated_difference,
    upper_half,
    zeros,
)
from recon.depth.matching.texture import FINE, PAD, WINDOW_REACH

N_ROWS = WINDOW_REACH + 1
TAPS = N_ROWS * N_LANES
MAX_SLOPE = 0.9  # pixels of disparity a pixel; at 1 a surface is seen edge-on
SLOPE_SHARE = 0.3  # slopes are changed by this share of what the disparity is changed by
LAST_STEP = 0.1  # pixels (Bleyer et al.): smaller changes are not tried
SAME_PLANE = 0.1  # pixels by which planes must differ around a pixel to be tried apart
SAME_WITHIN = 5  # pixels around it
NEIGHBOURS = (1, 5, 15)  # pixels: planes come from this far away
N_NEIGHBOURS = 4 * len(NEIGHBOURS)
N_TRIALS = N_NEIGHBOURS + 1 + 3  # the neighbours, the other view, and random changes
ROUND = 4  # sweeps in which the random changes are of each size once
NEWS = 0.03  # of its energy: by less a plane improves without telling its neighbours
AT_REST = -4  # a turn long ago


class Settings(NamedTuple):
    """The numbers that a sweep needs, each a float32; grey levels in 256ths, `fall` as in `lanes.falling`."""

    lowest: np.float32
    highest: np.float32
    first_step: np.float32
    fall: np.float32
    gradient_share: np.float32
    grey_limit: np.float32
    gradient_limit: np.float32
    smoothness: np.float32
    distance_limit: np.float32


@njit(cache=True, nogil=True, _nrt=False)
def sweep(seen, passages, settings, others, others_moved, turn, seed, planes, costs, moved, taps, first, last):  # type: ignore[no-untyped-def]  # tuples
    """Let the pixels of one colour of the chessboard, in rows first to last, look for better planes.

    Parameters
    ----------
    seen : colours and words of `Texture`; the other view's `fine`, which this view faces mirrored
    passages : Passages: how much neighbours should agree
    settings : Settings
    others, others_moved : planes and moved of the other view, which is mirrored
    turn : number of this turn, even for one colour of the chessboard, odd for the other; two are a sweep
    seed : makes the random changes of one sweep differ from another's
    planes : float32 (H, W, 3); updated
    costs : float32 (H, W), of each pixel's window along its plane, negative where not yet known, infinite where the
        plane is to stay; updated
    moved : int16 (H, W), the turn in which each pixel's plane last improved by `NEWS`; before the first turn 0, or
        `AT_REST` where it is already settled; updated
    taps : float32 (3 TAPS,), to work in
    """
    height, width = costs.shape
    for y in range(first, last):
        for x in range((y + turn) % 2, width, 2):
            plane = _plane_at(planes, y, x)
            news = _news(plane, others_moved, moved, settings, turn, y, x)
            if news == 0 or costs[y, x] == np.float32(np.inf):
                continue
            weight = _take_window(seen, settings, y, x, taps)
            place = (y, x, height, width, weight)
            if costs[y, x] < 0:
                costs[y, x] = _window_cost(taps, seen[2], plane, place, settings, np.float32(np.inf))
            before = costs[y, x] + _roughness(planes, plane, passages, place, settings)
            best = (costs[y, x], before)
            state = np.uint32(seed * 0x9E3779B1 + y * 0x85EBCA6B + x * 0xC2B2AE35)
            for number in range(N_TRIALS):
                if not news >> number & 1:
                    continue
                if number < N_NEIGHBOURS:
                    row, column = _neighbour(number, y, x)
                    trial = _extended(_plane_at(planes, row, column), x - column, y - row)
                elif number == N_NEIGHBOURS:
                    there = min(max(width - 1 - x + np.int64(np.rint(plane[0])), 0), width - 1)
                    trial = _seen_from_other(_plane_at(others, y, there), width - 1 - x - there)
                else:
                    state, trial = _changed(plane, _step(number, settings, turn), state)
                plane, best = _better(trial, plane, best, taps, seen[2], planes, passages, place, settings)
            if before - best[1] > np.float32(NEWS) * before:
                moved[y, x] = turn
            costs[y, x] = best[0]
            planes[y, x, 0], planes[y, x, 1], planes[y, x, 2] = plane


@njit(cache=True, nogil=True, _nrt=False)
def _news(plane, others_moved, moved, settings, turn, y, x):  # type: ignore[no-untyped-def]  # tuples
    """Tell which trials are worth it, a bit each: neighbours, the pixel that is matched, random changes."""
    height, width = moved.shape
    news = 0
    for number in range(N_NEIGHBOURS):
        row, column = _neighbour(number, y, x)
        since = turn - 1 if number < 4 else max(turn - 1, 1)  # at first, only the next pixels are news
        if 0 <= row < height and 0 <= column < width and moved[row, column] >= since:
            news |= 1 << number
    is_moving = moved[y, x] >= turn - 3
    there = width - 1 - x + np.int64(np.rint(plane[0]))
    if 0 <= there < width and (is_moving or others_moved[y, there] >= (turn | 1) - 3):
        news |= 1 << N_NEIGHBOURS
    if is_moving:
        for number in range(N_NEIGHBOURS + 1, N_TRIALS):
            if _step(number, settings, turn) > np.float32(LAST_STEP):
                news |= 1 << number
    return news


@njit(cache=True, nogil=True, _nrt=False)
def _neighbour(number, y, x):  # type: ignore[no-untyped-def]  # tuples
    """Return row and column of a neighbour: right, left, below and above, at each distance."""
    distance = NEIGHBOURS[number >> 2]
    if number & 1:
        distance = -distance
    return (y + distance, x) if number & 2 else (y, x + distance)


@njit(cache=True, nogil=True, _nrt=False)
def _step(number, settings, turn):  # type: ignore[no-untyped-def]  # tuples
    """Return how far a trial changes the plane at most: half as far in each sweep, in four of them by all sizes."""
    return settings.first_step / np.float32(1 << (turn // 2 % ROUND + ROUND * (number - N_NEIGHBOURS - 1)))


@njit(cache=True, nogil=True, _nrt=False)
def _better(trial, plane, best, taps, target, planes, passages, place, settings):  # type: ignore[no-untyped-def]  # tuples
    """Return the plane of lower energy with its window's cost and its energy; `best` are those of `plane`."""
    trial = (
        min(max(trial[0], settings.lowest), settings.highest),
        min(max(trial[1], np.float32(-MAX_SLOPE)), np.float32(MAX_SLOPE)),
        min(max(trial[2], np.float32(-MAX_SLOPE)), np.float32(MAX_SLOPE)),
    )
    slopes = abs(trial[1] - plane[1]) + abs(trial[2] - plane[2])
    if abs(trial[0] - plane[0]) + np.float32(SAME_WITHIN) * slopes < np.float32(SAME_PLANE):
        return plane, best
    rough = _roughness(planes, trial, passages, place, settings)
    if rough >= best[1]:
        return plane, best
    cost = _window_cost(taps, target, trial, place, settings, best[1] - rough)
    if cost + rough >= best[1]:
        return plane, best
    return trial, (cost, cost + rough)


@njit(cache=True, nogil=True, _nrt=False)
def _take_window(seen, settings, y, x, taps):  # type: ignore[no-untyped-def]  # tuples
    """Copy the taps of a pixel's window: weights, grey and gradient; return the sum of the weights."""
    colours, words, _ = seen
    height, half = colours.shape[0], colours.shape[2]
    centre = colours[y, (x + PAD) & 1, (x + PAD) >> 1]
    sum_ = zeros()
    for row in range(N_ROWS):
        line = y + 2 * row - WINDOW_REACH
        if line < 0 or line >= height:
            continue
        column = x + PAD - WINDOW_REACH + (row & 1)
        place = (line * 2 + (column & 1)) * half + (column >> 1)
        weight = falling(byte_distance(centre, load(colours, place)), settings.fall)
        word = load(words, place)
        store(taps, row * N_LANES, weight)
        store(taps, TAPS + row * N_LANES, lower_half(word))
        store(taps, 2 * TAPS + row * N_LANES, upper_half(word))
        sum_ = add(sum_, weight)
    return total(sum_)


@njit(cache=True, nogil=True, _nrt=False)
def _window_cost(taps, target, plane, place, settings, enough):  # type: ignore[no-untyped-def]  # tuples
    """Compute a window's mean cost along a plane, from its middle row outwards; infinity once above `enough`."""
    y, x, height, width, weight = place
    pitch = FINE * (width - 1) + 1
    step = np.float32(2 * FINE) * (plane[1] - np.float32(1))
    limit = enough * weight
    sum_ = zeros()
    for order in range(N_ROWS):
        row = N_ROWS // 2 + ((order + 1) // 2 if order & 1 else -(order // 2))
        line = y + 2 * row - WINDOW_REACH
        if line < 0 or line >= height:
            continue
        u = np.float32(-WINDOW_REACH + (row & 1))
        disparity = plane[0] + plane[1] * u + plane[2] * np.float32(2 * row - WINDOW_REACH)
        begin = np.float32(FINE) * (np.float32(width - 1 - x) - u + disparity)
        seen = gather(target, line * pitch, begin, step, pitch - 1)
        grey = truncated_difference(load(taps, TAPS + row * N_LANES), lower_half(seen), settings.grey_limit)
        slope = truncated_difference(load(taps, 2 * TAPS + row * N_LANES), upper_half(seen), settings.gradient_limit)
        cost = add_scaled(grey, settings.gradient_share, add_scaled(slope, np.float32(-1), grey))
        sum_ = add(sum_, multiply(load(taps, row * N_LANES), cost))
        if order & 3 == 3 and total(sum_) > limit:
            return np.float32(np.inf)
    return total(sum_) / weight


@njit(cache=True, nogil=True, _nrt=False)
def _plane_at(planes, y, x):  # type: ignore[no-untyped-def]  # tuples
    return planes[y, x, 0], planes[y, x, 1], planes[y, x, 2]


@njit(cache=True, nogil=True, _nrt=False)
def _extended(plane, u, v):  # type: ignore[no-untyped-def]  # tuples
    """Return the same plane at a pixel u columns and v rows away."""
    return plane[0] + plane[1] * np.float32(u) + plane[2] * np.float32(v), plane[1], plane[2]


@njit(cache=True, nogil=True, _nrt=False)
def _seen_from_other(plane, u):  # type: ignore[no-untyped-def]  # tuples
    """Return a plane of the other view as a pixel of this view sees it.

    u : mirrored columns from the plane's pixel to the one that the pixel would match at disparity 0. With n for the
    distance of a mirrored column from there, d(n) = plane(u + n), and this view's pixel lies on it where n = d.
    """
    squeeze = np.float32(1) / (np.float32(1) - plane[1])
    return (plane[0] + plane[1] * np.float32(u)) * squeeze, -plane[1] * squeeze, plane[2] * squeeze


@njit(cache=True, nogil=True, _nrt=False)
def _changed(plane, step, state):  # type: ignore[no-untyped-def]  # tuples
    """Change a plane at random by at most `step`; return it and the next state of Marsaglia's xorshift."""
    disparity_state = _next_random(state)
    column_state = _next_random(disparity_state)
    row_state = _next_random(column_state)
    slope_step = step * np.float32(SLOPE_SHARE)
    return row_state, (
        plane[0] + step * _signed_unit(disparity_state),
        plane[1] + slope_step * _signed_unit(column_state),
        plane[2] + slope_step * _signed_unit(row_state),
    )


@njit(cache=True, nogil=True, _nrt=False)
def _next_random(state):  # type: ignore[no-untyped-def]  # tuples
    state ^= np.uint32(state << np.uint32(13))
    state ^= np.uint32(state >> np.uint32(17))
    return np.uint32(state ^ np.uint32(state << np.uint32(5)))


@njit(cache=True, nogil=True, _nrt=False)
def _signed_unit(state):  # type: ignore[no-untyped-def]  # tuples
    """Return a number from -1 to 1."""
    return np.float32(state >> np.uint32(8)) / np.float32(1 << 23) - np.float32(1)


@njit(cache=True, nogil=True, _nrt=False)
def _roughness(planes, plane, passages, place, settings):  # type: ignore[no-untyped-def]  # tuples
    """Sum the distances of a plane from those of the four neighbours, where the picture is smooth."""
    across, down, passage = passages
    y, x, height, width, _ = place
    limit, rough = settings.distance_limit, np.float32(0)
    if x > 0:
        rough += passage[across[y, x - 1]] * _gap(plane, _plane_at(planes, y, x - 1), -1, 0, limit)
    if x + 1 < width:
        rough += passage[across[y, x]] * _gap(plane, _plane_at(planes, y, x + 1), 1, 0, limit)
    if y > 0:
        rough += passage[down[y - 1, x]] * _gap(plane, _plane_at(planes, y - 1, x), 0, -1, limit)
    if y + 1 < height:
        rough += passage[down[y, x]] * _gap(plane, _plane_at(planes, y + 1, x), 0, 1, limit)
    return settings.smoothness * rough


@njit(cache=True, nogil=True, _nrt=False)
def _gap(plane, neighbour, u, v, limit):  # type: ignore[no-untyped-def]  # tuples
    """Measure the distance between two planes at both pixels, truncated."""
    there = abs(plane[0] + plane[1] * np.float32(u) + plane[2] * np.float32(v) - neighbour[0])
    here = abs(neighbour[0] - neighbour[1] * np.float32(u) - neighbour[2] * np.float32(v) - plane[0])
    return min(there + here, limit)

"""PatchMatch stereo: every pixel looks for the slanted plane that explains its surroundings best (method PM).

Planes start from the costs filtered for ID, or at random. In each sweep a pixel tries its neighbours' planes, that
of the pixel it matches in the other view, and ever smaller changes of its own; it keeps what lowers the energy: the
costs of its window along the plane, plus how far its plane is from its four neighbours' where the picture is smooth.
Pixels of one colour of a chessboard change at once and look only at the other colour: the result is the same for
any number of threads.

Source: Bleyer, Rhemann and Rother, PatchMatch stereo: stereo matching with slanted support windows, BMVC 2011;
the smoothness after Besse, Rother, Fitzgibbon and Kautz, PMBP: PatchMatch belief propagation, IJCV 110, 2014; the
chessboard after Galliani, Lasinger and Schindler, Massively parallel multiview stereopsis, ICCV 2015.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.bands import in_bands
from recon.depth.consistency import consistent, lands_inside
from recon.depth.cvf import DrParameters, has_texture, match_views, refined
from recon.depth.lanes import (
    N_LANES,
    add,
    add_scaled,
    byte_distance,
    gather,
    load,
    look_up,
    lower_half,
    multiply,
    store,
    total,
    truncated_difference,
    upper_half,
    zeros,
)
from recon.depth.pair import StereoPair
from recon.depth.refinement import filled, without_specks
from recon.depth.texture import FINE, GREY_SCALE, MAX_DISTANCE, PAD, REACH, texture_of
from recon.depth.views import Level, View, views_of

N_ROWS = REACH + 1
TAPS = N_ROWS * N_LANES
MAX_SLOPE = 0.9  # pixels of disparity a pixel; at 1 a surface is seen edge-on
SLOPE_SHARE = 0.3  # slopes are changed by this share of what the disparity is changed by
LAST_STEP = 0.1  # pixels (Bleyer et al.): smaller changes are not tried
SAME_PLANE = 0.1  # pixels by which planes must differ around a pixel to be tried apart
FAR_NEIGHBOUR = 5  # pixels: planes come from the next pixels and from these
SLOPE_WINDOW = 5  # pixels over which the seed's slopes are averaged


@dataclass(frozen=True)
class PmParameters:
    """Parameters of PM; the window's are those of Bleyer et al. 2011 where not said otherwise.

    Parameters
    ----------
    sweeps : times that every pixel of both views looks for a better plane
    is_seeded : start from DR's surface; otherwise at random, which needs more sweeps
    gamma : sum over the channels' grey levels by which a tap's weight falls to 1/e; 20 here, because channels are
        added and every other tap is left out
    gradient_share : of the gradient in a tap's cost, the rest is grey (their alpha)
    grey_limit, gradient_limit : grey levels at which the differences are cut
    smoothness : grey levels a pixel of distance between neighbouring planes
    distance_limit : pixels at which that distance is cut
    consistency_threshold : pixels by which the two views' disparities may differ
    seed : parameters of the surface to start from
    """

    sweeps: int = 6
    is_seeded: bool = True
    gamma: float = 20.0
    gradient_share: float = 0.9
    grey_limit: float = 10.0
    gradient_limit: float = 2.0
    smoothness: float = 0.05
    distance_limit: float = 6.0
    consistency_threshold: float = 0.5
    seed: DrParameters = field(default_factory=DrParameters)

    def __post_init__(self) -> None:
        if self.sweeps < 0:
            raise ValueError(f"sweeps is {self.sweeps}; expected 0 or more")
        if not 0 <= self.gradient_share <= 1:
            raise ValueError(f"the gradient's share is {self.gradient_share}; expected 0 to 1")
        for name in ("gamma", "grey_limit", "gradient_limit", "distance_limit"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected a positive number")
        for name in ("smoothness", "consistency_threshold"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected 0 or more")


def match_pm(pair: StereoPair, parameters: PmParameters = PmParameters()) -> NDArray[np.float32]:
    """Disparities of the left image by PatchMatch over slanted planes.

    Returns
    -------
    disparity : float32 (H, W), pixels, NaN where unmatched or masked out

    Warns
    -----
    NoTextureWarning
        If an image has no texture; the disparity is NaN everywhere.
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    if not has_texture(pair):
        return disparity
    views = views_of(pair, parameters.seed.sigma)
    planes = _seeded(views, parameters.seed) if parameters.is_seeded else _random(views)
    if planes is not None:
        found = [field_[..., 0] for field_ in _swept(views, planes, parameters)]
        valid = consistent(found[0], found[1], threshold=parameters.consistency_threshold)
        if views[0].mask is not None:
            valid &= views[0].mask
        if valid.any():
            surface = without_specks(filled(found[0], valid, in_bands), in_bands)
            disparity[pair.foreground()] = np.where(valid & lands_inside(surface), surface, np.nan)
    return disparity


def _seeded(
    views: tuple[View, View], parameters: DrParameters
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Planes (H, W, 3) of both views along DR's surface; None where nothing was matched."""
    left, right = match_views(views, parameters)
    if not (left.valid.any() and right.valid.any()):
        return None
    surfaces = (
        refined(views, left, right, parameters)[0],
        refined((views[1], views[0]), right, left, parameters)[0],
    )
    in_left, in_right = (_planes_along(surface + np.float32(views[0].level.min_disparity)) for surface in surfaces)
    return in_left, in_right


def _planes_along(surface: NDArray[np.float32]) -> NDArray[np.float32]:
    """Planes (H, W, 3) of a surface (H, W), their slopes averaged where it does not jump."""
    planes = np.empty((*surface.shape, 3), np.float32)
    planes[..., 0] = surface
    for part, axis in ((1, 1), (2, 0)):
        rise = np.diff(surface, axis=axis)
        rise[np.abs(rise) >= 1] = 0
        before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
        before[axis], after[axis] = (1, 0), (0, 1)
        slope = (np.pad(rise, before) + np.pad(rise, after)) / 2
        planes[..., part] = cv2.blur(slope, (SLOPE_WINDOW, SLOPE_WINDOW))
    return planes


def _random(views: tuple[View, View]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Random planes (H, W, 3) of both views, always the same."""
    level = views[0].level
    lowest = (level.min_disparity, -SLOPE_SHARE, -SLOPE_SHARE)
    highest = (level.min_disparity + level.n_disparities - 1, SLOPE_SHARE, SLOPE_SHARE)
    rng = np.random.default_rng(0)
    in_left, in_right = (rng.uniform(lowest, highest, (*view.shape, 3)).astype(np.float32) for view in views)
    return in_left, in_right


def _swept(
    views: tuple[View, View],
    planes: tuple[NDArray[np.float32], NDArray[np.float32]],
    parameters: PmParameters,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The planes after all sweeps."""
    textures = [texture_of(view) for view in views]
    affinity = np.exp(-np.arange(MAX_DISTANCE + 1) / parameters.gamma).astype(np.float32)
    settings = _settings(views[0].level, parameters)
    costs = [_unknown_costs(view) for view in views]
    for sweep_number in range(parameters.sweeps):
        for side in (0, 1):
            seen = (textures[side].colours, textures[side].words, textures[1 - side].fine, affinity)
            for turn in (0, 1):
                seed = 4 * sweep_number + 2 * side + turn
                work = partial(_sweep, seen, views[side].passages, settings, planes[1 - side], turn, seed)
                in_bands(views[side].shape[0], partial(work, planes[side], costs[side]))
    return planes


def _unknown_costs(view: View) -> NDArray[np.float32]:
    """-1 where a plane's cost is to be found, infinity on the background, which keeps its planes."""
    costs = np.full(view.shape, -1, np.float32)
    if view.mask is not None:
        costs[~view.mirrored(view.mask)] = np.inf
    return costs


class Settings(NamedTuple):
    """What a sweep is told, every number a float32; grey levels in 256ths."""

    lowest: np.float32
    highest: np.float32
    first_step: np.float32
    gradient_share: np.float32
    grey_limit: np.float32
    gradient_limit: np.float32
    smoothness: np.float32
    distance_limit: np.float32


def _settings(level: Level, parameters: PmParameters) -> Settings:
    numbers = (
        level.min_disparity,
        level.min_disparity + level.n_disparities - 1,
        1.0 if parameters.is_seeded else level.n_disparities / 2,
        parameters.gradient_share,
        GREY_SCALE * parameters.grey_limit,
        GREY_SCALE * parameters.gradient_limit,
        GREY_SCALE * parameters.smoothness,
        parameters.distance_limit,
    )
    return Settings(*(np.float32(number) for number in numbers))


@njit(cache=True, nogil=True)
def _sweep(seen, passages, settings, others, turn, seed, planes, costs, first, last):  # type: ignore[no-untyped-def]  # tuples
    """Let the pixels of one colour of the chessboard, in rows first to last, look for better planes.

    A plane is three float32: the disparity at its pixel, and its change a column and a row.

    Parameters
    ----------
    seen : colours and words of `Texture`; the other view's `fine`, which this view faces mirrored; float32, the
        weight of a tap by its distance in colour, summed over channels
    passages : Passages: how much neighbours should agree
    settings : Settings
    others : float32 (H, W, 3), the planes of the other view, which is mirrored
    turn : 0 or 1, the colour of the chessboard
    seed : makes the random changes of one sweep differ from another's
    planes : float32 (H, W, 3); updated
    costs : float32 (H, W), of each pixel's window along its plane, negative where not yet known; updated
    """
    height, width = costs.shape
    taps = np.empty(3 * TAPS, np.float32)
    target = seen[2].reshape(-1)
    for y in range(first, last):
        for x in range((y + turn) % 2, width, 2):
            if costs[y, x] == np.float32(np.inf):
                continue
            weight = _take_window(seen, y, x, taps)
            place = (y, x, height, width, weight)
            plane = _plane_at(planes, y, x)
            if costs[y, x] < 0:
                costs[y, x] = _window_cost(taps, target, plane, place, settings, np.float32(np.inf))
            best = (costs[y, x], costs[y, x] + _roughness(planes, plane, passages, place, settings))
            for distance in (1, FAR_NEIGHBOUR):
                for column, row in ((x - distance, y), (x + distance, y), (x, y - distance), (x, y + distance)):
                    if 0 <= row < height and 0 <= column < width:
                        trial = _extended(_plane_at(planes, row, column), x - column, y - row)
                        plane, best = _better(trial, plane, best, taps, target, planes, passages, place, settings)
            there = width - 1 - x + np.int64(np.rint(plane[0]))
            if 0 <= there < width:
                trial = _seen_from_other(_plane_at(others, y, there), width - 1 - x - there)
                plane, best = _better(trial, plane, best, taps, target, planes, passages, place, settings)
            state = np.uint32(seed * 0x9E3779B1 + y * 0x85EBCA6B + x * 0xC2B2AE35)
            step = settings.first_step
            while step > np.float32(LAST_STEP):
                state, trial = _changed(plane, step, state)
                plane, best = _better(trial, plane, best, taps, target, planes, passages, place, settings)
                step *= np.float32(0.5)
            costs[y, x] = best[0]
            planes[y, x, 0], planes[y, x, 1], planes[y, x, 2] = plane


@njit(cache=True, nogil=True)
def _better(trial, plane, best, taps, target, planes, passages, place, settings):  # type: ignore[no-untyped-def]  # tuples
    """Of two planes the one of lower energy, with its window's cost and its energy; `best` are those of `plane`."""
    trial = (
        min(max(trial[0], settings.lowest), settings.highest),
        min(max(trial[1], np.float32(-MAX_SLOPE)), np.float32(MAX_SLOPE)),
        min(max(trial[2], np.float32(-MAX_SLOPE)), np.float32(MAX_SLOPE)),
    )
    slopes = abs(trial[1] - plane[1]) + abs(trial[2] - plane[2])
    if abs(trial[0] - plane[0]) + np.float32(FAR_NEIGHBOUR) * slopes < np.float32(SAME_PLANE):
        return plane, best
    rough = _roughness(planes, trial, passages, place, settings)
    if rough >= best[1]:
        return plane, best
    cost = _window_cost(taps, target, trial, place, settings, best[1] - rough)
    if cost + rough >= best[1]:
        return plane, best
    return trial, (cost, cost + rough)


@njit(cache=True, nogil=True)
def _take_window(seen, y, x, taps):  # type: ignore[no-untyped-def]  # tuples
    """Copy the taps of a pixel's window: weights, grey and gradient; return the sum of the weights."""
    colours, words, _, affinity = seen
    height, half = colours.shape[0], colours.shape[2]
    flat_colours, flat_words = colours.reshape(-1), words.reshape(-1)
    centre = colours[y, (x + PAD) & 1, (x + PAD) >> 1]
    sum_ = zeros()
    for row in range(N_ROWS):
        line = y + 2 * row - REACH
        if line < 0 or line >= height:
            continue
        column = x + PAD - REACH + (row & 1)
        place = (line * 2 + (column & 1)) * half + (column >> 1)
        weight = look_up(affinity, byte_distance(centre, load(flat_colours, place)))
        word = load(flat_words, place)
        store(taps, row * N_LANES, weight)
        store(taps, TAPS + row * N_LANES, lower_half(word))
        store(taps, 2 * TAPS + row * N_LANES, upper_half(word))
        sum_ = add(sum_, weight)
    return total(sum_)


@njit(cache=True, nogil=True)
def _window_cost(taps, target, plane, place, settings, enough):  # type: ignore[no-untyped-def]  # tuples
    """The mean cost of a window along a plane, from its middle row outwards; infinity once it is above `enough`."""
    y, x, height, width, weight = place
    pitch = FINE * (width - 1) + 1
    step = np.float32(2 * FINE) * (plane[1] - np.float32(1))
    limit = enough * weight
    sum_ = zeros()
    for order in range(N_ROWS):
        row = N_ROWS // 2 + ((order + 1) // 2 if order & 1 else -(order // 2))
        line = y + 2 * row - REACH
        if line < 0 or line >= height:
            continue
        u = np.float32(-REACH + (row & 1))
        disparity = plane[0] + plane[1] * u + plane[2] * np.float32(2 * row - REACH)
        begin = np.float32(FINE) * (np.float32(width - 1 - x) - u + disparity)
        seen = gather(target, begin, step, pitch - 1, line * pitch)
        grey = truncated_difference(load(taps, TAPS + row * N_LANES), lower_half(seen), settings.grey_limit)
        slope = truncated_difference(load(taps, 2 * TAPS + row * N_LANES), upper_half(seen), settings.gradient_limit)
        cost = add_scaled(grey, settings.gradient_share, add_scaled(slope, np.float32(-1), grey))
        sum_ = add(sum_, multiply(load(taps, row * N_LANES), cost))
        if order & 3 == 3 and total(sum_) > limit:
            return np.float32(np.inf)
    return total(sum_) / weight


@njit(cache=True, nogil=True)
def _plane_at(planes, y, x):  # type: ignore[no-untyped-def]  # tuples
    return planes[y, x, 0], planes[y, x, 1], planes[y, x, 2]


@njit(cache=True, nogil=True)
def _extended(plane, u, v):  # type: ignore[no-untyped-def]  # tuples
    """The same plane at a pixel u columns and v rows away."""
    return plane[0] + plane[1] * np.float32(u) + plane[2] * np.float32(v), plane[1], plane[2]


@njit(cache=True, nogil=True)
def _seen_from_other(plane, u):  # type: ignore[no-untyped-def]  # tuples
    """A plane of the other view as a pixel of this view sees it.

    u : mirrored columns from the plane's pixel to the one that the pixel would match at disparity 0. With n for the
    distance of a mirrored column from there, d(n) = plane(u + n), and this view's pixel lies on it where n = d.
    """
    squeeze = np.float32(1) / (np.float32(1) - plane[1])
    return (plane[0] + plane[1] * np.float32(u)) * squeeze, -plane[1] * squeeze, plane[2] * squeeze


@njit(cache=True, nogil=True)
def _changed(plane, step, state):  # type: ignore[no-untyped-def]  # tuples
    """A plane changed at random by at most `step`, and the next state of Marsaglia's xorshift."""
    disparity_state = _next_random(state)
    column_state = _next_random(disparity_state)
    row_state = _next_random(column_state)
    slope_step = step * np.float32(SLOPE_SHARE)
    return row_state, (
        plane[0] + step * _signed_unit(disparity_state),
        plane[1] + slope_step * _signed_unit(column_state),
        plane[2] + slope_step * _signed_unit(row_state),
    )


@njit(cache=True, nogil=True)
def _next_random(state):  # type: ignore[no-untyped-def]  # tuples
    state ^= np.uint32(state << np.uint32(13))
    state ^= np.uint32(state >> np.uint32(17))
    return np.uint32(state ^ np.uint32(state << np.uint32(5)))


@njit(cache=True, nogil=True)
def _signed_unit(state):  # type: ignore[no-untyped-def]  # tuples
    """A number from -1 to 1."""
    return np.float32(state >> np.uint32(8)) / np.float32(1 << 23) - np.float32(1)


@njit(cache=True, nogil=True)
def _roughness(planes, plane, passages, place, settings):  # type: ignore[no-untyped-def]  # tuples
    """How far a plane is from those of the four neighbours, where the picture is smooth."""
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


@njit(cache=True, nogil=True)
def _gap(plane, neighbour, u, v, limit):  # type: ignore[no-untyped-def]  # tuples
    """Distance between two planes at both pixels, truncated."""
    there = abs(plane[0] + plane[1] * np.float32(u) + plane[2] * np.float32(v) - neighbour[0])
    here = abs(neighbour[0] - neighbour[1] * np.float32(u) - neighbour[2] * np.float32(v) - plane[0])
    return min(there + here, limit)

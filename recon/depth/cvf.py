"""Cost-volume filtering: the methods ID and DR.

Census costs are aggregated by the permeability filter, each view with its own guide; the cheapest disparity wins,
and it stays if both views agree.

Source: the study's Tables 1 and 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.depth.consistency import consistent, lands_inside
from recon.depth.gpu import Gpu, GpuView
from recon.depth.matching.census import WINDOW, WINDOWS
from recon.depth.matching.hierarchy import TILE_BITS, search_windows
from recon.depth.matching.lanes import N_LANES
from recon.depth.matching.permeability import WORST, Searched, Winners, aggregate_and_choose, rows_held
from recon.depth.matching.slanted import aggregate_along_surface
from recon.depth.matching.slopes import tile_slopes
from recon.depth.matching.views import View, views_of
from recon.depth.pair import MIN_SIDE, StereoPair, has_texture
from recon.depth.refinement import filled, local_planes, without_specks
from recon.runtime.workers import in_bands, in_both

WHOLE_IMAGE_BITS = 30  # a tile larger than any image
MOST_CORRECTED = 0.75  # pixels by which DR may move a match that both views found
COARSE_THRESHOLD = 1  # pixels by which the views may differ on levels that only say where to search
Tiles = tuple[list[NDArray[np.int32]], tuple[NDArray[np.float32], NDArray[np.float32]], int]
"""Where each window begins in every tile, how the surface rises there, and the tiles' size in bits."""


@dataclass(frozen=True)
class IdParameters:
    """Parameters of ID; the defaults are the paper's Table 2.

    Parameters
    ----------
    sigma : permeability, grey levels
    levels : how often the images are halved for hierarchical matching; 0 searches every disparity
    consistency_threshold : pixels by which the two views' disparities may differ
    window : width of the square that a census code describes, pixels: 3 or 5
    """

    sigma: float = 12.0
    levels: int = 2
    consistency_threshold: int = 0
    window: int = WINDOW

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise ValueError(f"sigma is {self.sigma}; expected a positive number of grey levels")
        if not 0 <= self.levels <= 6:
            raise ValueError(f"levels is {self.levels}; expected 0 (full search) to 6")
        if self.consistency_threshold < 0:
            raise ValueError(f"the consistency threshold is {self.consistency_threshold}; expected 0 or more pixels")
        if self.window not in WINDOWS:
            raise ValueError(f"window is {self.window}; expected {' or '.join(map(str, WINDOWS))} pixels")


@dataclass(frozen=True, eq=False)
class Matches:
    """The matches of one view; those of the right view are mirrored.

    Parameters
    ----------
    vertex : float32 (H, W), disparity minus the smallest, pixels, at the vertex of the costs' parabola
    index : int32 (H, W), the same as a whole number
    valid : bool (H, W), True where the other view agrees
    """

    vertex: NDArray[np.float32]
    index: NDArray[np.int32]
    valid: NDArray[np.bool_]


def match_id(
    pair: StereoPair, parameters: IdParameters = IdParameters(), *, gpu: Gpu | None = None
) -> NDArray[np.float32]:
    """Match the left image by cost-volume filtering (ID): whole disparities, float32 (H, W), pixels.

    They are NaN where unmatched or masked out; everywhere, with a NoTextureWarning, if an image has no texture.

    Parameters
    ----------
    pair : to match
    parameters : of ID
    gpu : that searches, see `recon.depth.gpu.open_gpu`, with the same disparities; None for the processor
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    if has_texture(pair):
        left, _ = match_views(views_on(gpu, pair, parameters), parameters)
        disparity[pair.foreground()] = np.where(left.valid, left.index + pair.min_disparity, np.nan)
    return disparity


@dataclass(frozen=True)
class DrParameters(IdParameters):
    """Parameters of DR: those of ID, and one of filling.

    Parameters
    ----------
    fill_threshold : pixels by which a filled disparity may differ from the other view's
    """

    fill_threshold: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fill_threshold < 0:
            raise ValueError(f"the fill threshold is {self.fill_threshold}; expected 0 or more pixels")


def match_dr(
    pair: StereoPair, parameters: DrParameters = DrParameters(), *, gpu: Gpu | None = None
) -> NDArray[np.float32]:
    """Match the left image by cost-volume filtering with refinement (DR): subpixel disparities, float32 (H, W).

    As ID, then the parabola's vertex, holes filled, and the costs aggregated once more along the surface found. A
    filled disparity is kept where the right view agrees; what only the left view sees stays unmatched. Units and NaN
    are those of `match_id`.

    Parameters
    ----------
    pair : to match
    parameters : of DR
    gpu : as in `match_id`
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    if has_texture(pair):
        views = views_on(gpu, pair, parameters)
        left, right = match_views(views, parameters)
        if left.valid.any():
            surface, valid = refined(views, left, right, parameters)
            disparity[pair.foreground()] = np.where(valid, surface + np.float32(pair.min_disparity), np.nan)
    return disparity


def views_on(gpu: Gpu | None, pair: StereoPair, parameters: IdParameters) -> tuple[View, View]:
    """Return the left and the right view of the part of a pair that is matched.

    Parameters
    ----------
    gpu : that searches them; None for the processor
    pair : to match
    parameters : of ID
    """
    views = views_of(pair, parameters.sigma, parameters.window)
    return views if gpu is None else gpu.take(views)


def refined(
    views: tuple[View, View], left: Matches, right: Matches, parameters: DrParameters
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Refine the left view's matches to a dense surface.

    Parameters
    ----------
    views : left and right
    left, right : their matches
    parameters : of DR

    Returns
    -------
    surface : float32 (H, W), disparity indices
    valid : bool (H, W), False where the right view contradicts
    """
    n_disparities = views[0].level.n_disparities
    surface = without_specks(filled(left.vertex, left.valid))
    surface = _aggregated(*views, local_planes(surface, left.valid, n_disparities))
    surface = local_planes(without_specks(surface), left.valid, n_disparities)
    valid = _kept(surface, left, right, views[0].level.min_disparity, parameters)
    return surface, valid if views[0].mask is None else valid & views[0].mask


def _aggregated(view: View, other: View, surface: NDArray[np.float32]) -> NDArray[np.float32]:
    """Move a view's surface, float32 (H, W), to where the costs around it are lowest."""
    if isinstance(view, GpuView) and isinstance(other, GpuView):
        return view.gpu.aggregate_along_surface(view, other, surface)
    facing, n_disparities = (other.framed_codes, other.origin), view.level.n_disparities
    return aggregate_along_surface(view.codes, *facing, view.passages, surface, n_disparities)


def _kept(
    surface: NDArray[np.float32], left: Matches, right: Matches, min_disparity: int, parameters: DrParameters
) -> NDArray[np.bool_]:
    """Tell where a surface points inside the other image and agrees with the matches of either view."""
    valid = np.empty(surface.shape, np.bool_)

    def check(first: int, last: int) -> None:
        rows = slice(first, last)
        agrees = consistent(
            surface[rows], right.vertex[rows], min_disparity=min_disparity, threshold=parameters.fill_threshold
        )
        agrees |= left.valid[rows] & (np.abs(surface[rows] - left.vertex[rows]) <= MOST_CORRECTED)
        valid[rows] = agrees & lands_inside(surface[rows] + np.float32(min_disparity))

    in_bands(len(valid), check)
    return valid


def match_views(views: tuple[View, View], parameters: IdParameters) -> tuple[Matches, Matches]:
    """Match both views, from the coarsest level of the hierarchy to the finest.

    The coarsest level of several is searched twice, the second time along the slopes that it found.
    """
    if not _is_halved(views[0], parameters):
        return _matched(views, parameters, lambda side: _full_search(views[side]))
    coarse = replace(parameters, levels=parameters.levels - 1, consistency_threshold=COARSE_THRESHOLD)
    halves = (views[0].halved(), views[1].halved())
    coarser = match_views(halves, coarse)
    if not _is_halved(halves[0], coarse):
        coarser = _matched(halves, coarse, lambda side: _full_search_along(halves[side], coarser[side]))
    return _matched(views, parameters, lambda side: _guided_search(views[side], halves[side], coarser[side]))


def _is_halved(view: View, parameters: IdParameters) -> bool:
    """Tell whether a coarser level says where to search."""
    return parameters.levels > 0 and view.level.n_disparities > N_LANES and min(view.shape) >= 2 * MIN_SIDE


def _matched(
    views: tuple[View, View], parameters: IdParameters, tiles_of: Callable[[int], Tiles]
) -> tuple[Matches, Matches]:
    """Match both views at one level, each where its tiles say; they are computed when asked for, left (0) and right."""
    in_both(lambda side: views[side].prepare())  # both searches read both
    vertices = in_both(lambda side: _search(views[side], views[1 - side], tiles_of(side)))
    index = [np.rint(vertex).astype(np.int32) for vertex in vertices]
    valid = [_confirmed(views[side], index[side], index[1 - side], parameters) for side in (0, 1)]
    return Matches(vertices[0], index[0], valid[0]), Matches(vertices[1], index[1], valid[1])


def _search(view: View, other: View, tiles: Tiles) -> NDArray[np.float32]:
    """Search every pixel's cheapest disparity index; return its parabola's vertex, float32 (H, W)."""
    # a tie, where nothing is known, is broken to opposite ends in the two views and fails the consistency check
    flip = N_LANES - 1 if view.is_right else 0
    starts, slopes, tile_bits = tiles
    starts = starts[:: -1 if view.is_right else 1]  # from far to near, in the right view from near to far
    if isinstance(view, GpuView) and isinstance(other, GpuView):
        return view.gpu.search(view, other, starts, slopes, tile_bits, flip)
    best, vertex = np.full(view.shape, WORST, np.int32), np.zeros(view.shape, np.float32)
    winners = Winners(best, vertex, view.level.n_disparities, flip)
    facing = view.codes, other.framed_codes, other.origin, view.passages
    for start in starts:
        aggregate_and_choose(Searched(*facing, start, slopes, tile_bits), winners, rows_held(*view.shape))
    return vertex


def _full_search(view: View) -> Tiles:
    """Search every disparity at no slope: one tile."""
    no_rise = np.zeros((1, 1), np.float32)
    return _every_window(view, (1, 1)), (no_rise, no_rise), WHOLE_IMAGE_BITS


def _full_search_along(view: View, matches: Matches) -> Tiles:
    """Search every disparity along the slopes of the view's own matches."""
    slopes = tile_slopes(matches.vertex, matches.valid)
    return _every_window(view, slopes[0].shape), slopes, TILE_BITS - 1  # a tile of the finer level, half as large here


def _every_window(view: View, shape: tuple[int, ...]) -> list[NDArray[np.int32]]:
    """Return windows over all disparities for tiles; they overlap by the two lanes that only serve as neighbours."""
    last = max(view.level.n_disparities - N_LANES, 0)
    return [np.full(shape, first, np.int32) for first in (*range(0, last, N_LANES - 2), last)]


def _guided_search(view: View, half: View, matches: Matches) -> Tiles:
    """Search around the coarser level's disparities, along its slopes."""
    n_disparities, shift = view.level.n_disparities, 2 * half.level.min_disparity - view.level.min_disparity
    starts = search_windows(matches.index, matches.valid, view.shape, n_disparities, shift=shift)
    return [*starts], tile_slopes(matches.vertex, matches.valid), TILE_BITS


def _confirmed(
    view: View, index: NDArray[np.int32], other: NDArray[np.int32], parameters: IdParameters
) -> NDArray[np.bool_]:
    threshold = parameters.consistency_threshold
    valid = consistent(index, other, min_disparity=view.level.min_disparity, threshold=threshold)
    return valid if view.mask is None else valid & view.mirrored(view.mask)

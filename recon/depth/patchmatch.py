"""PatchMatch stereo: every pixel looks for the slanted plane that explains its surroundings best (method PM).

Planes start from the costs filtered for ID, or at random; in a sequence, from those of the frame before where the
picture did not change. In each sweep a pixel tries its neighbours' planes, that of the pixel it matches in the other
view, and changes of its own, as far as these are news; it keeps what lowers the energy: the costs of its window along
the plane, plus how far its plane is from its four neighbours' where the picture is smooth. Pixels of one colour of a
chessboard change at once and look only at the other colour: the result is the same for any number of threads.

Source: Bleyer, Rhemann and Rother, PatchMatch stereo: stereo matching with slanted support windows, BMVC 2011;
the smoothness after Besse, Rother, Fitzgibbon and Kautz, PMBP: PatchMatch belief propagation, IJCV 110, 2014; the
chessboard after Galliani, Lasinger and Schindler, Massively parallel multiview stereopsis, ICCV 2015.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.depth.consistency import consistent, lands_inside
from recon.depth.cvf import DrParameters, match_views, refined, views_on
from recon.depth.gpu import Gpu, GpuView
from recon.depth.matching.guide import change_beyond_noise
from recon.depth.matching.plane_search import AT_REST, SLOPE_SHARE, TAPS, Settings, sweep
from recon.depth.matching.texture import GREY_SCALE, texture_of
from recon.depth.matching.views import Level, View
from recon.depth.pair import StereoPair, has_texture
from recon.depth.refinement import filled, without_specks
from recon.runtime.workers import in_bands, in_both

SLOPE_WINDOW = 5  # pixels over which the seed's slopes are averaged


@dataclass(frozen=True)
class PmParameters:
    """Parameters of PM; the window's are those of Bleyer et al. 2011 where not said otherwise.

    Parameters
    ----------
    sweeps : times that every pixel of both views may look for a better plane
    sweeps_again : the same in each further frame of a sequence
    still : grey levels beyond what noise explains that a picture may change, before its planes are looked for again
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

    sweeps: int = 8
    sweeps_again: int = 2
    still: float = 1.0
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
        if not 0 <= self.gradient_share <= 1:
            raise ValueError(f"the gradient's share is {self.gradient_share}; expected 0 to 1")
        for name in ("gamma", "grey_limit", "gradient_limit", "distance_limit"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected a positive number")
        for name in ("sweeps", "sweeps_again", "still", "smoothness", "consistency_threshold"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected 0 or more")


@dataclass(frozen=True, eq=False)
class Trace:
    """What a frame leaves to the next, of one view, as the picture lies.

    Parameters
    ----------
    guide : uint8 (H, W, 3) or (H, W), on which the planes were found
    is_known : bool (H, W), where there are planes
    planes : float32 (H, W, 3)
    moved : int16 (H, W), as in `plane_search.sweep`, turns counted from the next frame's first
    """

    guide: NDArray[np.uint8]
    is_known: NDArray[np.bool_]
    planes: NDArray[np.float32]
    moved: NDArray[np.int16]


@dataclass(eq=False)
class Past:
    """What PM knows of the frames before, of both views; `match_pm` brings it up to date."""

    traces: tuple[Trace, Trace] | None = None


def match_pm(
    pair: StereoPair,
    parameters: PmParameters = PmParameters(),
    *,
    gpu: Gpu | None = None,
    past: Past | None = None,
) -> NDArray[np.float32]:
    """Match the left image by PatchMatch over slanted planes (PM): float32 (H, W), units and NaN as in `match_id`.

    Parameters
    ----------
    pair : to match
    parameters : of PM
    gpu : as in `match_id`
    past : of the frames before this one, if it is one of a sequence; updated
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    past = past or Past()
    traces, past.traces = past.traces, None
    if not has_texture(pair):
        return disparity
    views = views_on(gpu, pair, parameters.seed)
    start = _started(views, parameters) if traces is None else _continued(views, parameters, pair, traces)
    if start is None:
        return disparity
    _sweep(views, start, parameters)
    past.traces = _traces(views, start, pair)
    left, right = (planes[..., 0] for planes in start.planes)
    valid = consistent(left, right, threshold=parameters.consistency_threshold)
    if views[0].mask is not None:
        valid &= views[0].mask
    if valid.any():
        surface = without_specks(filled(left, valid))
        disparity[pair.foreground()] = np.where(valid & lands_inside(surface), surface, np.nan)
    return disparity


@dataclass(frozen=True, eq=False)
class Search:
    """Where both views' searches stand: left, then right, which is mirrored.

    Parameters
    ----------
    planes, moved : of each, as in `plane_search.sweep`
    guides : of each, uint8 (H, W, 3) or (H, W), on which the planes are found
    sweeps : to come
    """

    planes: tuple[NDArray[np.float32], NDArray[np.float32]]
    moved: tuple[NDArray[np.int16], NDArray[np.int16]]
    guides: tuple[NDArray[np.uint8], NDArray[np.uint8]]
    sweeps: int


def _started(views: tuple[View, View], parameters: PmParameters) -> Search | None:
    """Start anew; None if nothing was matched."""
    planes = _seeded(views, parameters.seed) if parameters.is_seeded else _random(views)
    if planes is None:
        return None
    moved = in_both(lambda side: np.zeros(views[side].shape, np.int16))
    return Search(planes, moved, (views[0].guide, views[1].guide), parameters.sweeps)


def _continued(
    views: tuple[View, View], parameters: PmParameters, pair: StereoPair, traces: tuple[Trace, Trace]
) -> Search | None:
    """Start from the frame before where the picture did not change, and anew elsewhere."""
    old = in_both(lambda side: _placed(views[side], pair, traces[side]))
    still = in_both(lambda side: _still(views[side], old[side], parameters.still))
    if not (still[0].all() and still[1].all()):
        new = _started(views, parameters)
        if new is None:
            return None
        for side, changed in enumerate((~still[0], ~still[1])):
            old[side].guide[changed] = new.guides[side][changed]
            old[side].planes[changed] = new.planes[side][changed]
            old[side].moved[changed] = new.moved[side][changed]
    left, right = old
    planes, moved = (left.planes, right.planes), (left.moved, right.moved)
    return Search(planes, moved, (left.guide, right.guide), parameters.sweeps_again)


def _placed(view: View, pair: StereoPair, trace: Trace) -> Trace:
    """Copy the part of a trace that a view shows, as the view lies."""
    box = pair.foreground()
    parts = (trace.guide, trace.is_known, trace.planes, trace.moved)
    return Trace(*(view.mirrored(part[box]).copy() for part in parts))


def _still(view: View, old: Trace, most: float) -> NDArray[np.bool_]:
    """Tell where there were planes, and the picture around changed by no more than noise and `most` grey levels."""
    still = old.is_known & (change_beyond_noise(old.guide, view.guide, view.noise) <= most)
    return still if view.mask is None else still | ~view.mirrored(view.mask)


def _traces(views: tuple[View, View], search: Search, pair: StereoPair) -> tuple[Trace, Trace]:
    """Return what both views leave to the next frame."""
    box = pair.foreground()

    def trace(side: int) -> Trace:
        view = views[side]

        def whole(part: NDArray[Any]) -> NDArray[Any]:
            picture = np.zeros((*pair.left.shape[:2], *part.shape[2:]), part.dtype)
            picture[box] = view.mirrored(part)
            return picture

        is_known = np.ones(view.shape, np.bool_) if view.mask is None else view.mirrored(view.mask)
        rested = np.maximum(search.moved[side] - 2 * search.sweeps, AT_REST).astype(np.int16)
        return Trace(*map(whole, (search.guides[side], is_known, search.planes[side], rested)))

    return in_both(trace)


def _seeded(
    views: tuple[View, View], parameters: DrParameters
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Return planes, float32 (H, W, 3), of both views along DR's surface; None if nothing was matched."""
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
    """Return the planes, float32 (H, W, 3), of a surface (H, W), their slopes averaged where it does not jump."""
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
    """Return random planes, float32 (H, W, 3), of both views, always the same."""
    level = views[0].level
    lowest = (level.min_disparity, -SLOPE_SHARE, -SLOPE_SHARE)
    highest = (level.min_disparity + level.n_disparities - 1, SLOPE_SHARE, SLOPE_SHARE)
    rng = np.random.default_rng(0)
    in_left, in_right = (rng.uniform(lowest, highest, (*view.shape, 3)).astype(np.float32) for view in views)
    return in_left, in_right


def _sweep(views: tuple[View, View], search: Search, parameters: PmParameters) -> None:
    """Run all sweeps."""
    planes, moved = search.planes, search.moved
    if max(int(each.max()) for each in moved) <= AT_REST:
        return
    textures = in_both(lambda side: texture_of(views[side]))
    settings = _settings(views[0].level, parameters)
    costs = [_unknown_costs(view) for view in views]
    turns = [
        (side, turn, 2 * turn + side)
        for sweep_number in range(search.sweeps)
        for side in (0, 1)
        for turn in (2 * sweep_number, 2 * sweep_number + 1)
    ]
    left, right = views
    if isinstance(left, GpuView) and isinstance(right, GpuView):
        left.gpu.sweep((left, right), textures, settings, turns, planes, costs, moved)
        return
    for side, turn, seed in turns:
        seen = (textures[side].colours, textures[side].words, textures[1 - side].fine)
        facing = (planes[1 - side], moved[1 - side])
        work = partial(sweep, seen, views[side].passages, settings, *facing, turn, seed)
        in_bands(views[side].shape[0], partial(_sweep_rows, work, planes[side], costs[side], moved[side]))


def _sweep_rows(work: Callable[..., None], *state_and_rows: Any) -> None:
    """Sweep some rows, with room of their own to work in."""
    *state, first, last = state_and_rows
    work(*state, np.empty(3 * TAPS, np.float32), first, last)


def _unknown_costs(view: View) -> NDArray[np.float32]:
    """Return -1 where a plane's cost is not yet known, infinity on the background, which keeps its planes."""
    costs = np.full(view.shape, -1, np.float32)
    if view.mask is not None:
        costs[~view.mirrored(view.mask)] = np.inf
    return costs


def _settings(level: Level, parameters: PmParameters) -> Settings:
    numbers = (
        level.min_disparity,
        level.min_disparity + level.n_disparities - 1,
        1.0 if parameters.is_seeded else level.n_disparities / 2,
        2**23 / (parameters.gamma * np.log(2)),
        parameters.gradient_share,
        GREY_SCALE * parameters.grey_limit,
        GREY_SCALE * parameters.gradient_limit,
        GREY_SCALE * parameters.smoothness,
        parameters.distance_limit,
    )
    return Settings(*(np.float32(number) for number in numbers))

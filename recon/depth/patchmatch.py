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

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.depth.consistency import consistent, lands_inside
from recon.depth.cvf import DrParameters, match_views, refined, views_on
from recon.depth.gpu import Gpu, GpuView
from recon.depth.matching.plane_search import SLOPE_SHARE, Settings, sweep
from recon.depth.matching.texture import GREY_SCALE, MAX_DISTANCE, texture_of
from recon.depth.matching.views import Level, View
from recon.depth.pair import StereoPair, has_texture
from recon.depth.refinement import filled, without_specks
from recon.execution.workers import in_bands, in_both

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


def match_pm(
    pair: StereoPair, parameters: PmParameters = PmParameters(), *, gpu: Gpu | None = None
) -> NDArray[np.float32]:
    """Match the left image by PatchMatch over slanted planes (PM): float32 (H, W), units and NaN as in `match_id`.

    Parameters
    ----------
    pair : to match
    parameters : of PM
    gpu : as in `match_id`
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    if not has_texture(pair):
        return disparity
    views = views_on(gpu, pair, parameters.seed)
    planes = _seeded(views, parameters.seed) if parameters.is_seeded else _random(views)
    if planes is not None:
        left, right = (swept[..., 0] for swept in _swept(views, planes, parameters))
        valid = consistent(left, right, threshold=parameters.consistency_threshold)
        if views[0].mask is not None:
            valid &= views[0].mask
        if valid.any():
            surface = without_specks(filled(left, valid))
            disparity[pair.foreground()] = np.where(valid & lands_inside(surface), surface, np.nan)
    return disparity


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


def _swept(
    views: tuple[View, View],
    planes: tuple[NDArray[np.float32], NDArray[np.float32]],
    parameters: PmParameters,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Run all sweeps; return the planes of both views."""
    textures = in_both(lambda side: texture_of(views[side]))
    affinity = np.exp(-np.arange(MAX_DISTANCE + 1) / parameters.gamma).astype(np.float32)
    settings = _settings(views[0].level, parameters)
    costs = [_unknown_costs(view) for view in views]
    turns = [
        (side, turn, 2 * turn + side)
        for sweep_number in range(parameters.sweeps)
        for side in (0, 1)
        for turn in (2 * sweep_number, 2 * sweep_number + 1)
    ]
    left, right = views
    if isinstance(left, GpuView) and isinstance(right, GpuView):
        return left.gpu.sweep((left, right), textures, affinity, settings, turns, planes, costs)
    moved = [np.zeros(view.shape, np.int16) for view in views]
    for side, turn, seed in turns:
        seen = (textures[side].colours, textures[side].words, textures[1 - side].fine, affinity)
        work = partial(sweep, seen, views[side].passages, settings, planes[1 - side], turn, seed)
        in_bands(views[side].shape[0], partial(work, planes[side], costs[side], moved[side]))
    return planes


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
        parameters.gradient_share,
        GREY_SCALE * parameters.grey_limit,
        GREY_SCALE * parameters.gradient_limit,
        GREY_SCALE * parameters.smoothness,
        parameters.distance_limit,
    )
    return Settings(*(np.float32(number) for number in numbers))

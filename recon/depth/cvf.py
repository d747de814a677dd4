"""Cost-volume filtering: the methods ID and DR.

Census costs are aggregated by the permeability filter, each view with its own guide; the cheapest disparity wins,
and it stays if both views agree.

Source: the study's Tables 1 and 2.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.depth.bands import in_bands, in_both
from recon.depth.census import BEHIND, census_pair, fine_grey_image, grey_image
from recon.depth.consistency import consistent, lands_inside
from recon.depth.hierarchy import TILE_BITS, halved, halved_mask, search_windows
from recon.depth.lanes import N_LANES
from recon.depth.pair import MIN_SIDE, StereoPair
from recon.depth.permeability import (
    FRAME,
    SURFACE_STEP,
    WORST,
    Passages,
    aggregate_along_surface,
    aggregate_and_choose,
    guide_image,
    noise_level,
    permeabilities,
    rows_held,
)
from recon.depth.refinement import filled, local_planes, without_specks

MIN_GREY_RANGE = 2  # grey levels: with fewer there is nothing to match
WHOLE_IMAGE_BITS = 30  # a tile larger than any image
COARSE_THRESHOLD = 1  # pixels by which the views may differ on levels that only say where to search


@dataclass(frozen=True)
class IdParameters:
    """Parameters of ID; the defaults are the paper's Table 2.

    Parameters
    ----------
    sigma : permeability, grey levels
    levels : how often the images are halved for hierarchical matching; 0 searches every disparity
    consistency_threshold : pixels by which the two views' disparities may differ
    """

    sigma: float = 12.0
    levels: int = 2
    consistency_threshold: int = 0

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise ValueError(f"sigma is {self.sigma}; expected a positive number of grey levels")
        if not 0 <= self.levels <= 6:
            raise ValueError(f"levels is {self.levels}; expected 0 (full search) to 6")
        if self.consistency_threshold < 0:
            raise ValueError(f"the consistency threshold is {self.consistency_threshold}; expected 0 or more pixels")


@dataclass(frozen=True)
class Level:
    """What is searched at one level of the hierarchy."""

    n_disparities: int
    min_disparity: int

    def halved(self) -> Level:
        """The same disparities at half the size."""
        lowest = self.min_disparity // 2
        highest = -(-(self.min_disparity + self.n_disparities - 1) // 2)
        return Level(highest - lowest + 1, lowest)

    @property
    def before(self) -> int:
        """Places needed before a row of the other view."""
        return max(-self.min_disparity, 0) + FRAME

    @property
    def after(self) -> int:
        """Places needed after a row of the other view."""
        return max(self.min_disparity + max(self.n_disparities, N_LANES), 0) + FRAME


@dataclass(frozen=True, eq=False)
class View:
    """One image of a pair at one level, its background black.

    What is computed from the right view is mirrored: both then search their matches towards smaller columns.
    """

    image: NDArray[np.uint8]
    grey: NDArray[np.uint16]
    mask: NDArray[np.bool_] | None
    noise: float
    sigma: float
    level: Level
    is_right: bool

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W), pixels."""
        return self.image.shape[0], self.image.shape[1]

    def mirrored(self, image: NDArray[Any]) -> NDArray[Any]:
        """The image as it is in the left view, its columns from right to left in the right view."""
        return np.ascontiguousarray(image[:, ::-1] if self.is_right else image)

    def halved(self) -> View:
        """The view at the next coarser level."""
        mask = None if self.mask is None else halved_mask(self.mask)
        return View(
            halved(self.image), halved(self.grey), mask, self.noise / 2, self.sigma, self.level.halved(), self.is_right
        )

    @cached_property
    def framed_codes(self) -> NDArray[np.uint32]:
        """Census codes (2, H, before + W + after), mirrored in the right view, flagged on the background.

        Beyond the image the outermost code is repeated: no disparity is favoured there, and ties remain ties.
        """
        codes = census_pair(self.grey)
        if self.mask is not None:
            codes[:, ~self.mask] |= BEHIND
        mirrored = codes[:, :, ::-1] if self.is_right else codes
        return np.pad(mirrored, ((0, 0), (0, 0), (self.level.before, self.level.after)), mode="edge")

    @property
    def codes(self) -> NDArray[np.uint32]:
        """Census codes (2, H, W), mirrored in the right view."""
        return self.framed_codes[:, :, self.level.before : self.level.before + self.shape[1]]

    @property
    def origin(self) -> int:
        """Where in the framed codes the last pixel of a row of the other view finds disparity index 0."""
        return self.level.before + self.level.min_disparity

    @cached_property
    def passages(self) -> Passages:
        """How freely costs pass between neighbours, mirrored in the right view."""
        mask = None if self.mask is None else self.mirrored(self.mask)
        return permeabilities(guide_image(self.mirrored(self.image), self.noise), sigma=self.sigma, mask=mask)


@dataclass(frozen=True, eq=False)
class Matches:
    """What one view found, mirrored in the right view.

    found : float32 (H, W), disparity minus the smallest, at the vertex of the costs' parabola; index : int32 (H, W),
    the same, whole; valid : bool (H, W), where the other view agrees.
    """

    found: NDArray[np.float32]
    index: NDArray[np.int32]
    valid: NDArray[np.bool_]


def match_id(pair: StereoPair, parameters: IdParameters = IdParameters()) -> NDArray[np.float32]:
    """Whole-numbered disparities of the left image by cost-volume filtering.

    Returns
    -------
    disparity : float32 (H, W), pixels, NaN where unmatched or masked out

    Warns
    -----
    UserWarning
        If an image has no texture; the disparity is NaN everywhere.
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    if has_texture(pair):
        left, _ = match_views(views_of(pair, parameters.sigma), parameters)
        disparity[pair.foreground()] = np.where(left.valid, left.index + pair.min_disparity, np.nan)
    return disparity


@dataclass(frozen=True)
class DrParameters(IdParameters):
    """Parameters of DR: those of ID, and of the refinement.

    Parameters
    ----------
    fill_threshold : pixels by which a filled disparity may differ from the other view's to be kept
    """

    fill_threshold: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fill_threshold < 0:
            raise ValueError(f"the fill threshold is {self.fill_threshold}; expected 0 or more pixels")


def match_dr(pair: StereoPair, parameters: DrParameters = DrParameters()) -> NDArray[np.float32]:
    """Refined disparities of the left image by cost-volume filtering.

    As ID, then the parabola's vertex, holes filled, and the costs aggregated once more along the surface found. A
    filled disparity is kept where the right view agrees; what only the left view sees stays unmatched.

    Returns
    -------
    disparity : float32 (H, W), pixels, NaN where unmatched or masked out

    Warns
    -----
    UserWarning
        If an image has no texture; the disparity is NaN everywhere.
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    if has_texture(pair):
        views = views_of(pair, parameters.sigma)
        left, right = match_views(views, parameters)
        if left.valid.any():
            surface, valid = refined(views, left, right, parameters)
            disparity[pair.foreground()] = np.where(valid, surface + np.float32(pair.min_disparity), np.nan)
    return disparity


def refined(
    views: tuple[View, View], left: Matches, right: Matches, parameters: DrParameters
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The left view's refined surface, float32 (H, W) disparity indices, dense, and where it counts."""
    level = views[0].level
    surface = filled(left.found, left.valid)
    surface = local_planes(without_specks(surface, 5), left.valid, in_bands)
    surface = np.clip(surface, 0, level.n_disparities - 1)
    surface = aggregate_along_surface(
        views[0].codes,
        views[1].framed_codes,
        views[1].origin,
        views[0].passages,
        surface,
        level.n_disparities,
        in_bands,
    )
    surface = without_specks(surface, 3)
    agrees = consistent(surface, right.index, min_disparity=level.min_disparity, threshold=parameters.fill_threshold)
    inside = lands_inside(surface + np.float32(level.min_disparity))
    valid = inside & (agrees | (left.valid & (np.abs(surface - left.index) <= SURFACE_STEP)))
    return surface, valid if views[0].mask is None else valid & views[0].mask


def has_texture(pair: StereoPair) -> bool:
    """Whether both images have anything to match; warns if not."""
    for image, mask in ((pair.left, pair.left_mask), (pair.right, pair.right_mask)):
        grey = grey_image(image)
        if np.ptp(grey if mask is None else grey[mask]) < MIN_GREY_RANGE:
            warnings.warn("the images have no texture: nothing can be matched, every disparity is NaN", stacklevel=3)
            return False
    return True


def views_of(pair: StereoPair, sigma: float) -> tuple[View, View]:
    """The left and the right view of the part of a pair that is matched."""
    box, level = pair.foreground(), Level(pair.n_disparities, pair.min_disparity)
    return (
        _view(pair.left[box], None if pair.left_mask is None else pair.left_mask[box], sigma, level, is_right=False),
        _view(pair.right[box], None if pair.right_mask is None else pair.right_mask[box], sigma, level, is_right=True),
    )


def _view(
    image: NDArray[np.uint8], mask: NDArray[np.bool_] | None, sigma: float, level: Level, *, is_right: bool
) -> View:
    if mask is not None:
        image = np.where(mask if image.ndim == 2 else mask[..., None], image, np.uint8(0))
    noise = noise_level(grey_image(image), mask)
    return View(image, fine_grey_image(image), mask, noise, sigma, level, is_right)


def match_views(views: tuple[View, View], parameters: IdParameters) -> tuple[Matches, Matches]:
    """Both views' matches, from the coarsest level to the finest."""
    level = views[0].level
    coarser: tuple[Matches, Matches] | tuple[None, None] = (None, None)
    if parameters.levels > 0 and level.n_disparities > N_LANES and min(views[0].shape) >= 2 * MIN_SIDE:
        coarse = replace(parameters, levels=parameters.levels - 1, consistency_threshold=COARSE_THRESHOLD)
        coarser = match_views((views[0].halved(), views[1].halved()), coarse)
    in_both(lambda side: views[side].framed_codes)
    found = in_both(lambda side: _search(views[side], views[1 - side], coarser[side]))
    index = [np.rint(vertices).astype(np.int32) for vertices in found]
    valid = [_confirmed(views[side], index[side], index[1 - side], parameters) for side in (0, 1)]
    return Matches(found[0], index[0], valid[0]), Matches(found[1], index[1], valid[1])


def _search(view: View, other: View, coarser: Matches | None) -> NDArray[np.float32]:
    """The vertex of the parabola at the cheapest disparity index of every pixel, float32 (H, W)."""
    # a tie, where nothing is known, is broken to opposite ends in the two views and fails the consistency check
    flip = N_LANES - 1 if view.is_right else 0
    best, found = np.full(view.shape, WORST, np.int32), np.zeros(view.shape, np.float32)
    facing, n_disparities = (other.framed_codes, other.origin), view.level.n_disparities
    n_held = rows_held(*view.shape)
    for windows in _windows(view, coarser):
        aggregate_and_choose(view.codes, *facing, view.passages, *windows, n_disparities, flip, n_held, best, found)
    return found


def _windows(view: View, coarser: Matches | None) -> Iterator[tuple[NDArray[np.int32], int]]:
    """Where the windows of sixteen disparities of each tile begin, and the tiles' size in bits.

    From far to near, in the right view from near to far. A full search has one tile; its windows overlap by the two
    lanes that only serve as neighbours.
    """
    towards, level = -1 if view.is_right else 1, view.level
    if coarser is None:
        last = max(level.n_disparities - N_LANES, 0)
        for first in [*range(0, last, N_LANES - 2), last][::towards]:
            yield np.full((1, 1), first, np.int32), WHOLE_IMAGE_BITS
    else:
        shift = 2 * level.halved().min_disparity - level.min_disparity
        windows = search_windows(coarser.index, coarser.valid, view.shape, level.n_disparities, shift=shift)
        for start in windows[::towards]:
            yield start, TILE_BITS


def _confirmed(
    view: View, index: NDArray[np.int32], other: NDArray[np.int32], parameters: IdParameters
) -> NDArray[np.bool_]:
    threshold = parameters.consistency_threshold
    valid = consistent(index, other, min_disparity=view.level.min_disparity, threshold=threshold)
    return valid if view.mask is None else valid & view.mirrored(view.mask)

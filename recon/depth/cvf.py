"""Cost-volume filtering: the methods ID and DR.

Census costs are aggregated by the permeability filter, each view with its own guide; the cheapest disparity wins,
and it stays if both views agree.

Source: the study's Tables 1 and 2.
"""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.depth.census import BEHIND, census, grey_image
from recon.depth.consistency import consistent
from recon.depth.pair import StereoPair
from recon.depth.permeability import BLOCK, aggregate_and_choose, permeabilities

MIN_GREY_RANGE = 2  # grey levels: with fewer there is nothing to match


@dataclass(frozen=True)
class IdParameters:
    """Parameters of ID; the defaults are the paper's Table 2.

    Parameters
    ----------
    sigma : permeability, grey levels
    consistency_threshold : pixels by which the two views' disparities may differ
    """

    sigma: float = 12.0
    consistency_threshold: int = 0

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise ValueError(f"sigma is {self.sigma}; expected a positive number of grey levels")
        if self.consistency_threshold < 0:
            raise ValueError(f"the consistency threshold is {self.consistency_threshold}; expected 0 or more pixels")


@dataclass(frozen=True, eq=False)
class _View:
    """One view as reference, the other as target; the right view is mirrored, so that both search alike."""

    codes: NDArray[np.uint32]
    target_codes: NDArray[np.uint32]
    grey: NDArray[np.uint8]
    mask: NDArray[np.bool_] | None
    tie: int  # opposite in the two views: a tie, where nothing is known, then fails the consistency check


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
    left, right = (_foreground_grey(*side) for side in _sides(pair))
    if min(np.ptp(grey) for grey in (left, right)) < MIN_GREY_RANGE:
        warnings.warn("the images have no texture: nothing can be matched, every disparity is NaN", stacklevel=2)
        return np.full(left.shape, np.nan, np.float32)
    with ThreadPoolExecutor(max_workers=2) as pool:
        in_left, in_right = pool.map(lambda view: _winners(view, pair, parameters), _views(pair, left, right))
    valid = consistent(in_left, in_right[:, ::-1], threshold=parameters.consistency_threshold)
    if pair.left_mask is not None:
        valid &= pair.left_mask
    return np.where(valid, in_left, np.nan).astype(np.float32)


def _sides(pair: StereoPair) -> tuple[tuple[NDArray[np.uint8], NDArray[np.bool_] | None], ...]:
    return (pair.left, pair.left_mask), (pair.right, pair.right_mask)


def _foreground_grey(image: NDArray[np.uint8], mask: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """The grey image with a black background: what lies behind the mask must not matter."""
    grey = grey_image(image)
    return grey if mask is None else np.where(mask, grey, np.uint8(0))


def _views(pair: StereoPair, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> tuple[_View, _View]:
    in_left, in_right = _masked_census(left, pair.left_mask), _masked_census(right, pair.right_mask)
    right_mask = None if pair.right_mask is None else pair.right_mask[:, ::-1]
    return (
        _View(in_left, in_right, left, pair.left_mask, tie=0),
        _View(_mirror(in_right), _mirror(in_left), _mirror(right), right_mask, tie=1),
    )


def _mirror(image: NDArray[np.generic]) -> NDArray:  # type: ignore[type-arg]  # of any one type
    return np.ascontiguousarray(image[:, ::-1])


def _masked_census(grey: NDArray[np.uint8], mask: NDArray[np.bool_] | None) -> NDArray[np.uint32]:
    codes = census(grey)
    return codes if mask is None else np.where(mask, codes, codes | BEHIND)


def _winners(view: _View, pair: StereoPair, parameters: IdParameters) -> NDArray[np.int32]:
    """The cheapest disparity (H, W) of every pixel of a view, pixels."""
    across, down = permeabilities(view.grey, sigma=parameters.sigma, mask=view.mask)
    best, winner = np.empty(view.codes.shape, np.int32), np.zeros(view.codes.shape, np.int32)
    candidates = _candidates(view.target_codes, pair.n_disparities, pair.min_disparity)
    aggregate_and_choose(view.codes, candidates, across, down, pair.n_disparities, view.tie, best, winner)
    return winner + np.int32(pair.min_disparity)


def _candidates(codes: NDArray[np.uint32], n_disparities: int, min_disparity: int) -> NDArray[np.uint32]:
    """The target's census codes from right to left, (H, W - 1 + D), D whole blocks: see `aggregate_and_choose`.

    Beyond the image the outermost code is repeated: no disparity is favoured there, so that ties remain ties.
    """
    width = codes.shape[1]
    n_padded = -(-n_disparities // BLOCK) * BLOCK
    columns = width - 1 - min_disparity - np.arange(width - 1 + n_padded)
    return np.ascontiguousarray(codes[:, np.clip(columns, 0, width - 1)])

"""Semi-global matching: OpenCV's StereoSGBM as a baseline beside the paper's methods (method SGM).

Source: Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 30, 2008; OpenCV takes
the difference of pixels after Birchfield and Tomasi, PAMI 20, 1998, instead of mutual information.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.depth.channels import colour_image, on_black
from recon.depth.consistency import lands_inside
from recon.depth.pair import StereoPair, has_texture, within_pair

STEPS = 16  # OpenCV searches a multiple of 16 disparities, and gives sixteenths of a pixel
LARGEST_STEP = 20_000  # OpenCV adds costs in 16 bits: from 31 000 on they overflow, and wrong disparities win


@dataclass(frozen=True)
class SgmParameters:
    """Parameters of SGM; the defaults are those of OpenCV's documentation and samples for colour pictures.

    Parameters
    ----------
    block : width of the squares that are compared, pixels, odd
    small_step, large_step : costs (P1, P2) of a disparity that differs by 1 pixel, or by more, from a neighbour's;
        8 and 32 times the number of channels times the square's area
    consistency_threshold : pixels by which the two views' disparities may differ (disp12MaxDiff); OpenCV takes 0 as 1
    """

    block: int = 5
    small_step: int = 600
    large_step: int = 2400
    consistency_threshold: int = 1

    def __post_init__(self) -> None:
        if not (1 <= self.block <= 11 and self.block % 2):
            raise ValueError(f"block is {self.block}; expected an odd number of pixels up to 11")
        if not 0 < self.small_step < self.large_step <= LARGEST_STEP:
            raise ValueError(
                f"small_step is {self.small_step} and large_step {self.large_step}; expected positive costs, "
                f"the second one larger, up to {LARGEST_STEP}"
            )
        if self.consistency_threshold < 1:
            raise ValueError(f"the consistency threshold is {self.consistency_threshold}; expected 1 or more pixels")


def match_sgm(pair: StereoPair, parameters: SgmParameters = SgmParameters()) -> NDArray[np.float32]:
    """Match the left image by OpenCV's StereoSGBM, mode HH: sixteenths of a pixel, float32 (H, W).

    The background behind masks is blackened; a match to the right background or beyond the right image is dropped.
    Units and NaN are those of `match_id`.
    """
    disparity = np.full(pair.left.shape[:2], np.nan, np.float32)
    if has_texture(pair):
        box = pair.foreground()
        left, right = (
            on_black(colour_image(image[box]), None if mask is None else mask[box])
            for image, mask in ((pair.left, pair.left_mask), (pair.right, pair.right_mask))
        )
        values = _searched(left, right, pair, parameters)
        is_match = lands_inside(values)
        if pair.right_mask is not None:
            is_match &= _seen_by(values, pair.right_mask[box])
        disparity[box] = np.where(is_match, values, np.nan)
    return within_pair(pair, disparity)


def _searched(
    left: NDArray[np.uint8], right: NDArray[np.uint8], pair: StereoPair, parameters: SgmParameters
) -> NDArray[np.float32]:
    """Return the disparities of a part of a pair, NaN where the views disagree.

    OpenCV leaves out columns that do not see the whole range, so both images get columns left and right.
    """
    n_disparities = -(-pair.n_disparities // STEPS) * STEPS
    before, after = max(pair.min_disparity + n_disparities, 0), max(-pair.min_disparity, 0)
    matcher = cv2.StereoSGBM.create(
        pair.min_disparity,
        n_disparities,
        parameters.block,
        parameters.small_step,
        parameters.large_step,
        parameters.consistency_threshold,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )
    framed = [cv2.copyMakeBorder(image, 0, 0, before, after, cv2.BORDER_REPLICATE) for image in (left, right)]
    values = np.asarray(matcher.compute(*framed)[:, before : before + left.shape[1]], np.float32) / np.float32(STEPS)
    return np.where(values >= pair.min_disparity, values, np.float32(np.nan))


def _seen_by(disparity: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell where a disparity points at the foreground of the right image; both (H, W)."""
    columns = np.arange(mask.shape[1]) - np.nan_to_num(disparity)
    nearest = np.clip(np.rint(columns).astype(np.intp), 0, mask.shape[1] - 1)
    return np.take_along_axis(mask, nearest, axis=1)

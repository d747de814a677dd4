"""From a rectified stereo pair to the disparities of its left image."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.depth.cvf import DrParameters, IdParameters, match_dr, match_id
from recon.depth.pair import NoTextureWarning, StereoPair, rectified_pair
from recon.depth.patchmatch import PmParameters, match_pm
from recon.depth.semi_global import SgmParameters, match_sgm
from recon.depth.temporal import match_sequence

__all__ = [
    "DEFAULTS",
    "MATCHERS",
    "Matcher",
    "StereoPair",
    "match_dr",
    "match_id",
    "match_pm",
    "match_sequence",
    "match_sgm",
    "matched",
    "rectified_pair",
]

Parameters = IdParameters | PmParameters | SgmParameters
# of a pair, and of the matcher's parameters: float32 (H, W), pixels, NaN where unmatched or masked out
Matcher = Callable[..., NDArray[np.float32]]

MATCHERS: dict[str, Matcher] = {"id": match_id, "dr": match_dr, "pm": match_pm, "sgm": match_sgm}
# what each is run with, if nothing else is asked for
DEFAULTS: dict[str, Parameters] = {
    "id": IdParameters(),
    "dr": DrParameters(),
    "pm": PmParameters(),
    "sgm": SgmParameters(),
}


def matched(method: str, pair: StereoPair, parameters: Parameters) -> tuple[NDArray[np.float32], list[str]]:
    """Match a pair by a method of ours.

    Parameters
    ----------
    method : a name in `MATCHERS`
    pair : to match
    parameters : of the method

    Returns
    -------
    disparity : float32 (H, W), pixels, NaN where unmatched or masked out
    warnings : a sentence each
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", NoTextureWarning)
        disparity = MATCHERS[method](pair, parameters)
    return disparity, [str(warning.message) for warning in caught]

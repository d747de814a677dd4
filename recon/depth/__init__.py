"""From a rectified stereo pair to the disparities of its left image."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from inspect import signature
from itertools import tee
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.depth.cvf import DrParameters, IdParameters, match_dr, match_id
from recon.depth.gpu import open_gpu
from recon.depth.pair import NoTextureWarning, StereoPair, rectified_pair
from recon.depth.patchmatch import Past, PmParameters, match_pm
from recon.depth.semi_global import SgmParameters, match_sgm
from recon.depth.temporal import TemporalParameters, filtered

__all__ = [
    "DEFAULTS",
    "DEVICES",
    "MATCHERS",
    "PAST",
    "Matcher",
    "Past",
    "StereoPair",
    "match_dr",
    "match_frames",
    "match_id",
    "match_pm",
    "match_sequence",
    "match_sgm",
    "matched",
    "open_gpu",
    "rectified_pair",
]

Parameters = IdParameters | PmParameters | SgmParameters
# of a pair, and of the matcher's parameters: float32 (H, W), pixels, NaN where unmatched or masked out
Matcher = Callable[..., NDArray[np.float32]]

MATCHERS: dict[str, Matcher] = {"id": match_id, "dr": match_dr, "pm": match_pm, "sgm": match_sgm}
ON_GPU = ("id", "dr", "pm")  # those that can be matched on a GPU
PAST = "past"  # keyword argument of matchers that use what they know of the frames before
CPU, GPU = "cpu", "gpu"
DEVICES = (CPU, GPU)  # where methods match
# what each is run with, if nothing else is asked for
DEFAULTS: dict[str, Parameters] = {
    "id": IdParameters(),
    "dr": DrParameters(),
    "pm": PmParameters(),
    "sgm": SgmParameters(),
}


def check_device(device: str) -> None:
    """Raise a ValueError if methods cannot match on a device, one of `DEVICES`, of this machine."""
    if device not in DEVICES:
        raise ValueError(f"device is {device!r}, expected one of {', '.join(DEVICES)}")
    if device == GPU:
        open_gpu()


def matched(
    method: str, pair: StereoPair, parameters: Parameters, device: str = CPU, past: Past | None = None
) -> tuple[NDArray[np.float32], list[str]]:
    """Match a pair by a method of ours.

    Parameters
    ----------
    method : a name in `MATCHERS`
    pair : to match
    parameters : of the method
    device : one of `DEVICES`; on a GPU, methods that are not `ON_GPU` match on the processor
    past : what the method knows of the frames before, if it is one that takes it

    Returns
    -------
    disparity : float32 (H, W), pixels, NaN where unmatched or masked out
    warnings : a sentence each

    Raises
    ------
    GpuError
        If there is no GPU, or its memory is full.
    """
    further: dict[str, Any] = {"gpu": open_gpu()} if device == GPU and method in ON_GPU else {}
    if past is not None:
        further[PAST] = past
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", NoTextureWarning)
        disparity = MATCHERS[method](pair, parameters, **further)
    return disparity, [str(warning.message) for warning in caught]


def match_frames(pairs: Iterable[StereoPair], matcher: Matcher) -> Iterator[NDArray[np.float32]]:
    """Match one sensor's frames; what did not change is not matched again.

    Pictures that are those of the frame before have its disparities. A matcher with a keyword argument `past`, as
    `match_pm`, is told what it knows of the frames before.

    Parameters
    ----------
    pairs : the frames in their order
    matcher : see `MATCHERS`; its result depends on nothing but the pair and the past

    Yields
    ------
    disparity : float32 (H, W), pixels, NaN where unmatched
    """
    if PAST in signature(matcher).parameters:
        matcher = partial(matcher, past=Past())
    before: tuple[StereoPair, NDArray[np.float32]] | None = None
    for pair in pairs:
        disparity = before[1] if before is not None and before[0].is_same(pair) else matcher(pair)
        before = (pair, disparity)
        yield disparity.copy()


def match_sequence(
    pairs: Iterable[StereoPair], matcher: Matcher, parameters: TemporalParameters = TemporalParameters()
) -> Iterator[NDArray[np.float32]]:
    """Match one sensor's frames and filter their disparities in time: `match_frames`, then `temporal.filtered`.

    Parameters
    ----------
    pairs, matcher : as in `match_frames`; a matcher whose disparities are whole keeps them whole
    parameters : of the filter

    Yields
    ------
    disparity : float32 (H, W), pixels, NaN where neither the matcher nor the memory knows
    """
    to_match, to_filter = tee(pairs)
    return filtered(to_filter, match_frames(to_match, matcher), parameters)

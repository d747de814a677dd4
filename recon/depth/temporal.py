"""Temporal filtering: a still scene stops flickering, and what moves leaves no ghost.

Each pixel remembers a disparity and how many frames speak for it. The memory passes from frame to frame as far as
the picture is permeable in time. A disparity close to the remembered one is averaged with it; another one takes its
place when it has been seen for longer than the memory is strong, or at once where the picture has changed.

Source: Cigla and Alatan, Information permeability for stereo matching, Signal Processing: Image Communication 28,
2013, the temporal permeability; the study's Table 2 for its parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.channels import grey_image
from recon.depth.matching.guide import change_beyond_noise, guide_image, noise_level
from recon.depth.pair import StereoPair

STILL = 0.75  # permeability above which a picture counts as still, so that a memory is worth more than what is seen
ONE_FRAME = np.float32(1)  # what a frame adds to a memory's strength


@dataclass(frozen=True)
class TemporalParameters:
    """Parameters of the temporal filter; the first two are the paper's Table 2.

    Parameters
    ----------
    sigma : permeability, grey levels
    sigma_disparity : temporal consistency, pixels of disparity
    memory : frames that may speak for a remembered disparity at most
    """

    sigma: float = 12.0
    sigma_disparity: float = 1.0
    memory: float = 8.0

    def __post_init__(self) -> None:
        for name in ("sigma", "sigma_disparity"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected a positive number")
        if not self.memory >= 1:
            raise ValueError(f"memory is {self.memory}; expected at least 1 frame")


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame as the filter sees it.

    Parameters
    ----------
    guide : uint8 (H, W, 3) or (H, W), the image without its noise
    noise : of the image, standard deviation, grey levels
    mask : bool (H, W), True on the foreground; None: everything is foreground
    """

    guide: NDArray[np.uint8]
    noise: float
    mask: NDArray[np.bool_] | None


@dataclass(frozen=True, eq=False)
class Memory:
    """What the filter remembers after some frames.

    Parameters
    ----------
    frame : the last
    disparity : float32 (H, W), pixels, NaN where nothing is remembered
    strength : float32 (H, W), how many frames speak for it
    """

    frame: Frame
    disparity: NDArray[np.float32]
    strength: NDArray[np.float32]


def filtered(
    pairs: Iterable[StereoPair],
    disparities: Iterable[NDArray[np.float32]],
    parameters: TemporalParameters = TemporalParameters(),
) -> Iterator[NDArray[np.float32]]:
    """Filter the disparities of one sensor's frames in time.

    Disparities that are whole stay whole.

    Parameters
    ----------
    pairs : the frames in their order
    disparities : of each, float32 (H, W), pixels, NaN where unmatched
    parameters : of the filter

    Yields
    ------
    disparity : float32 (H, W), pixels, NaN where neither the matcher nor the memory knows

    Raises
    ------
    ValueError
        If a frame has another size than the first.
    """
    memory: Memory | None = None
    is_whole = True
    for pair, disparity in zip(pairs, disparities, strict=True):
        is_whole = is_whole and np.array_equal(disparity, np.rint(disparity), equal_nan=True)
        noise = noise_level(grey_image(pair.left))
        frame = Frame(guide_image(pair.left, noise), noise, pair.left_mask)
        memory = remembered(memory, frame, disparity, parameters)
        yield np.rint(memory.disparity) if is_whole else memory.disparity.copy()


def remembered(
    before: Memory | None, frame: Frame, disparity: NDArray[np.float32], parameters: TemporalParameters
) -> Memory:
    """Update the memory with one more frame.

    Parameters
    ----------
    before : the memory so far; None before the first frame
    frame : the next frame
    disparity : float32 (H, W), its disparity, pixels, NaN where unmatched
    parameters : of the filter

    Raises
    ------
    ValueError
        If the frame has another size than the memory.
    """
    if before is None:
        return Memory(frame, disparity.copy(), np.isfinite(disparity).astype(np.float32))
    if before.frame.guide.shape != frame.guide.shape:
        sizes = f"the frame has shape {frame.guide.shape}, the one before {before.frame.guide.shape}"
        raise ValueError(f"{sizes}; a sensor's frames have one shape")
    after = Memory(frame, np.empty_like(disparity), np.empty_like(disparity))
    _remember_kernel(
        before.disparity,
        before.strength,
        temporal_permeability(before.frame, frame, parameters.sigma),
        disparity,
        np.float32(parameters.sigma_disparity),
        np.float32(parameters.memory),
        after.disparity,
        after.strength,
    )
    return after


def temporal_permeability(before: Frame, frame: Frame, sigma: float) -> NDArray[np.float32]:
    """Compute how freely a memory passes between two frames, float32 (H, W), 0 to 1; not at all outside the foreground.

    exp(-change / sigma), see `change_beyond_noise`.

    Parameters
    ----------
    before, frame : two frames in a row
    sigma : grey levels
    """
    passage = np.exp(change_beyond_noise(before.guide, frame.guide, frame.noise) / -sigma).astype(np.float32)
    return passage if frame.mask is None else np.where(frame.mask, passage, np.float32(0))


@njit(cache=True, nogil=True)
def _remember_kernel(
    old: NDArray[np.float32],
    strength: NDArray[np.float32],
    passage: NDArray[np.float32],
    new: NDArray[np.float32],
    sigma: np.float32,
    memory: np.float32,
    out: NDArray[np.float32],
    out_strength: NDArray[np.float32],
) -> None:
    for y in range(new.shape[0]):
        for x in range(new.shape[1]):
            weight = passage[y, x] * strength[y, x]
            value, seen = old[y, x], new[y, x]
            gap = abs(seen - value)
            if weight > 0 and gap <= np.float32(2) * sigma:
                weight *= np.exp(-gap / sigma)
                value = (seen + weight * value) / (ONE_FRAME + weight)
                weight = min(ONE_FRAME + weight, memory)
            elif weight > ONE_FRAME and passage[y, x] > np.float32(STILL):
                weight -= ONE_FRAME  # another disparity, or none: the memory holds, weaker
            elif np.isnan(seen):
                value, weight = np.float32(np.nan), np.float32(0)
            else:
                value, weight = seen, ONE_FRAME
            out[y, x], out_strength[y, x] = value, weight

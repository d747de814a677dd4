"""A rectified stereo pair: what every matcher takes, checked once at the door."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture, Rectification, read_frame, read_masks, rectify_images, rectify_masks
from recon.depth.channels import grey_image

CONTEXT = 4  # pixels of background around the foreground: the census window of a pixel on its rim, blurred
MIN_SIDE = 7  # pixels: a 5x5 census window with a pixel to spare on each side
MIN_GREY_RANGE = 2  # grey levels: with fewer there is nothing to match


class NoTextureWarning(UserWarning):
    """A pair in which nothing can be matched."""


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Two rectified images of one instant, with the disparities to search.

    Convention: row y of one image corresponds to row y of the other; disparity = left column - right column.

    Parameters
    ----------
    left, right : uint8 (H, W, 3) sRGB or (H, W) grey
    n_disparities : how many whole disparities to search, pixels
    min_disparity : the smallest of them, pixels; may be negative
    left_mask, right_mask : bool (H, W), True on the foreground; absent, everything is foreground

    Raises
    ------
    ValueError
        If the images cannot be matched: different sizes or channels, not 8-bit, too small, disparities that are
        not positive in number or reach beyond the image, a mask of another size or without a foreground pixel.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    n_disparities: int
    min_disparity: int = 0
    left_mask: NDArray[np.bool_] | None = None
    right_mask: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        _check_image(self.left, "left")
        _check_image(self.right, "right")
        _check_alike(self.left, self.right)
        _check_disparities(self.n_disparities, self.min_disparity, width=self.width)
        for mask, side in ((self.left_mask, "left"), (self.right_mask, "right")):
            if mask is not None:
                _check_mask(mask, (self.height, self.width), side)

    @property
    def height(self) -> int:
        """Rows, pixels."""
        return int(self.left.shape[0])

    @property
    def width(self) -> int:
        """Columns, pixels."""
        return int(self.left.shape[1])

    def is_same(self, other: StereoPair) -> bool:
        """Tell whether two pairs have the same pictures, masks and disparities to search."""
        return all(
            np.array_equal(getattr(self, name), getattr(other, name))  # of None and an array as well
            for name in ("n_disparities", "min_disparity", "left", "right", "left_mask", "right_mask")
        )

    def foreground(self) -> tuple[slice, slice]:
        """Bound the left foreground, all that it can match, and a census window around: rows and columns."""
        if self.left_mask is None:
            return slice(0, self.height), slice(0, self.width)
        rows, columns = (np.flatnonzero(self.left_mask.any(axis=axis)) for axis in (1, 0))
        nearest = self.min_disparity + self.n_disparities - 1
        first = min(columns[0], columns[0] - nearest) - CONTEXT
        last = max(columns[-1], columns[-1] - self.min_disparity) + CONTEXT
        return (
            slice(max(int(rows[0]) - CONTEXT, 0), min(int(rows[-1]) + CONTEXT + 1, self.height)),
            slice(max(int(first), 0), min(int(last) + 1, self.width)),
        )


def rectified_pair(capture: Capture, rectification: Rectification, frame: int) -> StereoPair | None:
    """Read and rectify what a sensor recorded at a frame; None where a mask shows no foreground.

    Parameters
    ----------
    capture : the recording
    rectification : of one of its sensors
    frame : number, from 0

    Raises
    ------
    ValueError
        If the sensor has no pair, or its pictures cannot be read.
    """
    sensor_id = rectification.sensor_id
    if capture.stream(sensor_id).right is None:
        raise ValueError(f"sensor {sensor_id}: has one camera with depth maps, expected a pair to match")
    masks = read_masks(capture, sensor_id, frame)
    left_mask, right_mask = rectify_masks(rectification, *masks) if masks else (None, None)
    if any(mask is not None and not mask.any() for mask in (left_mask, right_mask)):
        return None
    left, right = rectify_images(rectification, *read_frame(capture, sensor_id, frame))
    return StereoPair(left, right, rectification.n_disparities, left_mask=left_mask, right_mask=right_mask)


def has_texture(pair: StereoPair) -> bool:
    """Tell whether both images have anything to match; a NoTextureWarning says if not."""
    for image, mask in ((pair.left, pair.left_mask), (pair.right, pair.right_mask)):
        grey = grey_image(image)
        if np.ptp(grey if mask is None else grey[mask]) < MIN_GREY_RANGE:
            reason = "the images have no texture: nothing can be matched, every disparity is NaN"
            warnings.warn(reason, NoTextureWarning, stacklevel=3)
            return False
    return True


def check_range(pair: StereoPair, disparity: NDArray[np.float32]) -> None:
    """Raise a ValueError if disparities of somebody else's method, (H, W), pixels, are all outside a pair's range."""
    matched, highest = disparity[np.isfinite(disparity)], pair.min_disparity + pair.n_disparities - 1
    if len(matched) and ((matched < pair.min_disparity - 0.5) | (matched > highest + 0.5)).all():
        raise ValueError(
            f"all disparities found, {matched.min():g} to {matched.max():g}, lie outside the range "
            f"{pair.min_disparity} to {highest}; a disparity is left minus right column, in pixels"
        )


def within_pair(pair: StereoPair, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Drop disparities, float32 (H, W), pixels, outside a pair's range or on its left background: NaN."""
    highest = pair.min_disparity + pair.n_disparities - 1
    is_match = (disparity >= pair.min_disparity - 0.5) & (disparity <= highest + 0.5)
    if pair.left_mask is not None:
        is_match &= pair.left_mask
    return np.where(is_match, disparity, np.float32(np.nan))


def _check_image(image: NDArray[np.uint8], side: str) -> None:
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(f"the {side} image has shape {image.shape}; expected (rows, columns) or (rows, columns, 3)")
    if image.dtype != np.uint8:
        raise ValueError(f"the {side} image is {image.dtype}; expected 8 bits a channel (uint8): convert it first")
    if min(image.shape[:2]) < MIN_SIDE:
        rows, columns = image.shape[:2]
        raise ValueError(f"the {side} image is {columns}x{rows} pixels; matching needs at least {MIN_SIDE} each way")


def _check_alike(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> None:
    if left.shape[:2] != right.shape[:2]:
        raise ValueError(
            f"the left image is {left.shape[1]}x{left.shape[0]}, the right {right.shape[1]}x{right.shape[0]}; "
            "a rectified pair has one size"
        )
    if left.ndim != right.ndim:
        channels = [1 if image.ndim == 2 else image.shape[2] for image in (left, right)]
        raise ValueError(f"the left image has {channels[0]} channels, the right {channels[1]}; expected the same")


def _check_disparities(n_disparities: int, min_disparity: int, *, width: int) -> None:
    if n_disparities < 1:
        raise ValueError(f"the number of disparities is {n_disparities}; expected at least 1")
    if min_disparity <= -width or min_disparity + n_disparities > width:
        raise ValueError(
            f"disparities {min_disparity} to {min_disparity + n_disparities - 1} reach beyond images "
            f"{width} pixels wide; search fewer"
        )


def _check_mask(mask: NDArray[np.bool_], shape: tuple[int, int], side: str) -> None:
    if mask.shape != shape:
        raise ValueError(f"the {side} mask has shape {mask.shape}; expected the images' {shape}")
    if mask.dtype != np.bool_:
        raise ValueError(f"the {side} mask is {mask.dtype}; expected bool, True on the foreground")
    if not mask.any():
        raise ValueError(f"the {side} mask is empty; at least one foreground pixel is needed")

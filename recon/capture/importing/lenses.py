"""Lenses by the names that calibrations give them: OpenCV's perspective models are kept, fisheyes are undistorted.

A model that is not known is refused by its name; four numbers without a name are a question, as they are a fisheye's or
a perspective camera's.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError, Pixels
from recon.geometry.lens_names import FISHEYE, MOST_NUMBERS, PERSPECTIVE, UNLIKE, plain_name
from recon.geometry.rig import Camera

N_FISHEYE = 4


@dataclass(frozen=True, eq=False)
class FisheyeCamera(Camera):
    """The pinhole camera that the undistorted pictures of a fisheye have: same K, same size, no distortion.

    What a pinhole picture of that size cannot hold, at the edges, is cut off.

    Parameters
    ----------
    lens : float64 (4,), k1 to k4 of the angle: r = theta (1 + k1 theta^2 + ... + k4 theta^8)

    Source: Kannala, Brandt, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye
    lenses", 2006, as OpenCV's module fisheye has it.
    """

    lens: NDArray[np.float64] = field(default_factory=lambda: np.zeros(N_FISHEYE))

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "lens", np.asarray(self.lens, np.float64).ravel())
        if self.lens.shape != (N_FISHEYE,) or not np.isfinite(self.lens).all():
            raise ValueError(f"a fisheye has {self.lens.size} distortion numbers, expected {N_FISHEYE} finite ones")
        if self.dist.any() or self.K[0, 1]:
            raise ValueError("a fisheye has perspective distortion or skew besides, which is not read")

    @property
    def pinhole(self) -> Camera:
        """The camera of the undistorted pictures."""
        return Camera(self.K, self.size, self.cam_from_world)

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        columns, rows = cv2.fisheye.initUndistortRectifyMap(
            self.K, self.lens, np.eye(3), self.K, self.size, cv2.CV_32FC1
        )
        return columns, rows

    def undistorted(self, picture: Pixels) -> Pixels:
        """Resample a picture (H, W) or (H, W, 3) as the pinhole camera would have taken it."""
        if picture.shape[1::-1] != self.size:
            width, height = picture.shape[1::-1]
            raise CaptureError(f"a picture is {width}x{height}, its camera {self.size[0]}x{self.size[1]}")
        return np.asarray(cv2.remap(picture, *self._maps, cv2.INTER_LANCZOS4), picture.dtype)


def with_lens(camera: Camera, model: str | None, dist: NDArray[np.float64]) -> Camera:
    """Give a camera its lens: a `FisheyeCamera` if the model is one.

    Parameters
    ----------
    camera : without distortion
    model : as the calibration names it, in any case; None where it does not
    dist : float64, its numbers in the shape of the file: a column (4, 1) without a name is OpenCV's fisheye, or k1, k2,
        p1, p2

    Raises
    ------
    CaptureError
        If the model is not known, or four numbers have no name.
    """
    name = plain_name(model)
    if name in FISHEYE:
        lens = dist.ravel()
        if lens.size == N_FISHEYE + 1 and not lens[-1]:  # programs that write five numbers whatever the model
            lens = lens[:N_FISHEYE]
        return FisheyeCamera(camera.K, camera.size, camera.cam_from_world, lens=lens)
    if name in UNLIKE and not dist.any():
        return camera
    if name is not None and name not in PERSPECTIVE:
        raise CaptureError(
            f"the camera model is {model}, expected one of {', '.join(PERSPECTIVE)} or {', '.join(FISHEYE)}; undistort "
            "the pictures with the program that calibrated them"
        )
    if name is None and dist.shape == (N_FISHEYE, 1) and dist.any():
        raise CaptureError(
            "four distortion numbers in a column, without a name: a fisheye's, as cv2.fisheye.calibrate gives them, or "
            "k1, k2, p1, p2 of a perspective camera? Add the line `distortion_model: equidistant` or "
            "`distortion_model: plumb_bob` to the calibration"
        )
    if name in MOST_NUMBERS and dist.ravel()[MOST_NUMBERS[name] :].any():
        raise CaptureError(
            f"{dist.size} distortion numbers, expected {MOST_NUMBERS[name]} at most of the model {model}; OpenCV's "
            "models with more are rational_polynomial and thin_prism"
        )
    return replace(camera, dist=dist)

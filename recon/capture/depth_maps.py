"""Depth maps that a capture brings along, from RGB-D cameras, LiDAR or other programs: read, and turned to disparities.

All that follows depth maps works on disparities, so given depth becomes the disparity of an imagined pair
(`recon.capture.rectify.rectify_depth`). No digit that matters is lost: float32 keeps a depth to one part in 8 million.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import DepthMaps, SensorStream, depth_path
from recon.capture.images import CaptureError, read_stored_image
from recon.capture.rectify import (
    Rectification,
    is_straight,
    rectify,
    rectify_depth,
    scaled_camera,
    undistortion_maps,
    viewing_directions,
)
from recon.geometry.rig import Camera
from recon.runtime.exr import exr_channels
from recon.runtime.npy import read_npy
from recon.runtime.pfm import read_pfm
from recon.runtime.remote import fetched

EXR_CHANNELS = ("Z", "depth", "V", "Y", "R")  # in use for depth, alone or after a layer's name, the clearest first


def depth_maps_of(stream: SensorStream) -> DepthMaps:
    """Return a sensor's depth maps, or raise a CaptureError if it has none."""
    if stream.depth is None:
        raise CaptureError(f"sensor {stream.id}: has no depth maps")
    return stream.depth


def depth_size(stream: SensorStream) -> tuple[int, int]:
    """Return the size (width, height) of a sensor's depth maps, pixels."""
    return depth_maps_of(stream).size or stream.left.camera.size


def depth_view(stream: SensorStream, bounds: NDArray[np.floating]) -> Rectification:
    """Return the imagined pair of a sensor with depth maps; see `rectify_depth`.

    Parameters
    ----------
    stream : a sensor that has depth maps
    bounds : float64 (2, 3), mm, of the capture
    """
    return rectify_depth(stream.sensor, depth_size(stream), bounds)


def sensor_view(stream: SensorStream, bounds: NDArray[np.floating]) -> Rectification:
    """Return the rectified pair of a sensor, the imagined one where it has only depth maps.

    Parameters
    ----------
    stream : the sensor
    bounds : float64 (2, 3), mm, of the capture
    """
    return depth_view(stream, bounds) if stream.right is None else rectify(stream.sensor, bounds)


def read_depth_map(folder: Path, stream: SensorStream, frame: int) -> NDArray[np.float32]:
    """Read a depth map, float32 (H, W): z in the left camera's frame, mm, NaN where nothing was measured.

    Parameters
    ----------
    folder : the capture's
    stream : a sensor that has depth maps
    frame : number, from 0

    Raises
    ------
    CaptureError
        If the file is missing, unreadable, no depth map, or not of the size that the capture says.
    """
    depth, size = depth_maps_of(stream), depth_size(stream)
    path = fetched(depth_path(folder, depth, frame))
    lengths = read_depth_values(path).astype(np.float64) * depth.scale_mm
    if lengths.shape != size[::-1]:
        shape = "x".join(map(str, lengths.shape[::-1]))
        raise CaptureError(
            f"{path}: is a depth map of {shape} pixels, expected {size[0]}x{size[1]}; if it shows the camera's whole "
            'picture in another resolution, say so by "size" beside its "image"'
        )
    if depth.kind == "distance":
        lengths /= np.linalg.norm(rays(scaled_camera(stream.left.camera, size)), axis=2)
    return lengths.astype(np.float32)


def read_depth_values(path: Path) -> NDArray[np.float32]:
    """Read the values of a PNG, EXR, NPY or PFM file, float32 (H, W), NaN where nothing was measured.

    A CaptureError says that the file is missing, unreadable or not a single channel of numbers.
    """
    if not path.is_file():
        raise CaptureError(f"{path}: there is no such depth map")
    if path.suffix.lower() not in READERS:
        raise CaptureError(f"{path}: ends in {path.suffix!r}, expected a depth map of {', '.join(READERS)}")
    values = READERS[path.suffix.lower()](path)
    if values.ndim != 2 or values.dtype.kind not in "fui":
        raise CaptureError(
            f"{path}: holds {values.dtype} of shape {values.shape}, expected numbers in rows and columns"
        )
    numbers = values.astype(np.float32)
    return np.where(np.isfinite(numbers) & (numbers > 0), numbers, np.float32(np.nan))


def given_disparity(depth: NDArray[np.float32], stream: SensorStream, view: Rectification) -> NDArray[np.float32]:
    """Convert a depth map to the disparity of the imagined pair, float32 (H, W), pixels, NaN where there is none.

    Where the camera has distortion, a pixel takes the mean of the inverse depths around it, which is exact on planes,
    and NaN where one of them has none.

    Parameters
    ----------
    depth : float32 (H, W), z in the left camera, mm, NaN where there is none
    stream : the sensor
    view : from `depth_view`
    """
    camera = scaled_camera(stream.left.camera, view.left.size)
    inverse = 1.0 / depth
    if not is_straight(camera):
        maps = undistortion_maps(camera, view.left)
        inverse = cv2.remap(inverse, *maps, cv2.INTER_LINEAR, borderValue=float("nan"))
    return np.asarray(view.focal * view.baseline * inverse + view.offset, dtype=np.float32)


def rays(camera: Camera) -> NDArray[np.float64]:
    """Return the point of depth 1 that each pixel shows, float64 (H, W, 3), in the camera's frame; with distortion."""
    columns, rows = np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1]))
    pixels = np.stack([columns, rows], axis=2).reshape(-1, 2).astype(np.float64)
    return viewing_directions(camera, pixels).reshape(*columns.shape, 3)


def _read_png(path: Path) -> NDArray[np.generic]:
    values = read_stored_image(path)
    if values.dtype != np.uint16:
        raise CaptureError(f"{path}: holds {values.dtype} of shape {values.shape}, expected one channel of 16 bits")
    return values


def _read_array(path: Path) -> NDArray[np.generic]:
    try:
        return read_pfm(path) if path.suffix.lower() == ".pfm" else read_npy(path)
    except ValueError as error:
        raise CaptureError(str(error)) from error


def _read_exr(path: Path) -> NDArray[np.generic]:
    try:
        channels = exr_channels(path)
    except ValueError as error:
        raise CaptureError(str(error)) from error
    for wanted in EXR_CHANNELS:
        for name, pixels in channels.items():
            if name.lower().split(".")[-1] == wanted.lower():
                return pixels
    if len(channels) != 1:
        names = ", ".join(channels) or "none"
        raise CaptureError(f"{path}: holds the channels {names}, expected {', '.join(EXR_CHANNELS)} or only one")
    return next(iter(channels.values()))


READERS: dict[str, Callable[[Path], NDArray[np.generic]]] = {
    ".png": _read_png,
    ".npy": _read_array,
    ".exr": _read_exr,
    ".pfm": _read_array,
}

"""The pictures of a source on their way into a capture: as they are where it holds such, else as PNG.

A capture has PNG, JPEG and videos. BMP, TIFF, PGM, PPM and EXR become PNG, as do fisheyes, undistorted. 16 bits stay
so; where the values of a recording fill fewer, as those of cameras with 10, 12 or 14 do, they are spread, all alike.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.capture.bits import is_deep
from recon.capture.images import (
    IMAGE_SUFFIXES,
    JPEG_START,
    PNG_START,
    CaptureError,
    Pixels,
    is_video,
    read_deep_image,
    read_video_frame,
    write_picture,
)
from recon.capture.importing.lenses import FisheyeCamera
from recon.capture.pictures import copy_file
from recon.geometry.rig import Camera
from recon.runtime.files import allowed

FULL = 65535
STARTS = {".png": PNG_START, ".jpg": JPEG_START, ".jpeg": JPEG_START}  # of the files that are copied as they are


def stored(camera: Camera) -> Camera:
    """Return the camera of the pictures that `copy_picture` writes."""
    return camera.pinhole if isinstance(camera, FisheyeCamera) else camera


def copied_suffix(camera: Camera, path: Path) -> str:
    """Return the suffix of the file that `copy_picture` writes."""
    suffix = path.suffix.lower()
    is_copied = is_video(path) or (suffix in IMAGE_SUFFIXES and not (path.is_file() and not _is_of(path, path)))
    return suffix if is_copied and not isinstance(camera, FisheyeCamera) else ".png"


def copy_picture(camera: Camera, source: Path, target: Path, frame: int | None = None, *, bits: int = 16) -> None:
    """Copy a picture as it is, if the target can hold it so; else write what it shows, that of a fisheye undistorted.

    Parameters
    ----------
    camera : that took it
    source, target : files; the target's suffix is `copied_suffix`
    frame : of a video, which one to write; None for a picture, or to copy a whole video of no fisheye
    bits : that the values of 16 fill
    """
    allowed(source)
    is_fisheye, is_spread = isinstance(camera, FisheyeCamera), bits < 16 and is_deep(source)
    if not is_fisheye and (is_video(target) or (_is_of(source, target) and not is_spread)):
        copy_file(source, target)
        return
    decoded = read_deep_image(source) if frame is None or not is_video(source) else read_video_frame(source, frame)
    picture = _spread(decoded, bits) if is_spread else decoded
    if isinstance(camera, FisheyeCamera):
        picture = camera.undistorted(picture)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_picture(target, picture)


def copy_mask(camera: Camera, source: Path, target: Path) -> None:
    """Write a mask as PNG, that of a fisheye undistorted, as its picture is.

    Parameters
    ----------
    camera, source, target : as of `copy_picture`
    """
    mask: Pixels = read_deep_image(allowed(source))[..., 1]
    if mask.shape[::-1] != camera.size:
        raise CaptureError(
            f"{source}: a mask of {mask.shape[1]}x{mask.shape[0]}, expected {camera.size[0]}x{camera.size[1]}"
        )
    if isinstance(camera, FisheyeCamera):
        mask = camera.undistorted(mask)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_picture(target, np.asarray(mask if mask.dtype == np.uint8 else mask >> 8, np.uint8))


def _is_of(source: Path, target: Path) -> bool:
    """Tell whether a file holds what the name of its copy says, whatever its own name says."""
    start = STARTS.get(target.suffix.lower(), b"?")
    with source.open("rb") as file:
        return file.read(len(start)) == start


def _spread(pixels: Pixels, bits: int) -> Pixels:
    """Bring values of 16 bits that fill fewer to all of them."""
    largest = 2**bits - 1
    return np.asarray(np.rint(np.minimum(pixels, largest) * (FULL / largest)), np.uint16)

"""Recorded images and videos, by a reader that raises where OpenCV would fail softly; and pictures, written whole."""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.srgb import srgb_bytes
from recon.runtime.exr import exr_channels
from recon.runtime.files import write_bytes
from recon.runtime.picture_size import check_announced
from recon.runtime.pnm import is_pnm, read_pnm
from recon.runtime.tiff import read_tiff

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")  # of a capture's pictures
PICTURE_SUFFIXES = (*IMAGE_SUFFIXES, ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".exr")  # that are imported
VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v")
SPENT = sys.maxsize  # a decoder's next frame after a failure: every later call starts again
MAX_OPEN_VIDEOS = 64  # decoders kept open per process: 32 sensors
Pixels = NDArray[np.unsignedinteger[Any]]  # uint8 or uint16
TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # the last two of BigTIFF
PNG_START, PNG_HEAD, PNG_END = b"\x89PNG", 8, b"IEND"
JPEG_START = b"\xff\xd8"
JPEG_END = b"\xff\xd9"  # OpenCV fills what is missing of a cut-off JPEG with grey
JPEG_SCAN = b"\xff\xda"
COMBINED = "Combined"  # the layer of Blender's that is the picture
SENSOR_BITS = 12  # that cameras give; some programs write them into the lower bits of 16


class CaptureError(ValueError):
    """A recording that cannot be used as it is; the message names the file and the value."""


def is_video(path: str | Path) -> bool:
    """Tell whether the name is that of a video rather than of an image."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read a picture as RGB uint8 (H, W, 3), as the camera stored it: an EXIF orientation is not applied.

    Of 16 bits, the upper 8 are taken.

    A CaptureError says that the file is missing, is not an image, or is cut off; or that it has 16 bits with values of
    12 or fewer, of which the upper 8 show next to nothing.
    """
    pixels = read_deep_image(path)
    if pixels.dtype == np.uint16:
        _check_upper_bits(path, pixels)
    return np.asarray(pixels >> 8 if pixels.dtype == np.uint16 else pixels, np.uint8)


def read_deep_image(path: Path) -> Pixels:
    """Read a picture as RGB (H, W, 3) with the depth that it has, uint8 or uint16; the light of an EXR becomes sRGB.

    A CaptureError says that the file is missing, is not a picture, or is cut off.
    """
    if path.suffix.lower() == ".exr":
        return srgb_bytes(_light(path))
    content = _image_bytes(path)
    start = content[:4].tobytes()
    if start in TIFF_STARTS:
        return _tiff(path, content.tobytes())
    if is_pnm(start):
        return _pnm(path, content.tobytes())
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    return np.asarray(_decoded(path, content, flags))


def _tiff(path: Path, content: bytes) -> Pixels:
    try:
        return read_tiff(content)
    except ValueError as error:
        raise CaptureError(
            f"{path}: {error}; expected one picture of 8 or 16 bits, grey or RGB: write it as PNG, floating numbers as "
            "EXR"
        ) from error


def _pnm(path: Path, content: bytes) -> Pixels:
    try:
        return read_pnm(content)
    except ValueError as error:
        raise CaptureError(f"{path}: {error}") from error


def _light(path: Path) -> NDArray[np.floating]:
    """Return the linear light (H, W, 3) of an EXR picture: of no layer, of the only one, or of Blender's `Combined`."""
    try:
        channels = exr_channels(path)
    except (ValueError, OSError) as error:
        raise CaptureError(str(error)) from error
    layers: dict[str, dict[str, NDArray[Any]]] = {}
    for name, values in channels.items():
        layer, _, channel = name.rpartition(".")
        layers.setdefault(layer, {})[channel.upper()] = values
    lit = {layer: named for layer, named in layers.items() if {*"RGB"} <= {*named} or ({"Y"} <= {*named} <= {*"YA"})}
    named = [layer for layer in lit if len(lit) == 1 or not layer or layer.endswith(COMBINED)]
    light = [lit[named[0]].get(name, lit[named[0]].get("Y")) for name in "RGB"] if len(named) == 1 else []
    if not light or any(values is None or values.dtype.kind != "f" for values in light):
        raise CaptureError(f"{path}: holds the channels {', '.join(channels)}, expected light in R, G, B or Y, once")
    return np.stack([np.nan_to_num(np.asarray(values, np.float32)) for values in light], axis=-1)


def read_stored_image(path: Path) -> NDArray[np.generic]:
    """Read a PNG or JPEG with the channels and the depth it has: (H, W) if grey, (H, W, 3) RGB if not, without alpha.

    For callers that must not take a grey or a 16-bit image for a colour image of 8 bits; raises as `read_image` does.
    """
    pixels = _decoded(path, _image_bytes(path), cv2.IMREAD_UNCHANGED)
    return np.ascontiguousarray(pixels if pixels.ndim == 2 else pixels[..., 2::-1])


def write_picture(path: Path, picture: Pixels) -> bytes:
    """Write a picture, (H, W, 3) RGB or (H, W), as PNG or JPEG by its suffix, whole or not at all; 16 bits as PNG.

    Returns the file's bytes: a report's page holds them, too.
    """
    _, encoded = cv2.imencode(path.suffix, picture if picture.ndim == 2 else picture[..., ::-1])
    content = encoded.tobytes()
    write_bytes(path, content)
    return content


def read_video_frame(path: Path, frame: int) -> NDArray[np.uint8]:
    """Decode one frame (counted from 0) of a video as RGB uint8 (H, W, 3).

    Frames asked for in ascending order are decoded once each; going back starts again at the first frame,
    because seeking is not exact in every container.

    A CaptureError says that the file is missing, cannot be decoded, or ends before the frame.
    """
    return _open_video(path, *_version(path), os.getpid()).read(frame)


def video_times(path: Path) -> NDArray[np.float64]:
    """Return when each frame of a video is shown, float64 (N,), s; every frame counts, whatever its header says.

    A CaptureError says that the file is missing or holds no frame that can be decoded.
    """
    times = np.array(_times(path, *_version(path)))
    if len(times) == 0:
        raise CaptureError(f"{path}: is not a video that can be decoded")
    return times


def _version(path: Path) -> tuple[int, int]:
    """Return when a video was changed, ns, and its bytes: what is known of it holds while these do."""
    if not path.is_file():
        raise CaptureError(f"{path}: there is no such video")
    facts = path.stat()
    return facts.st_mtime_ns, facts.st_size


@lru_cache(maxsize=MAX_OPEN_VIDEOS)
def _times(path: Path, _changed_ns: int, _n_bytes: int) -> tuple[float, ...]:
    decoder = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    times = []
    while decoder.grab():
        times.append(decoder.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)
    decoder.release()
    return tuple(times)


class _Video:
    """An open decoder that knows which frame comes next."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = Lock()
        self._restart()

    def read(self, frame: int) -> NDArray[np.uint8]:
        with self._lock:
            if frame < self._next:
                self._restart()
            while self._next < frame:
                self._advance(self._decoder.grab(), frame)
            decoded, pixels = self._decoder.read()
            self._advance(decoded, frame)
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB))

    def _restart(self) -> None:
        self._decoder = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        self._decoder.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # calibrations hold for the sensor's own orientation
        self._next = 0
        if not self._decoder.isOpened():
            raise CaptureError(f"{self._path}: is not a video that can be decoded")

    def _advance(self, decoded: bool, wanted: int) -> None:
        if not decoded:
            n_frames, self._next = self._next, SPENT
            raise CaptureError(f"{self._path}: ends after {n_frames} frames, frame {wanted} was asked for")
        self._next += 1


@lru_cache(maxsize=MAX_OPEN_VIDEOS)
def _open_video(path: Path, _changed_ns: int, _n_bytes: int, _process: int) -> _Video:
    return _Video(path)  # keyed by the process too: a forked decoder shares its file position with its parent


def _check_upper_bits(path: Path, pixels: NDArray[np.integer]) -> None:
    brightest = int(np.max(pixels))
    if 0 < brightest < 2**SENSOR_BITS:
        raise CaptureError(
            f"{path}: has 16 bits, but no value above {brightest}, and would be taken for black; write the camera's "
            "pictures with 8 bits, or spread their values over all 16, all pictures alike"
        )


def _decoded(path: Path, content: NDArray[np.uint8], flags: int) -> NDArray[Any]:
    try:
        pixels = cv2.imdecode(content, flags)
    except cv2.error as error:  # more pixels than OpenCV takes
        raise CaptureError(f"{path}: is not readable as an image: {error.err}") from error
    if pixels is None:
        raise CaptureError(f"{path}: is not readable as an image (expected {', '.join(PICTURE_SUFFIXES)})")
    return np.asarray(pixels)


def _image_bytes(path: Path) -> NDArray[np.uint8]:
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise CaptureError(f"{path}: there is no such image") from error
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror}") from error
    if is_cut(content):
        raise CaptureError(f"{path}: is cut off after {len(content)} bytes, before the end of its picture, or damaged")
    if not content:
        raise CaptureError(f"{path}: is empty")
    try:
        check_announced(content, f"{path}: ")
    except ValueError as error:
        raise CaptureError(str(error)) from error
    return np.frombuffer(content, dtype=np.uint8)


def is_cut(content: bytes) -> bool:
    """Tell whether a PNG or JPEG lacks the end of its own data."""
    if content.startswith(PNG_START):
        return _is_cut_png(content)
    return content.startswith(JPEG_START) and _is_cut_jpeg(content)


def _is_cut_png(content: bytes) -> bool:
    """Tell whether a part of a PNG announces more bytes than follow: OpenCV would ask for gigabytes."""
    place = PNG_HEAD
    while place + PNG_HEAD <= len(content):
        if content[place + 4 : place + 8] == PNG_END:
            return False
        place += 12 + int.from_bytes(content[place : place + 4], "big")  # its length, kind and checksum
    return True


def _is_cut_jpeg(content: bytes) -> bool:
    """Tell whether a JPEG lacks the end of its own data.

    These begin after segments that may hold a thumbnail with an end of its own; and phones append a film or notes, so
    the end need not be the last that a file holds.
    """
    place = 2
    while content[place : place + 1] == b"\xff" and content[place : place + 2] != JPEG_SCAN:
        is_fill = content[place + 1 : place + 2] == b"\xff"  # any number of these may stand before a marker
        place += 1 if is_fill else 2 + int.from_bytes(content[place + 2 : place + 4], "big")
    return content.find(JPEG_END, place) < 0

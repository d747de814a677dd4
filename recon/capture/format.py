"""The capture on disk, where the way from recording to score begins: a folder with `capture.json` and its images."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError, is_video, read_image, read_video_frame
from recon.capture.recording import CameraStream, Capture, DepthMaps, HeldOut, SensorStream, image_path
from recon.capture.schema import Draft, capture_json, parse_capture
from recon.geometry.rig import Camera
from recon.runtime.files import read_json, write_json
from recon.runtime.remote import fetched, is_there, missing, stored

__all__ = [
    "CAPTURE_FILE",
    "CameraStream",
    "Capture",
    "CaptureError",
    "DepthMaps",
    "HeldOut",
    "Picture",
    "SensorStream",
    "depth_path",
    "expected_pictures",
    "foreground",
    "frame_pictures",
    "image_path",
    "mask_pictures",
    "plate_pictures",
    "read_capture",
    "read_draft",
    "read_frame",
    "read_held_out",
    "read_mask",
    "read_masks",
    "read_picture",
    "read_plates",
    "write_capture",
]

CAPTURE_FILE = "capture.json"
HALF_BRIGHT = 128


@dataclass(frozen=True, eq=False)
class Picture:
    """One instant of one camera: an image file, or a frame of a video."""

    path: Path
    frame: int
    camera: Camera


def read_capture(folder: Path, *, with_masks: bool = True) -> Capture:
    """Read a capture and make sure that all of its files are there; the images are not decoded yet.

    A CaptureError names the first thing that is wrong, and says how many more there are.

    Parameters
    ----------
    folder : the capture's
    with_masks : whether its masks are wanted; else it has none
    """
    draft = read_draft(folder)
    if not with_masks:
        sensors = tuple(replace(stream, mask=None) for stream in draft.sensors)
        draft = replace(draft, sensors=sensors, capture=draft.capture and replace(draft.capture, sensors=sensors))
    paths = [picture.path for picture in expected_pictures(folder, draft)]
    for stream in draft.sensors:
        paths += [depth_path(folder, stream.depth, frame) for frame in range(draft.n_frames or 0) if stream.depth]
    problems = draft.problems or tuple(f"{path}: there is no such file" for path in missing(dict.fromkeys(paths)))
    if problems or draft.capture is None:
        more = f" (and {len(problems) - 1} more: see `capture check`)" if len(problems) > 1 else ""
        raise CaptureError(problems[0] + more)
    return draft.capture


def read_draft(folder: Path) -> Draft:
    """Read `capture.json` without its images, and collect everything that is wrong with it."""
    path = folder / CAPTURE_FILE
    try:
        content = read_json(fetched(path))
    except ValueError as error:
        what = "" if is_there(path) else f"; a capture is a folder with a {CAPTURE_FILE}"
        return Draft(problems=(f"{error}{what}",))
    return parse_capture(path, content)


def write_capture(capture: Capture) -> Path:
    """Write `capture.json` into the capture's folder, whole or not at all, and return its path."""
    path = capture.folder / CAPTURE_FILE
    write_json(path, capture_json(capture))
    return stored(path)


def read_frame(capture: Capture, sensor_id: str, frame: int) -> tuple[NDArray[np.uint8], ...]:
    """Read the images (left, right) of a sensor at a frame, RGB uint8 (H, W, 3); (left,) if it has one camera.

    Parameters
    ----------
    capture : the capture
    sensor_id : such as S1
    frame : number, from 0

    Raises
    ------
    CaptureError
        If there is no such sensor or frame, or an image is missing, unreadable, or not of its camera's size.
    """
    capture.check_frame(frame)
    return tuple(map(read_picture, frame_pictures(capture.folder, capture.stream(sensor_id), frame)))


def read_masks(capture: Capture, sensor_id: str, frame: int) -> tuple[NDArray[np.bool_], ...] | None:
    """Read the foreground masks (left, right) of a sensor at a frame, bool (H, W); None if the sensor has none.

    Foreground is where the mask's image is at least half bright. A sensor of one camera has (left,).

    Parameters
    ----------
    capture : the capture
    sensor_id : such as S1
    frame : number, from 0
    """
    capture.check_frame(frame)
    return tuple(map(read_mask, mask_pictures(capture.folder, capture.stream(sensor_id), frame))) or None


def read_plates(capture: Capture, sensor_id: str) -> tuple[NDArray[np.uint8], ...] | None:
    """Read the clean plates (left, right) of a sensor, RGB uint8 (H, W, 3); None if the sensor has none."""
    return tuple(map(read_picture, plate_pictures(capture.folder, capture.stream(sensor_id)))) or None


def read_held_out(capture: Capture, photograph: HeldOut) -> NDArray[np.uint8]:
    """Read a held-out photograph, RGB uint8 (H, W, 3), as `read_picture` does."""
    return read_picture(_held_out_picture(capture.folder, photograph))


def frame_pictures(folder: Path, stream: SensorStream, frame: int) -> tuple[Picture, ...]:
    """Return the pictures (left, right) that a sensor recorded at a frame; (left,) if it has one camera.

    Parameters
    ----------
    folder : the capture's
    stream : the sensor and its images
    frame : number, from 0
    """
    return tuple(_picture(folder, side.image, frame, side.camera) for side in stream.cameras)


def mask_pictures(folder: Path, stream: SensorStream, frame: int) -> tuple[Picture, ...]:
    """Return a sensor's masks (left, right) at a frame; empty if it has none.

    Parameters
    ----------
    folder : the capture's
    stream : the sensor and its images
    frame : number, from 0
    """
    return tuple(_picture(folder, pattern, frame, stream.left.camera) for pattern in stream.mask or ())


def plate_pictures(folder: Path, stream: SensorStream) -> tuple[Picture, ...]:
    """Return a sensor's clean plates (left, right); empty if it has none."""
    return tuple(_picture(folder, name, 0, stream.left.camera) for name in stream.plate or ())


def depth_path(folder: Path, depth: DepthMaps, frame: int) -> Path:
    """Return the file of a depth map.

    Parameters
    ----------
    folder : the capture's
    depth : a sensor's depth maps
    frame : number, from 0
    """
    return image_path(folder, depth.image, frame)


def expected_pictures(folder: Path, draft: Draft) -> Iterator[Picture]:
    """Yield every picture that a capture, or the sound part of one, says it has."""
    for frame in range(draft.n_frames or 0):
        for stream in draft.cameras:
            yield _picture(folder, stream.image, frame, stream.camera)
        for sensor in draft.sensors:
            yield from mask_pictures(folder, sensor, frame)
    for sensor in draft.sensors:
        yield from plate_pictures(folder, sensor)
    for photograph in draft.held_out:
        yield _held_out_picture(folder, photograph)


def read_picture(picture: Picture) -> NDArray[np.uint8]:
    """Read a picture of the camera's size as RGB uint8 (H, W, 3).

    A CaptureError says that the file is missing, unreadable, or not of the camera's size.
    """
    path = fetched(picture.path)
    pixels = read_video_frame(path, picture.frame) if is_video(path) else read_image(path)
    height, width = pixels.shape[:2]
    if (width, height) != picture.camera.size:
        expected = "x".join(map(str, picture.camera.size))
        raise CaptureError(f"{path}: is {width}x{height} pixels, its calibration is for {expected}")
    return pixels


def read_mask(picture: Picture) -> NDArray[np.bool_]:
    """Read a foreground mask, bool (H, W), as `read_picture` does."""
    return foreground(read_picture(picture))


def foreground(pixels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where a mask's image, uint8 (H, W, 3), is at least half bright, bool (H, W)."""
    return np.asarray(pixels[..., 1] >= HALF_BRIGHT)


def _picture(folder: Path, pattern: str, frame: int, camera: Camera) -> Picture:
    return Picture(image_path(folder, pattern, frame), frame, camera)


def _held_out_picture(folder: Path, photograph: HeldOut) -> Picture:
    return _picture(folder, photograph.image, photograph.frame, photograph.camera)

"""A recording on disk, where the way from capture to video begins: a folder with `capture.json` and its images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError, is_video, read_image, read_mask, read_video_frame
from recon.capture.recording import (
    CameraStream,
    Capture,
    HeldOut,
    SensorStream,
    check_bounds,
    check_count,
    check_fps,
    check_kind,
    check_name,
    check_object,
    image_path,
)
from recon.files import read_json, write_json
from recon.rig import Camera

__all__ = [
    "CAPTURE_FILE",
    "SCHEMA_VERSION",
    "CameraStream",
    "Capture",
    "CaptureError",
    "Draft",
    "HeldOut",
    "SensorStream",
    "image_path",
    "read_capture",
    "read_draft",
    "read_frame",
    "read_held_out",
    "read_masks",
    "read_plates",
    "read_stream_frame",
    "write_capture",
]

CAPTURE_FILE = "capture.json"
SCHEMA_VERSION = 1

T = TypeVar("T")
P = TypeVar("P", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Draft:
    """What could be understood of a `capture.json`: the capture if nothing is wrong, else the sound parts.

    Parameters
    ----------
    capture : None if there is any problem
    cameras : the sound cameras of all sensors with their names ("sensor S1, left")
    sensors : the sound sensors
    problems : one sentence for everything that is wrong
    """

    capture: Capture | None = None
    n_frames: int | None = None
    bounds: NDArray[np.float64] | None = None
    cameras: tuple[tuple[str, CameraStream], ...] = ()
    sensors: tuple[SensorStream, ...] = ()
    held_out: tuple[HeldOut, ...] = ()
    problems: tuple[str, ...] = ()


def read_capture(folder: Path) -> Capture:
    """Read a capture and make sure that all of its files are there; the images are not decoded yet.

    Raises
    ------
    CaptureError
        Naming the first thing that is wrong, and how many more there are.
    """
    draft = read_draft(folder)
    problems = draft.problems
    if draft.capture is not None:
        problems = tuple(f"{path}: there is no such file" for path in _all_files(draft.capture) if not path.is_file())
    if problems or draft.capture is None:
        more = f" (and {len(problems) - 1} more: see `capture check`)" if len(problems) > 1 else ""
        raise CaptureError(problems[0] + more)
    return draft.capture


def read_draft(folder: Path) -> Draft:
    """Read `capture.json` without its images, and collect everything that is wrong with it."""
    path = folder / CAPTURE_FILE
    try:
        content = read_json(path)
    except ValueError as error:
        return Draft(problems=(str(error),))
    return _Parser(folder, path).draft(content)


def write_capture(capture: Capture) -> Path:
    """Write `capture.json` into the capture's folder, whole or not at all, and return its path."""
    path = capture.folder / CAPTURE_FILE
    write_json(path, _capture_json(capture))
    return path


def read_frame(capture: Capture, sensor_id: str, frame: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The images (left, right) of a sensor at a frame, RGB uint8 (H, W, 3).

    Raises
    ------
    CaptureError
        If there is no such sensor or frame, or an image is missing, unreadable, or not of its camera's size.
    """
    stream = capture.stream(sensor_id)
    _check_frame(capture, frame)
    return (
        read_stream_frame(capture.folder, stream.left, frame),
        read_stream_frame(capture.folder, stream.right, frame),
    )


def read_masks(capture: Capture, sensor_id: str, frame: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """The foreground masks (left, right) of a sensor at a frame, bool (H, W), or None if the sensor has none.

    Raises
    ------
    CaptureError
        As `read_frame`.
    """
    stream = capture.stream(sensor_id)
    _check_frame(capture, frame)
    if stream.mask is None:
        return None
    paths = [image_path(capture.folder, pattern, frame) for pattern in stream.mask]
    left, right = (_sized(read_mask(path), stream.left.camera, path) for path in paths)
    return left, right


def read_plates(capture: Capture, sensor_id: str) -> tuple[NDArray[np.uint8], NDArray[np.uint8]] | None:
    """The clean plates (left, right) of a sensor, RGB uint8 (H, W, 3), or None if the sensor has none.

    Raises
    ------
    CaptureError
        As `read_frame`.
    """
    stream = capture.stream(sensor_id)
    if stream.plate is None:
        return None
    paths = [capture.folder / name for name in stream.plate]
    left, right = (_sized(read_image(path), stream.left.camera, path) for path in paths)
    return left, right


def read_held_out(capture: Capture, photograph: HeldOut) -> NDArray[np.uint8]:
    """The pixels of a held-out photograph, RGB uint8 (H, W, 3).

    Raises
    ------
    CaptureError
        If the image is missing, unreadable, or not of its camera's size.
    """
    path = image_path(capture.folder, photograph.image, photograph.frame)
    return _sized(read_image(path), photograph.camera, path)


def read_stream_frame(folder: Path, stream: CameraStream, frame: int) -> NDArray[np.uint8]:
    """The image of one camera at a frame, RGB uint8 (H, W, 3).

    Raises
    ------
    CaptureError
        If the image is missing, unreadable, or not of the camera's size.
    """
    path = image_path(folder, stream.image, frame)
    pixels = read_video_frame(path, frame) if is_video(path) else read_image(path)
    return _sized(pixels, stream.camera, path)


class _Parser:
    """Reads the JSON part by part, so that one wrong part does not hide the next."""

    def __init__(self, folder: Path, path: Path) -> None:
        self._folder = folder
        self._path = path
        self._problems: list[str] = []

    def draft(self, content: Mapping[str, Any]) -> Draft:
        self._field(content, "schema_version", _check_schema)
        name = self._field(content, "name", check_name)
        kind = self._field(content, "kind", check_kind)
        fps = self._field(content, "fps", check_fps)
        n_frames = self._field(content, "n_frames", lambda value: check_count(value, "n_frames", at_least=1))
        bounds = self._field(content, "bounds", check_bounds)
        object_ = self._field({"object": {}, **content}, "object", check_object)
        cameras, sensors = self._sensors(content)
        held_out = self._held_out(content)
        capture = None
        if not self._problems:
            with self._at(""):
                capture = Capture(self._folder, name, kind, fps, n_frames, bounds, object_, sensors, held_out)
        return Draft(capture, n_frames, bounds, cameras, sensors, held_out, tuple(self._problems))

    @contextmanager
    def _at(self, place: str) -> Iterator[None]:
        try:
            yield
        except (ValueError, TypeError) as error:
            self._problems.append(f"{self._path}: {place}{': ' if place else ''}{error}")

    def _field(self, content: Mapping[str, Any], key: str, check: Callable[[Any], T]) -> Any:
        with self._at(""):
            return check(_member(content, key))
        return None

    def _sensors(
        self, content: Mapping[str, Any]
    ) -> tuple[tuple[tuple[str, CameraStream], ...], tuple[SensorStream, ...]]:
        entries: list[Any] = []
        with self._at(""):
            entries = _list(content, "sensors")
            if not entries:
                raise CaptureError("sensors is empty, expected at least one stereo sensor")
        cameras: list[tuple[str, CameraStream]] = []
        sensors: list[SensorStream] = []
        for number, entry in enumerate(entries):
            place = f"sensor {_label(entry, 'id', number)}"
            pair: list[CameraStream] = []
            for side in ("left", "right"):
                with self._at(f"{place}, {side}"):
                    pair.append(_stream(_member(_mapping(entry), side)))
                    cameras.append((f"{place}, {side}", pair[-1]))
            if len(pair) == 2:
                with self._at(place):
                    sensors.append(_sensor_stream(entry, *pair))
        return tuple(cameras), tuple(sensors)

    def _held_out(self, content: Mapping[str, Any]) -> tuple[HeldOut, ...]:
        entries: list[Any] = []
        with self._at(""):
            entries = _list({"held_out": [], **content}, "held_out")
        photographs: list[HeldOut] = []
        for number, entry in enumerate(entries):
            with self._at(f"held_out {_label(entry, 'image', number)}"):
                frame = check_count(_member(_mapping(entry), "frame"), "frame", at_least=0)
                photographs.append(HeldOut(_camera(entry), _text(entry, "image"), frame))
        return tuple(photographs)


def _sensor_stream(entry: Mapping[str, Any], left: CameraStream, right: CameraStream) -> SensorStream:
    plate = _pair(entry, "plate") if "plate" in entry else None
    mask = _pair(entry, "mask") if "mask" in entry else None
    return SensorStream(_text(entry, "id"), left, right, plate, mask)


def _stream(entry: Any) -> CameraStream:
    return CameraStream(_camera(_mapping(entry)), _text(entry, "image"))


def _camera(entry: Mapping[str, Any]) -> Camera:
    size = _list(entry, "size")
    if len(size) != 2 or any(isinstance(value, bool) or not isinstance(value, int) for value in size):
        raise CaptureError(f"size is {size}, expected [width, height] in whole pixels")
    return Camera(
        K=_numbers(entry, "K"),
        size=(size[0], size[1]),
        cam_from_world=_numbers(entry, "cam_from_world"),
        dist=_numbers({"dist": [], **entry}, "dist"),
    )


def _member(content: Mapping[str, Any], key: str) -> Any:
    if key not in content:
        raise CaptureError(f"{key} is missing")
    return content[key]


def _mapping(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise CaptureError(f"expected a JSON object, found {value!r}")
    return value


def _list(content: Mapping[str, Any], key: str) -> list[Any]:
    value = _member(content, key)
    if not isinstance(value, list):
        raise CaptureError(f"{key} is {value!r}, expected a list")
    return value


def _text(content: Mapping[str, Any], key: str) -> str:
    value = _member(content, key)
    if not isinstance(value, str) or not value:
        raise CaptureError(f"{key} is {value!r}, expected a text")
    return value


def _pair(content: Mapping[str, Any], key: str) -> tuple[str, str]:
    value = _mapping(_member(content, key))
    return _text(value, "left"), _text(value, "right")


def _numbers(content: Mapping[str, Any], key: str) -> NDArray[np.float64]:
    value = _list(content, key)
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CaptureError(f"{key} is {value}, expected numbers in a regular grid") from error


def _label(entry: Any, key: str, number: int) -> str:
    return str(entry[key]) if isinstance(entry, Mapping) and key in entry else f"number {number + 1}"


def _check_schema(version: Any) -> None:
    if version != SCHEMA_VERSION:
        raise CaptureError(f"schema_version is {version!r}, this program reads {SCHEMA_VERSION}")


def _check_frame(capture: Capture, frame: int) -> None:
    if not 0 <= frame < capture.n_frames:
        raise CaptureError(f"{capture.folder}: there is no frame {frame}, frames are 0 to {capture.n_frames - 1}")


def _sized(pixels: NDArray[P], camera: Camera, path: Path) -> NDArray[P]:
    height, width = pixels.shape[:2]
    if (width, height) != camera.size:
        raise CaptureError(
            f"{path}: is {width}x{height} pixels, its calibration is for {camera.size[0]}x{camera.size[1]}"
        )
    return pixels


def _all_files(capture: Capture) -> Iterator[Path]:
    for stream in capture.sensors:
        for pattern in (stream.left.image, stream.right.image, *(stream.mask or ())):
            n_files = 1 if is_video(pattern) else capture.n_frames
            yield from (image_path(capture.folder, pattern, frame) for frame in range(n_files))
        yield from (capture.folder / name for name in stream.plate or ())
    yield from (image_path(capture.folder, shot.image, shot.frame) for shot in capture.held_out)


def _capture_json(capture: Capture) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "name": capture.name,
        "kind": capture.kind,
        "fps": capture.fps,
        "n_frames": capture.n_frames,
        "bounds": capture.bounds.tolist(),
        "object": capture.object,
        "sensors": [_sensor_json(stream) for stream in capture.sensors],
        "held_out": [
            {"image": shot.image, **_camera_json(shot.camera), "frame": shot.frame} for shot in capture.held_out
        ],
    }


def _sensor_json(stream: SensorStream) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": stream.id}
    for side, camera_stream in (("left", stream.left), ("right", stream.right)):
        entry[side] = {"image": camera_stream.image, **_camera_json(camera_stream.camera)}
    for key, pair in (("plate", stream.plate), ("mask", stream.mask)):
        if pair is not None:
            entry[key] = {"left": pair[0], "right": pair[1]}
    return entry


def _camera_json(camera: Camera) -> dict[str, Any]:
    return {
        "K": camera.K.tolist(),
        "dist": camera.dist.tolist(),
        "size": list(camera.size),
        "cam_from_world": camera.cam_from_world.tolist(),
    }

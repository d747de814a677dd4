"""The content of `capture.json`: a recording from JSON, with everything that is wrong in it, and back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError
from recon.capture.recording import (
    SIDES,
    CameraStream,
    Capture,
    DepthMaps,
    HeldOut,
    SensorStream,
    check_bounds,
    check_count,
    check_fps,
    check_kind,
    check_name,
    check_object,
)
from recon.geometry.rig import Camera

SCHEMA_VERSION = 1
CAPTURE_KEYS = ("schema_version", "name", "kind", "fps", "n_frames", "bounds", "object", "sensors", "held_out")
SENSOR_KEYS: tuple[str, ...] = ("id", *SIDES, "depth", "plate", "mask")
CAMERA_KEYS: tuple[str, ...] = ("image", "K", "dist", "size", "cam_from_world")
DEPTH_KEYS = ("image", "scale_mm", "kind", "size")

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Draft:
    """The understood part of a `capture.json`: the capture if nothing is wrong, else the sound parts.

    Parameters
    ----------
    capture : None if there is any problem
    cameras : the sound cameras of all sensors
    sensors : the sound sensors
    problems : one sentence for everything that is wrong
    ignored : one sentence for every key that means nothing here, as it may be a slip for one that does
    """

    capture: Capture | None = None
    n_frames: int | None = None
    bounds: NDArray[np.float64] | None = None
    cameras: tuple[CameraStream, ...] = ()
    sensors: tuple[SensorStream, ...] = ()
    held_out: tuple[HeldOut, ...] = ()
    problems: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()


def parse_capture(path: Path, content: Mapping[str, Any]) -> Draft:
    """Understand the content of the `capture.json` at `path`, and collect everything that is wrong with it."""
    return _Parser(path).draft(content)


def capture_json(capture: Capture) -> dict[str, Any]:
    """Return the content of a capture's `capture.json`."""
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
    for side, camera_stream in zip(stream.sides, stream.cameras, strict=True):
        entry[side] = {"image": camera_stream.image, **_camera_json(camera_stream.camera)}
    if stream.depth is not None:
        entry["depth"] = {name: value for name, value in asdict(stream.depth).items() if value is not None}
    for key, names in (("plate", stream.plate), ("mask", stream.mask)):
        if names is not None:
            entry[key] = dict(zip(stream.sides, names, strict=True))
    return entry


def _camera_json(camera: Camera) -> dict[str, Any]:
    return {
        "K": camera.K.tolist(),
        "dist": camera.dist.tolist(),
        "size": list(camera.size),
        "cam_from_world": camera.cam_from_world.tolist(),
    }


class _Parser:
    """Reads the JSON part by part, so that one wrong part does not hide the next."""

    def __init__(self, path: Path) -> None:
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
                capture = Capture(self._path.parent, name, kind, fps, n_frames, bounds, object_, sensors, held_out)
        ignored = tuple(f"{self._path}: {sentence}" for sentence in _ignored_keys(content))
        return Draft(capture, n_frames, bounds, cameras, sensors, held_out, tuple(self._problems), ignored)

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

    def _sensors(self, content: Mapping[str, Any]) -> tuple[tuple[CameraStream, ...], tuple[SensorStream, ...]]:
        entries: list[Any] = []
        with self._at(""):
            entries = _list(content, "sensors")
            if not entries:
                raise CaptureError("sensors is empty, expected at least one sensor")
        cameras: list[CameraStream] = []
        sensors: list[SensorStream] = []
        for number, entry in enumerate(entries):
            place = f"sensor {_label(entry, 'id', number)}"
            sides = sides_of(entry)
            streams: list[CameraStream] = []
            for side in sides:
                with self._at(f"{place}, {side}"):
                    streams.append(_stream(_member(_mapping(entry), side)))
            cameras += streams
            if len(streams) == len(sides):
                with self._at(place):
                    sensors.append(_sensor_stream(entry, streams))
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


def _ignored_keys(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for every key that a capture does not have."""
    parts: list[tuple[str, Any, tuple[str, ...]]] = [("", content, CAPTURE_KEYS)]
    for key, known in (("sensors", SENSOR_KEYS), ("held_out", (*CAMERA_KEYS, "frame"))):
        entries = content.get(key)
        for number, entry in enumerate(entries if isinstance(entries, list) else ()):
            place = f"sensor {_label(entry, 'id', number)}, " if key == "sensors" else f"{key} number {number + 1}, "
            parts.append((place, entry, known))
            if key == "sensors" and isinstance(entry, Mapping):
                parts += [(f"{place}{side}, ", entry.get(side), CAMERA_KEYS) for side in SIDES]
                parts.append((f"{place}depth, ", entry.get("depth"), DEPTH_KEYS))
    for place, entry, known in parts:
        for name in entry if isinstance(entry, Mapping) else ():
            if name not in known:
                yield f"{place}{name} is no key of a capture, and is ignored; expected {', '.join(known)}"


def sides_of(entry: Any) -> tuple[str, ...]:
    """Return the cameras that a sensor's entry has to have: without a right one, it has depth maps."""
    has_one = isinstance(entry, Mapping) and "depth" in entry and "right" not in entry
    return SIDES[:1] if has_one else SIDES


def _sensor_stream(entry: Mapping[str, Any], cameras: Sequence[CameraStream]) -> SensorStream:
    sides = SIDES[: len(cameras)]
    plate = _names(entry, "plate", sides) if "plate" in entry else None
    mask = _names(entry, "mask", sides) if "mask" in entry else None
    right = cameras[1] if len(cameras) > 1 else None
    return SensorStream(_text(entry, "id"), cameras[0], right, plate, mask, _depth_maps(entry))


def _depth_maps(entry: Mapping[str, Any]) -> DepthMaps | None:
    if "depth" not in entry:
        return None
    content = _mapping(entry["depth"])
    size = size_of(content) if "size" in content else None
    return DepthMaps(_text(content, "image"), content.get("scale_mm", 1.0), content.get("kind", "z"), size)


def _stream(entry: Any) -> CameraStream:
    return CameraStream(_camera(_mapping(entry)), _text(entry, "image"))


def _camera(entry: Mapping[str, Any]) -> Camera:
    return Camera(
        K=_numbers(entry, "K"),
        size=size_of(entry),
        cam_from_world=_numbers(entry, "cam_from_world"),
        dist=_numbers({"dist": [], **entry}, "dist"),
    )


def size_of(content: Mapping[str, Any]) -> tuple[int, int]:
    """Return the (width, height) that an entry tells in pixels, or raise a CaptureError."""
    size = _list(content, "size")
    if len(size) != 2 or any(isinstance(value, bool) or not isinstance(value, int) for value in size):
        raise CaptureError(f"size is {size}, expected [width, height] in whole pixels")
    return size[0], size[1]


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


def _names(content: Mapping[str, Any], key: str, sides: Sequence[str]) -> tuple[str, ...]:
    value = _mapping(_member(content, key))
    return tuple(_text(value, side) for side in sides)


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

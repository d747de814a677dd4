"""The content of `capture.json`: a recording from JSON, with everything that is wrong in it, and back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, model_validator

from ground.fields import Expected
from ground.file_models import READS, SCHEMA_KEY, Fault, FilePart, Place, faults_of, schema_name, without
from recon.capture.images import CaptureError
from recon.capture.recording import (
    SIDES,
    CameraStream,
    Capture,
    DepthFacts,
    DepthMaps,
    Facts,
    HeldOut,
    SensorStream,
    Size,
    check_bounds,
)
from recon.geometry.lens_names import PERSPECTIVE, is_name_key, plain_name
from recon.geometry.rig import Camera

SCHEMA_VERSION = 1
LABELS = {"sensors": ("sensor", "id"), "held_out": ("held_out", "image")}  # what an entry is called by

Part = TypeVar("Part", bound=FilePart)


def _flat(value: Any) -> Any:
    """Return one list of numbers, also of a matrix with one row or column, as OpenCV writes them."""
    is_matrix = isinstance(value, list) and all(isinstance(row, list) for row in value)
    return [number for row in value for number in row] if is_matrix else value


def _corners(value: list[list[float]]) -> list[list[float]]:
    try:
        check_bounds(value)
    except CaptureError as error:
        raise ValueError(str(error).removeprefix("bounds: ")) from error
    return value


def _perspective(model: str | None) -> str | None:
    """Refuse the name of a lens that `dist` cannot describe."""
    if model is None or plain_name(model) in PERSPECTIVE:
        return model
    raise ValueError(
        f"is {model}, which the numbers of a capture, OpenCV's perspective ones, do not mean; import the recording by "
        "`capture import json`, which undistorts fisheyes, or undistort the pictures"
    )


Image = Annotated[str, Field(min_length=1), Expected("a text")]
Row3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Row4 = Annotated[list[float], Field(min_length=4, max_length=4)]


class Calibration(FilePart):
    """A calibrated camera."""

    K: Annotated[
        list[Row3],
        Field(min_length=3, max_length=3, description="OpenCV's matrix of the camera, pixels"),
        Expected("three rows of three numbers", is_whole=True),
    ]
    dist: Annotated[
        list[float],
        BeforeValidator(_flat),
        Field(description="its distortion: OpenCV's k1, k2, p1, p2, k3, ...; empty for none"),
        Expected("a list of numbers", is_whole=True),
    ] = Field(default_factory=list)
    distortion_model: Annotated[
        str | None,
        AfterValidator(_perspective),
        Field(description="its name: plumb_bob, rational_polynomial or another of OpenCV's perspective ones"),
    ] = None
    size: Annotated[Size, Field(description="of the picture")]
    cam_from_world: Annotated[
        list[Row4],
        Field(min_length=4, max_length=4, description="from the capture's world to the camera, mm"),
        Expected("four rows of four numbers", is_whole=True),
    ]

    @cached_property
    def camera(self) -> Camera:
        """The camera, which knows what a calibration cannot be."""
        return Camera(
            np.array(self.K), (self.size[0], self.size[1]), np.array(self.cam_from_world), np.array(self.dist)
        )


class CameraContent(Calibration):
    """A camera of a sensor."""

    image: Annotated[
        Image, Field(description="of its pictures: a pattern with `{frame:04d}` counted from 0, or a video")
    ]

    @cached_property
    def stream(self) -> CameraStream:
        """The camera and its pictures."""
        return CameraStream(self.camera, self.image)

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        _ = self.stream
        return self


class HeldOutContent(Calibration):
    """A photograph that no sensor uses, for `validate views`."""

    image: Annotated[Image, Field(description="the file, or a pattern with `{frame:04d}`")]
    frame: Annotated[int, Field(ge=0, description="its moment's number, from 0")]

    @cached_property
    def photograph(self) -> HeldOut:
        """The photograph and its camera."""
        return HeldOut(self.camera, self.image, self.frame)

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        _ = self.photograph
        return self


class ImagePair(FilePart):
    """An image, or the pattern of several, for each camera of a sensor."""

    left: Annotated[Image, Field(description="such as `S1/left/plate.png`, or `S1/mask/left/{frame:04d}.png`")]
    right: Annotated[Image | None, Field(description="if the sensor has a right camera")] = None


class SensorContent(FilePart):
    """A stereo pair, a camera with depth maps, or a pair whose left camera has them."""

    id: Annotated[str, Field(min_length=1, description="such as `S1`"), Expected("a text")]
    left: Annotated[CameraContent, Field(description="its left camera")]
    right: Annotated[CameraContent | None, Field(description="its right camera; without one, it has depth maps")] = None
    depth: Annotated[DepthFacts | None, Field(description="depth maps of its left camera")] = None
    plate: Annotated[ImagePair | None, Field(description="pictures of the empty studio: its clean plates")] = None
    mask: Annotated[
        ImagePair | None, Field(description="patterns of masks, white on the object; `capture segment` writes them")
    ] = None

    @cached_property
    def stream(self) -> SensorStream:
        """The sensor and where its images lie."""
        right = None if self.right is None else self.right.stream
        sides = SIDES if right is not None else SIDES[:1]
        plate, mask = (self._images(name, sides) for name in ("plate", "mask"))
        return SensorStream(self.id, self.left.stream, right, plate, mask, self._depth_maps)

    @property
    def _depth_maps(self) -> DepthMaps | None:
        if self.depth is None:
            return None
        size = self.depth.size
        return DepthMaps(**self.depth.model_dump() | {"size": None if size is None else (size[0], size[1])})

    def _images(self, name: Literal["plate", "mask"], sides: tuple[str, ...]) -> tuple[str, ...] | None:
        images = getattr(self, name)
        if images is None:
            return None
        if missing := [side for side in sides if getattr(images, side) is None]:
            raise CaptureError(f"{name}: {missing[0]} is missing")
        return tuple(getattr(images, side) for side in sides)

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        _ = self.stream
        return self


class CaptureContent(Facts):
    """The keys of `capture.json`; all paths are relative to its folder."""

    schema_version: Annotated[Literal[1], Field(description="of this file"), READS]
    bounds: Annotated[
        list[Row3],
        AfterValidator(_corners),
        Field(min_length=2, max_length=2, description="lowest and highest corner of what to reconstruct, mm"),
        Expected("[[x, y, z] lowest, [x, y, z] highest] in mm", is_whole=True),
    ]
    sensors: Annotated[
        list[SensorContent],
        Field(min_length=1, description="in the order in which the fly-through passes them"),
        Expected("a list of at least one sensor"),
    ]
    held_out: Annotated[
        list[HeldOutContent], Field(description="photographs that no sensor uses, for `validate views`")
    ] = Field(default_factory=list)


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
    unknown: list[Fault] = []
    try:
        known = CaptureContent.model_validate(content)
    except ValidationError as error:
        faults = [_lens_named_elsewhere(content, fault) for fault in faults_of(error, CaptureContent, content)]
        unknown = sorted((fault for fault in faults if fault.is_unknown), key=lambda fault: len(fault.place))
        if wrong := [fault for fault in faults if not fault.is_unknown]:
            return _sound_parts(path, content, wrong, unknown)
        known = CaptureContent.model_validate(without(content, [fault.place for fault in unknown]))
    sensors = tuple(sensor.stream for sensor in known.sensors)
    held_out = tuple(entry.photograph for entry in known.held_out)
    cameras = tuple(camera for sensor in sensors for camera in sensor.cameras)
    bounds, facts = check_bounds(known.bounds), dict(content.get("object", {}))
    capture, problems = None, tuple[str, ...]()
    try:
        capture = Capture(
            path.parent, known.name, known.kind, known.fps, known.n_frames, bounds, facts, sensors, held_out
        )
    except CaptureError as error:
        problems = (f"{path}: {error}",)
    return Draft(
        capture, known.n_frames, bounds, cameras, sensors, held_out, problems, _ignored(path, content, unknown)
    )


def _lens_named_elsewhere(content: Mapping[str, Any], fault: Fault) -> Fault:
    """Return the fault, as one that counts where an unknown key names a lens that a capture's numbers do not mean."""
    if not fault.is_unknown or not is_name_key(str(fault.place[-1])):
        return fault
    value: Any = content
    for part in fault.place:
        value = value[part]
    try:
        _perspective(str(value))
    except ValueError as error:
        return Fault(fault.place, str(error))
    return fault


def _sound_parts(path: Path, content: Mapping[str, Any], wrong: Sequence[Fault], unknown: Sequence[Fault]) -> Draft:
    """Return what can be used of a capture in which something is wrong, to look for more."""
    known = without(content, [fault.place for fault in unknown])
    wrong_keys = {fault.place[0] for fault in wrong if fault.place}
    entries = {key: entry if isinstance(entry := known.get(key), list) else [] for key in ("sensors", "held_out")}
    cameras = (entry.get(side) for entry in entries["sensors"] if isinstance(entry, Mapping) for side in SIDES)
    return Draft(
        n_frames=None if "n_frames" in wrong_keys else content["n_frames"],
        bounds=None if "bounds" in wrong_keys else check_bounds(content["bounds"]),
        cameras=tuple(camera.stream for camera in _sound(CameraContent, cameras)),
        sensors=tuple(sensor.stream for sensor in _sound(SensorContent, entries["sensors"])),
        held_out=tuple(entry.photograph for entry in _sound(HeldOutContent, entries["held_out"])),
        problems=tuple(f"{path}: {_sentence(content, fault)}" for fault in wrong),
        ignored=_ignored(path, content, unknown),
    )


def _sound(model: type[Part], entries: Iterable[Any]) -> Iterator[Part]:
    for entry in entries:
        with suppress(ValidationError):
            yield model.model_validate(entry)


def _ignored(path: Path, content: Mapping[str, Any], unknown: Sequence[Fault]) -> tuple[str, ...]:
    """Return a sentence for every key that a capture does not have."""
    return tuple(
        f"{path}: {', '.join(_names(content, fault.place))} is no key of a capture, and is ignored; "
        f"{fault.words.partition(', ')[2]}"
        for fault in unknown
    )


def _sentence(content: Mapping[str, Any], fault: Fault) -> str:
    """Say what is wrong, and where: with a sensor called by its id."""
    *parts, key = _names(content, fault.place)
    if not fault.is_told:
        return f"{', '.join(parts)}{': ' if parts else ''}{key} {fault.words}"
    where = ", ".join((*parts, key))
    return fault.words if fault.words.startswith(where) else f"{where}: {fault.words}"


def _names(content: Mapping[str, Any], place: Place) -> list[str]:
    """Return the names of the parts of a capture that lead to a place."""
    list_name, *rest = place
    if not rest or list_name not in LABELS:
        return list(map(str, place))
    entry, (kind, label) = content[list_name][rest[0]], LABELS[str(list_name)]
    called = entry[label] if isinstance(entry, Mapping) and label in entry else f"number {int(rest[0]) + 1}"
    return [f"{kind} {called}", *map(str, rest[1:])]


def capture_json(capture: Capture) -> dict[str, Any]:
    """Return the content of a capture's `capture.json`."""
    return {
        SCHEMA_KEY: schema_name("capture"),
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

"""The parts of a recording, and the rules that their values obey.

Convention: millimetres and seconds, cameras as in `recon.geometry.rig`, world y up, frames counted from 0. All paths
are relative to the capture's folder and stay inside it; `{frame}` or `{frame:04d}` stands for the frame's number.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from glob import escape, glob
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Field, ValidationError

from ground.fields import Expected
from ground.file_models import FilePart, WholeFile, faults_of
from recon.capture.images import IMAGE_SUFFIXES, VIDEO_SUFFIXES, CaptureError, is_video
from recon.geometry.rig import FARTHEST_MM, Camera, Rig, Sensor, checked_bounds, rigid
from recon.runtime.files import any_case, check_safe_name, in_any_case

GIVEN = "given"  # the depth method that takes the depth maps of the capture
SIDES = ("left", "right")
DEPTH_SUFFIXES = (".png", ".exr", ".npy")
MASK = "{sensor}/mask/{side}/{{frame:04d}}.png"  # where masks are written
STAND_IN_MM = 1.0  # from a camera with depth maps to the second one that stands in where only places matter
FRAME_FIELD = re.compile(r"\{frame(:0\d+d)?\}")


MOST_FRAMES = 1_000_000  # eleven hours of 25 a second
LEAST = 1e-6  # millimetres, or frames a second: one in twelve days


def _not_tiny(value: float) -> float:
    if value < LEAST:
        raise ValueError(f"is {value:g}, expected at least {LEAST:g}; check its unit")
    return value


def _countable(value: int) -> int:
    if value > MOST_FRAMES:
        raise ValueError(f"is {value}, expected at most {MOST_FRAMES}")
    return value


Millimetres = Annotated[float, Field(gt=0, le=FARTHEST_MM), AfterValidator(_not_tiny)]
Size = Annotated[
    list[Annotated[int, Field(ge=1)]],
    Field(min_length=2, max_length=2),
    Expected("[width, height] in whole pixels", is_whole=True),
]


class ObjectFacts(FilePart):
    """What is known of an object that a validation measures; other facts are kept as they are."""

    model_config = ConfigDict(extra="allow")

    radius_mm: Annotated[Millimetres | None, Field(description="of a sphere")] = None
    size_mm: Annotated[
        list[Millimetres] | None,
        Field(min_length=3, max_length=3, description="of a cuboid"),
        Expected("three positive numbers", is_whole=True),
    ] = None


class Facts(WholeFile):
    """What is said of a recording as a whole."""

    name: Annotated[
        str, AfterValidator(check_safe_name), Field(description="of the scene: `dataset` in films and studies")
    ]
    kind: Annotated[
        Literal["scene", "sphere", "cuboid"], Field(description="scene, or for validation sphere or cuboid")
    ]
    fps: Annotated[float, Field(gt=0, le=1e6, description="frames a second"), AfterValidator(_not_tiny)]
    n_frames: Annotated[
        int, Field(ge=1, description="how many frames every camera has recorded"), AfterValidator(_countable)
    ]
    object: Annotated[ObjectFacts, Field(description="of a sphere or a cuboid")] = ObjectFacts()


class DepthFacts(FilePart):
    """A sensor's depth maps: one for each picture of its left camera."""

    image: Annotated[
        str, Field(min_length=1, description="pattern of the files: PNG of one channel with 16 bits, EXR, or NPY")
    ]
    scale_mm: Annotated[Millimetres, Field(description="length of the value 1, mm")] = 1.0
    kind: Annotated[
        Literal["z", "distance"],
        Field(description="z along the optical axis, or distance along the ray from the optical centre"),
    ] = "z"
    size: Annotated[
        Size | None, Field(description="pixels, of maps in another resolution than the pictures; empty: theirs")
    ] = None


@dataclass(frozen=True, eq=False)
class CameraStream:
    """A camera, and the pattern of its images in the folder ("S1/left/{frame:04d}.png"), or the name of its video."""

    camera: Camera
    image: str

    def __post_init__(self) -> None:
        _check_path(self.image, IMAGE_SUFFIXES + VIDEO_SUFFIXES)


@dataclass(frozen=True)
class DepthMaps:
    """Depth maps of a sensor's left camera: a value for each pixel; 0, NaN and infinity where nothing was measured.

    Parameters
    ----------
    image : pattern of the files: PNG of one channel with 16 bits, EXR, or NPY
    scale_mm : length of the value 1, mm
    kind : "z" along the optical axis, or "distance" along the ray from the optical centre
    size : (width, height), pixels, of maps that show the camera's whole picture in another resolution; None for its own
    """

    image: str
    scale_mm: float = 1.0
    kind: str = "z"
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        _check_path(self.image, DEPTH_SUFFIXES)
        facts = asdict(self) | {"size": None if self.size is None else list(self.size)}
        check_facts(DepthFacts, facts, "depth: ")


@dataclass(frozen=True, eq=False)
class SensorStream:
    """A sensor and where its images lie: a stereo pair, a camera with depth maps, or a pair whose left camera has them.

    Parameters
    ----------
    left, right : the cameras; without `right`, there are depth maps
    plate : images (left, right) of the empty studio, or None; (left,) without a right camera
    mask : patterns (left, right) of the foreground masks, or None; (left,) without a right camera
    depth : depth maps of the left camera, or None
    """

    id: str
    left: CameraStream
    right: CameraStream | None
    plate: tuple[str, ...] | None = None
    mask: tuple[str, ...] | None = None
    depth: DepthMaps | None = None

    def __post_init__(self) -> None:
        check_sensor_id(self.id)
        if self.right is None and self.depth is None:
            raise CaptureError(f"sensor {self.id}: has neither a right camera nor depth maps; one of them is needed")
        for path in (*(self.plate or ()), *(self.mask or ())):
            _check_path(path, IMAGE_SUFFIXES)
        try:
            _ = self.sensor
        except ValueError as error:
            raise CaptureError(str(error)) from error

    @property
    def sensor(self) -> Sensor:
        """The two cameras without their images; where there is only one, a second stands in just beside it."""
        if self.right is not None:
            return Sensor(self.id, self.left.camera, self.right.camera)
        beside = rigid(np.eye(3), (-STAND_IN_MM, 0.0, 0.0)) @ self.left.camera.cam_from_world
        return Sensor(self.id, self.left.camera, replace(self.left.camera, cam_from_world=beside))

    @property
    def cameras(self) -> tuple[CameraStream, ...]:
        """The cameras: (left, right), or (left,)."""
        return (self.left,) if self.right is None else (self.left, self.right)

    @property
    def sides(self) -> tuple[str, ...]:
        """The names of the cameras."""
        return SIDES[: len(self.cameras)]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A photograph that no sensor uses, for checks of new views: what `camera` saw at `frame`."""

    camera: Camera
    image: str
    frame: int

    def __post_init__(self) -> None:
        _check_path(self.image, IMAGE_SUFFIXES)
        if self.frame < 0:
            raise CaptureError(f"frame is {self.frame}, expected a whole number of at least 0")


@dataclass(frozen=True, eq=False)
class Capture:
    """A recording of one scene by all sensors of a studio.

    Parameters
    ----------
    folder : where `capture.json` and the images lie
    name : the scene's name, the `dataset` of later stages
    kind : "scene", "sphere" or "cuboid"
    fps : frames per second
    n_frames : number of instants that every camera has recorded
    bounds : float64 (2, 3), mm, lowest and highest corner of the space to be reconstructed, over all frames
    object : {"radius_mm": r} of a sphere, {"size_mm": [a, b, c]} of a cuboid, else empty
    sensors : in the order in which the fly-through passes them
    held_out : photographs for checks of new views

    Raises
    ------
    CaptureError
        If a value is not one of those above; the first one found is named.
    """

    folder: Path
    name: str
    kind: str
    fps: float
    n_frames: int
    bounds: NDArray[np.float64]
    object: dict[str, Any]
    sensors: tuple[SensorStream, ...]
    held_out: tuple[HeldOut, ...] = ()

    def __post_init__(self) -> None:
        check_facts(Facts, {name: getattr(self, name) for name in Facts.model_fields if name != "schema_file"})
        object.__setattr__(self, "bounds", check_bounds(self.bounds))
        _check_ids([stream.id for stream in self.sensors])
        for stream in self.sensors:
            _check_patterns(stream, self.n_frames)
        for photograph in self.held_out:
            if photograph.frame >= self.n_frames:
                raise CaptureError(
                    f"held_out {photograph.image}: frame {photograph.frame} of a capture of {self.n_frames} frames"
                )

    @property
    def rig(self) -> Rig:
        """All sensors' cameras; see `SensorStream.sensor` for those that have only one."""
        return Rig(tuple(stream.sensor for stream in self.sensors))

    def sensors_for(self, method: str) -> tuple[SensorStream, ...]:
        """Return the sensors that a depth method uses: those with depth maps if it is `GIVEN`, else all."""
        return tuple(stream for stream in self.sensors if method != GIVEN or stream.depth is not None)

    def check_frame(self, frame: int) -> None:
        """Raise a CaptureError if there is no such frame."""
        if not 0 <= frame < self.n_frames:
            raise CaptureError(f"{self.folder}: there is no frame {frame}, frames are 0 to {self.n_frames - 1}")

    def stream(self, sensor_id: str) -> SensorStream:
        """Return the sensor of an id, or raise a CaptureError if there is none."""
        for stream in self.sensors:
            if stream.id == sensor_id:
                return stream
        ids = ", ".join(stream.id for stream in self.sensors)
        raise CaptureError(f"{self.folder}: there is no sensor {sensor_id!r}, there are {ids}")


def evenly_chosen(n: int, most: int) -> list[int]:
    """Choose at most so many of the numbers 0 to n - 1, evenly, the first and the last among them."""
    return sorted({round(number) for number in np.linspace(0, n - 1, min(n, most))})


def image_path(folder: Path, pattern: str, frame: int) -> Path:
    """Return the file of a pattern at a frame.

    Parameters
    ----------
    folder : the capture's
    pattern : such as "S1/left/{frame:04d}.png"
    frame : number, from 0
    """
    return folder / FRAME_FIELD.sub(lambda field: field.group().format(frame=frame), pattern)


def frames_after(folder: Path, pattern: str, last: int) -> list[int]:
    """Return the numbers, in order, of a pattern's files at frames after the last one.

    Parameters
    ----------
    folder, pattern : as of `image_path`
    last : number of a frame
    """
    if not FRAME_FIELD.search(pattern):
        return []
    form = Path(escape(str(folder)), any_case(FRAME_FIELD.sub("*", escape(pattern))))
    paths = glob(str(form))  # noqa: PTH207  # the pattern may be absolute
    numbers = {int(number) for path in paths for number in re.findall(r"\d+", path)}
    later = [number for number in sorted(numbers) if number > last]
    return [number for number in later if in_any_case(image_path(folder, pattern, number)).is_file()]


def chosen_frames(folder: Path, frames: Sequence[int], wanted: range | None) -> list[int]:
    """Return the frames that were asked for.

    Parameters
    ----------
    folder : of the recording or run, for the message
    frames : which it has
    wanted : which of them, up to sys.maxsize where they have no end; None for all

    Raises
    ------
    CaptureError
        If it has none of them.
    """
    chosen = [frame for frame in frames if wanted is None or frame in wanted]
    if wanted is not None and not chosen:
        end = "" if wanted.stop == sys.maxsize else wanted.stop
        raise CaptureError(f"{folder}: has frames {frames[0]} to {frames[-1]}, none of them in {wanted.start}:{end}")
    return chosen


def check_sensor_id(name: str) -> None:
    """Raise a CaptureError if files cannot be called by a sensor's id."""
    if not re.fullmatch(r"[\w.-]+", name) or name.startswith("."):
        raise CaptureError(f"sensor id {name!r} is no file name: use letters, digits, '_', '-' and '.'")


def check_bounds(bounds: Any) -> NDArray[np.float64]:
    """Return float64 (2, 3), each lowest value below its highest, or raise a CaptureError."""
    try:
        return checked_bounds(bounds)
    except ValueError as error:
        raise CaptureError(str(error)) from error


def check_facts(model: type[FilePart], facts: Mapping[str, Any], place: str = "") -> None:
    """Raise a CaptureError if facts are not as a model says.

    Parameters
    ----------
    model : of the facts
    facts : by its keys
    place : what stands before the message
    """
    try:
        model.model_validate(facts)
    except ValidationError as error:
        raise CaptureError(f"{place}{faults_of(error, model, facts)[0]}") from error


def _check_ids(ids: list[str]) -> None:
    if not ids:
        raise CaptureError("a capture needs at least one sensor, found none")
    if len(set(ids)) != len(ids):
        raise CaptureError(f"sensor ids must differ, found {', '.join(ids)}")


def _check_patterns(stream: SensorStream, n_frames: int) -> None:
    depth = [stream.depth.image] if stream.depth is not None else []
    for pattern in (*(camera.image for camera in stream.cameras), *(stream.mask or ()), *depth):
        if n_frames > 1 and not is_video(pattern) and not FRAME_FIELD.search(pattern):
            raise CaptureError(
                f"sensor {stream.id}: {pattern} names one image for {n_frames} frames; "
                "put {frame:04d} where the number stands"
            )


def _check_path(path: str, suffixes: tuple[str, ...]) -> None:
    pure, plain = PurePosixPath(path), FRAME_FIELD.sub("", path)
    if pure.is_absolute() or ".." in pure.parts or "\\" in path or ":" in plain:
        raise CaptureError(f"path {path!r} leaves the capture's folder; use a relative path with '/' and without '..'")
    if "{" in plain or "}" in plain:
        raise CaptureError(f"path {path!r}: the only placeholder is {{frame}}, with leading zeros {{frame:04d}}")
    if pure.suffix.lower() not in suffixes:
        raise CaptureError(f"path {path!r} ends in {pure.suffix!r}, expected one of {', '.join(suffixes)}")

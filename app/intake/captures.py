"""Read which pictures a capture has, without decoding them: enough to list, show and draw on them.

`reconstudy capture check` reads a capture in full, with its calibration and pictures.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from app.errors import InvalidError
from app.ffmpeg import VIDEO_SUFFIXES
from app.files import read_json

CAPTURE_FILE = "capture.json"
SIDES = ("left", "right")
FRAME_FIELD = re.compile(r"\{frame(:0\d{1,2}d)?\}")
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
MOST_FRAMES = 1_000_000
LARGEST_DESCRIPTION = 2 * 1024 * 1024  # bytes of a JSON that pages read, each time: two thousand cameras
LONGEST_FAULT = 300  # letters


@dataclass(frozen=True)
class CameraPictures:
    """The pictures of a camera.

    Parameters
    ----------
    sensor, side : of the camera, such as S1 and left
    pattern : of its files, `{frame}` stands for the frame's number; or the name of its video
    width, height : pixels
    mask : pattern of its masks; None where there are none
    """

    sensor: str
    side: str
    pattern: str
    width: int
    height: int
    mask: str | None = None

    @property
    def name(self) -> str:
        return f"{self.sensor}/{self.side}"

    @property
    def is_video(self) -> bool:
        return self.pattern.lower().endswith(VIDEO_SUFFIXES)


@dataclass(frozen=True)
class CaptureOutline:
    """A capture's name, length and cameras, in the order of its file."""

    name: str
    n_frames: int
    fps: float
    cameras: tuple[CameraPictures, ...]

    @property
    def sensors(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(camera.sensor for camera in self.cameras))

    @property
    def has_masks(self) -> bool:
        return all(camera.mask for camera in self.cameras)

    def camera(self, sensor: str, side: str) -> CameraPictures:
        """Return a camera by its sensor and side.

        Raises
        ------
        InvalidError
            If there is none.
        """
        for camera in self.cameras:
            if (camera.sensor, camera.side) == (sensor, side):
                return camera
        known = ", ".join(camera.name for camera in self.cameras)
        raise InvalidError(f"The capture has no camera {sensor[:40]}/{side[:40]}; it has {known}.")

    def frame(self, text: str) -> int:
        """Return a frame by its number as text.

        Raises
        ------
        InvalidError
            If there is none.
        """
        if not text.isascii() or not text.isdigit() or int(text) >= self.n_frames:
            raise InvalidError(f"The capture has no frame {text[:20]}; its frames are 0 to {self.n_frames - 1}.")
        return int(text)


def read_outline(folder: Path) -> CaptureOutline:
    """Read a capture's outline.

    Raises
    ------
    InvalidError
        If `capture.json` is missing, damaged, or lacks what every capture has.
    """
    path = folder / CAPTURE_FILE
    try:
        content = read_json(path, LARGEST_DESCRIPTION)
    except ValueError as error:
        if not path.is_file():
            raise InvalidError(f"There is no {CAPTURE_FILE} in the folder, so it is no capture.") from error
        reason = str(error).removeprefix(f"{path}: ")
        raise InvalidError(f"{CAPTURE_FILE} {reason}. Write it again, then repeat.") from error
    try:
        return _outline(content)
    except (KeyError, TypeError, ValueError) as error:
        lacking = f"{error} is missing" if isinstance(error, KeyError) else str(error)[:LONGEST_FAULT]
        raise InvalidError(
            f"{CAPTURE_FILE} does not describe a capture: {lacking}. “Check a recording” tells more."
        ) from error


def picture_path(folder: Path, camera: CameraPictures, frame: int) -> Path:
    """Return the file of a camera's picture at a frame, or its video."""
    return _at(folder, camera.pattern, frame)


def missing_pictures(folder: Path, outline: CaptureOutline) -> list[str]:
    """Return the pictures that a capture names and that are not there, by their place in the folder."""
    expected = dict.fromkeys(
        picture_path(folder, camera, frame) for frame in range(outline.n_frames) for camera in outline.cameras
    )
    return [path.relative_to(folder).as_posix() for path in expected if not path.is_file()]


def _at(folder: Path, pattern: str, frame: int) -> Path:
    return folder / FRAME_FIELD.sub(lambda field: field.group().format(frame=frame), pattern)


def _outline(content: Mapping[str, Any]) -> CaptureOutline:
    n_frames, fps = content["n_frames"], content["fps"]
    if not isinstance(n_frames, int) or not 1 <= n_frames <= MOST_FRAMES:
        raise ValueError(f"n_frames is {n_frames!r}, expected a whole number from 1")
    if not isinstance(fps, int | float) or not fps > 0:
        raise ValueError(f"fps is {fps!r}, expected a number above 0")
    cameras = tuple(_cameras(content["sensors"]))
    if not cameras:
        raise ValueError("sensors is empty, expected at least one sensor")
    return CaptureOutline(str(content["name"]), n_frames, float(fps), cameras)


def _cameras(sensors: Any) -> Iterator[CameraPictures]:
    for sensor in sensors:
        name = sensor["id"]
        if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,39}", name):
            raise ValueError(f"the sensor {name!r} has no plain name such as S1")
        masks = sensor.get("mask") or {}
        for side in SIDES:
            if side in sensor:
                width, height = (_pixels(value) for value in sensor[side]["size"])
                mask = _inside(masks[side], PICTURE_SUFFIXES + VIDEO_SUFFIXES) if side in masks else None
                pattern = _inside(sensor[side]["image"], PICTURE_SUFFIXES + VIDEO_SUFFIXES)
                yield CameraPictures(name, side, pattern, width, height, mask)


def _pixels(value: Any) -> int:
    if not isinstance(value, int) or not 1 <= value <= 65536:
        raise ValueError(f"a camera's size holds {value!r}, expected numbers of pixels")
    return value


def _inside(pattern: Any, suffixes: tuple[str, ...]) -> str:
    """Return a pattern of files that lie in the capture's folder."""
    if not isinstance(pattern, str) or not pattern.lower().endswith(suffixes):
        raise ValueError(f"image is {pattern!r}, expected the place of a picture or video in the folder")
    path = PurePosixPath(pattern)
    if path.is_absolute() or any(part.startswith(".") for part in path.parts) or "\\" in pattern or "\0" in pattern:
        raise ValueError(f"image is {pattern!r}, expected a place inside the folder")
    return pattern

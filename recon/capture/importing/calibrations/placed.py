"""What a reader of calibrations returns, and what the readers share: pictures of a camera, YAML, tables of numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from recon.capture.images import CaptureError
from recon.capture.importing.lenses import with_lens
from recon.capture.importing.sources import faults_at
from recon.capture.importing.views import View
from recon.capture.pictures import find_pictures
from recon.geometry.lens_names import model_name
from recon.geometry.rig import Y_FROM, Camera, rigid
from recon.runtime.files import files_like, first_of

MOST_BYTES = 4_000_000  # of a calibration; those of thousands of board pictures have a tenth
LOOKED_AT = 65536  # bytes of a file, to tell what it is
CAMERA_FROM_WORLD = rigid(Y_FROM["-y"], np.zeros(3))  # of a first camera whose pose nobody tells: y is up


@dataclass(frozen=True, eq=False)
class Placed:
    """The cameras of a calibration.

    Parameters
    ----------
    views : by their numbers in the source, in mm
    bounds : float64 (2, 3), mm, in the source's world; None if the source says nothing
    up : axis of the source's world that points upwards
    fps : frames a second; None if the source says nothing
    is_rig : whether neighbours are stereo pairs, so that they need not be named
    """

    views: dict[int, View]
    bounds: NDArray[np.float64] | None = None
    up: str = "y"
    fps: float | None = None
    is_rig: bool = True

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Neighbours, two by two, where they are a rig and none is left over."""
        numbers = list(self.views)
        return list(zip(numbers[::2], numbers[1::2], strict=True)) if self.is_rig and len(numbers) % 2 == 0 else []


def read_text(path: Path) -> str:
    """Read the text of a calibration, or raise a CaptureError."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise CaptureError(f"{path}: has {path.stat().st_size} bytes, expected a calibration of {MOST_BYTES}")
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise CaptureError(f"{path}: cannot be read: {error}") from error


def read_yaml(path: Path) -> dict[str, Any]:
    """Read the first map of a YAML file, as programs for robots write it."""
    text = read_text(path)
    try:
        text = text.partition("\n")[2] if text.startswith("%YAML:") else text  # as OpenCV begins it
        content = next(iter(yaml.safe_load_all(text)), None)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise CaptureError(f"{path}: is not readable as YAML: {error}") from error
    if not isinstance(content, dict):
        raise CaptureError(f"{path}: holds no keys and values, expected YAML")
    return content


def calibration_in(source: Path, *names: str, holds: str = "") -> Path:
    """Return the file of a calibration: the source, or the first file in it of some names, or the one of forms.

    Parameters
    ----------
    source : file or folder
    names : of files, or forms such as `*.mat`, below the folder
    holds : regular expression of what such a file says, which tells it from others of its form

    Raises
    ------
    CaptureError
        If there is none, or files of a form differ, so that nothing tells which one is meant.
    """
    if source.is_file():
        return source
    if named := first_of(source, names):
        return named
    paths = files_like(source, *names)
    meant = [path for path in paths if re.search(holds, beginning(path))] or paths
    if not meant:
        raise CaptureError(f"{source}: holds no {' or '.join(names)}")
    if len(meant) > 1:
        check_alike(source, {path: path.read_bytes() for path in meant})
    return meant[0]


def beginning(path: Path) -> str:
    """Return the first text of a file, whatever program of whatever system wrote it."""
    with path.open("rb") as file:
        return file.read(LOOKED_AT).decode("utf-8", "replace").removeprefix("\ufeff").replace("\r\n", "\n")


def check_alike(source: Path, contents: Mapping[Path, object]) -> None:
    """Raise a CaptureError if files of a folder that are a calibration each say different things.

    Parameters
    ----------
    source : the folder
    contents : what each file says
    """
    first = next(iter(contents.values()))
    if any(content != first for content in contents.values()):
        names = ", ".join(path.name for path in contents)
        raise CaptureError(f"{source}: holds {len(contents)} calibrations that differ, {names}; name the one to read")


def assigned(path: Path, separator: str) -> dict[str, str]:
    """Return what stands behind each name in the lines NAME SEPARATOR TEXT of a file."""
    lines = (line.partition(separator) for line in read_text(path).splitlines() if separator in line)
    return {name.strip(): text.strip() for name, _, text in lines}


def numbers(text: str) -> NDArray[np.float64]:
    """Return all numbers (N,) of a text, which has nothing else but brackets, separators and comments."""
    return np.array(re.sub(r"#[^\n]*|[\[\];,]", " ", text).split(), dtype=np.float64)


def find_view(
    folder: Path, names: tuple[str, ...], number: int, camera: Mapping[str, Any] | None = None
) -> Path | None:
    """Return the first of some places that holds pictures: a folder of them, a video or one picture; None for none.

    Parameters
    ----------
    folder : that the names are below
    names : without suffix, the usual one first
    number : of the camera, for `{number}` in the names
    camera : what else the names may use, by its name in braces
    """
    for name in names:
        base = folder / name.format(number=number, **(camera or {}))
        try:
            pictures = find_pictures(base)
        except CaptureError:
            continue
        if len(pictures.files) > 1 and not pictures.is_folder:
            return base  # of several whose names begin so
        return pictures.files[0].parent if pictures.is_folder else pictures.files[0]
    return None


def needed_view(folder: Path, names: tuple[str, ...], number: int) -> Path:
    """Return what `find_view` finds, or raise a CaptureError that names the places.

    Parameters
    ----------
    folder, names, number : as of `find_view`
    """
    place = find_view(folder, names, number)
    if place is None:
        places = ", ".join(dict.fromkeys(name.format(number=number) for name in names))
        raise CaptureError(f"{folder}: holds no pictures of camera {number}; looked for {places}: a folder, or a video")
    return place


def lens_camera(
    place: object, entry: Mapping[str, Any], K: NDArray[np.float64], size: Any, pose: NDArray[np.float64], dist: Any
) -> Camera:
    """Return a camera with the lens that an entry names.

    Parameters
    ----------
    place : file and camera, for messages
    entry : with the lens's name
    K : float64 (3, 3)
    size : [width, height]
    pose : `cam_from_world`, mm
    dist : numbers of the lens
    """
    with faults_at(place):
        width, height = (int(length) for length in size)
        return with_lens(Camera(K, (width, height), pose), model_name(entry), np.array(dist, np.float64).reshape(-1, 1))


def pinhole(intrinsics: Sequence[float]) -> NDArray[np.float64]:
    """Return K (3, 3) of fx, fy, cx, cy, pixels."""
    fx, fy, cx, cy = intrinsics
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

"""What an importer hands over: a foreign recording as it understood it, and what the importing person knows better.

An importer only finds cameras and names of pictures; `recon.capture.importing.into_capture` makes a capture of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from recon.capture.images import CaptureError
from recon.capture.pictures import Pictures
from recon.capture.recording import DEPTH_SUFFIXES
from recon.geometry.rig import UNITS_MM, Y_FROM, Camera

QUATERNION_TOLERANCE = 0.01  # of its length; lists carry at least three digits
PLAIN_WORDS = tuple(
    (re.compile(form), words)
    for form, words in (  # of what Python and numpy say of a file that holds something else
        (r"could not convert string to float: (?:np.str_\()?('.*?')\)?", r"\1 stands where a number is expected"),
        (r"invalid literal for int\(\) with base 10: (?:np.str_\()?('.*?')\)?", r"\1 stands where a count is expected"),
        (r"cannot convert float (NaN|infinity) to integer", r"\1 stands where a count is expected"),
        (r".* argument must be .* number, not 'NoneType'", "nothing stands where a number is expected"),
        (r".* argument must be .* number, not '(\w+)'", r"a \1 stands where a number is expected"),
        (r"cannot reshape array of size (\d+) into shape \((.*?),?\)", r"\1 numbers stand where \2 are expected"),
        (r"(not enough|too many) values to unpack \(expected ((?:at least )?\d+).*", r"\1 values, expected \2"),
        (r"setting an array element with a sequence.*", "lists of several lengths stand where numbers are expected"),
        (r"Singular matrix", "a matrix of cameras has no inverse"),
        (r"(?:list )?index .*out of (?:range|bounds).*", "fewer values than expected"),
    )
)


@dataclass(frozen=True, eq=False)
class ImportOptions:
    """Facts that the importing person knows better than the files; None where the files shall tell.

    Parameters
    ----------
    name : the scene's name, None for that of the source's folder
    n_frames : frames to take, None for all
    bounds : float64 (2, 3), in the capture's world and mm
    unit_mm : length of the source's unit, mm, None for the importer's default
    fps : frames per second
    up : axis of the source's world that points upwards, a key of Y_FROM; None for the importer's default
    pairs : of views that become stereo sensors, (left, right) by the numbers that the source gives them
    shots : names of those to take, where the source has several; None for all
    """

    name: str | None = None
    n_frames: int | None = None
    bounds: ArrayLike | None = None
    unit_mm: float | None = None
    fps: float | None = None
    up: str | None = None
    pairs: Sequence[tuple[int, int]] | None = None
    shots: Sequence[str] | None = None

    def __post_init__(self) -> None:
        _check_up(self.up or "y")
        if self.n_frames is not None and self.n_frames < 1:
            raise CaptureError(f"n_frames is {self.n_frames}, expected at least 1")


@dataclass(frozen=True)
class DepthSource:
    """Depth maps of the source in the order of time, and what they mean; see `DepthMaps`.

    Parameters
    ----------
    depth_of : z in units of `scale_mm` from the values of a file; None where they are that
    """

    files: tuple[Path, ...]
    scale_mm: float
    kind: str = "z"
    size: tuple[int, int] | None = None
    depth_of: Callable[[NDArray[np.float32]], NDArray[np.float32]] | None = None

    @property
    def suffix(self) -> str:
        """Of the files in a capture."""
        suffix, *others = {path.suffix.lower() for path in self.files}
        return ".npy" if others or suffix not in DEPTH_SUFFIXES or self.depth_of else suffix


@dataclass(frozen=True, eq=False)
class SensorSource:
    """A sensor of the source, a stereo pair or a camera with depth maps; poses are in mm, in the source's world.

    Parameters
    ----------
    masks : files of each camera in the order of time; empty for none
    """

    id: str
    left: Camera
    right: Camera | None
    pictures: tuple[Pictures, ...]
    depth: DepthSource | None = None
    masks: tuple[tuple[Path, ...], ...] = ()

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras: (left, right), or (left,)."""
        return (self.left,) if self.right is None else (self.left, self.right)


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording as an importer understood it; None and empty where the source does not say.

    Parameters
    ----------
    bounds : float64 (2, 3), mm, in the source's world
    held_out : cameras with their photographs of frame 0
    up : axis of the source's world that points upwards, a key of Y_FROM
    """

    name: str
    sensors: tuple[SensorSource, ...]
    kind: str = "scene"
    object: dict[str, Any] = field(default_factory=dict)
    fps: float | None = None
    bounds: NDArray[np.float64] | None = None
    held_out: tuple[tuple[Camera, Path], ...] = ()
    up: str = "y"

    def __post_init__(self) -> None:
        _check_up(self.up)


@contextmanager
def faults_at(place: object) -> Iterator[None]:
    """Turn what fails on the content of a source into a CaptureError that names the place.

    Parameters
    ----------
    place : a file, or words for a place in it
    """
    try:
        yield
    except CaptureError as error:
        if str(error).startswith(str(place)):
            raise
        raise CaptureError(f"{place}: {error}") from error
    except KeyError as error:
        raise CaptureError(f"{place}: {error.args[0]} is missing") from error
    except (AttributeError, IndexError, OverflowError, TypeError, ValueError, cv2.error) as error:
        told = next((form.sub(words, str(error)) for form, words in PLAIN_WORDS if form.search(str(error))), error)
        raise CaptureError(f"{place}: {told}") from error


def turn_of(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation (3, 3) of a quaternion x, y, z, w, or raise a CaptureError if its length is not 1."""
    parts = np.asarray(quaternion, np.float64)
    length = float(np.linalg.norm(parts))
    if not abs(length - 1) <= QUATERNION_TOLERANCE:
        raise CaptureError(f"a rotation is a quaternion of the length {length:g}, expected 1")
    return np.asarray(Rotation.from_quat(parts).as_matrix())


def parse_unit(text: str) -> float:
    """Parse a unit, one of UNITS_MM or a positive number, to millimetres, or raise a CaptureError if it is neither."""
    try:
        length = UNITS_MM[text] if text in UNITS_MM else float(text)
    except ValueError:
        length = float("nan")
    if not (np.isfinite(length) and length > 0):
        raise CaptureError(f"unit {text!r}: expected {', '.join(UNITS_MM)} or the unit's length in mm")
    return length


def _check_up(up: str) -> None:
    if up not in Y_FROM:
        raise CaptureError(f"up is {up!r}, expected one of {', '.join(Y_FROM)}")

"""One camera's recording as somebody else left it: a folder of images, or a video."""

from __future__ import annotations

import re
import shutil
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.capture.images import (
    PICTURE_SUFFIXES,
    VIDEO_SUFFIXES,
    CaptureError,
    is_video,
    read_deep_image,
    read_video_frame,
    video_times,
)
from recon.runtime.files import allowed, in_any_case

DEFAULT_FPS = 25.0
PLATE_STEM = "plate"
MAX_UNEVEN = 0.25  # of the mean interval between a video's frames; above, its frame rate is variable
MOST_FASTER = 1.001  # one video than another; above, frames of one number are not of one instant


@dataclass(frozen=True)
class Pictures:
    """One camera's recording.

    Parameters
    ----------
    files : images in the order of time, or one video
    plate : the clean plate, or None
    is_folder : whether the files are all that a folder holds, so that nobody has said which belong together
    """

    files: tuple[Path, ...]
    plate: Path | None = None
    is_folder: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "files", tuple(map(in_any_case, self.files)))
        object.__setattr__(self, "plate", self.plate and in_any_case(self.plate))
        if len(self.files) > 1 and any(map(is_video, self.files)):
            raise CaptureError(f"{', '.join(map(str, self.files))} are several files, expected pictures or one video")

    @property
    def is_video(self) -> bool:
        """True if the recording is one video."""
        return is_video(self.files[0])

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the first picture."""
        first = self.files[0]
        height, width = (read_video_frame(first, 0) if self.is_video else read_deep_image(first)).shape[:2]
        return width, height


def find_pictures(base: Path, *, instead_of: Path | None = None) -> Pictures:
    """Find the recording at a name without suffix: a folder of images, a video, a single image, or numbered ones.

    Images of a folder are taken in the order of the numbers in their names; one named `plate` is the clean plate.
    Numbered ones have the name before their number: `left-0000.png` or `left01.jpg` of `left`.

    Parameters
    ----------
    base : the name
    instead_of : an image that gives way to any other recording, as its camera was only placed by it

    Raises
    ------
    CaptureError
        If there is none of them, or more than one.
    """
    recordings = recordings_named(base, (*PICTURE_SUFFIXES, *VIDEO_SUFFIXES))
    if len(recordings) > 1:
        recordings = [path for path in recordings if path != instead_of]
    if not recordings and (numbered := _numbered(base)):
        return Pictures(numbered)
    if len(recordings) != 1:
        names = ", ".join(path.name for path in recordings)
        raise CaptureError(f"{base}: found {names or 'nothing'}, expected one folder of images, video or image")
    return _in_folder(recordings[0]) if recordings[0].is_dir() else Pictures((recordings[0],))


def _numbered(base: Path) -> tuple[Path, ...]:
    name = re.compile(rf"{re.escape(base.name)}[-_]?\d+", re.IGNORECASE)
    images = images_in(base.parent) if base.parent.is_dir() else []
    return tuple(path for path in images if name.fullmatch(path.stem))


def recordings_named(base: Path, suffixes: Collection[str]) -> list[Path]:
    """Return the folder of a name, and the files that have it before one of these suffixes, in any case.

    Parameters
    ----------
    base : the name, without suffix
    suffixes : in small letters, each with its dot
    """
    base = in_any_case(base)
    beside = sorted(base.parent.iterdir()) if base.parent.is_dir() else []
    alike = (path for path in beside if path.stem.lower() == base.name.lower() and path.suffix.lower() in suffixes)
    files = [path for path in alike if path.is_file()]
    files = [path for path in files if path.stem == base.name] or files
    return [base, *files] if base.is_dir() else files


def images_in(folder: Path) -> list[Path]:
    """Return the images of a folder, without files that the system hides, such as those of macOS for its own use."""
    images = (path for path in folder.iterdir() if path.suffix.lower() in PICTURE_SUFFIXES)
    return sorted((path for path in images if not path.name.startswith(".")), key=by_number)


def steady_rate(path: Path) -> float:
    """Return the frames a second of a video, or raise a CaptureError if they do not follow each other evenly."""
    intervals = np.diff(video_times(path))
    if len(intervals) == 0:
        return DEFAULT_FPS
    mean = float(intervals.mean())
    if mean <= 0 or np.abs(intervals - mean).max() > MAX_UNEVEN * mean:
        raise CaptureError(
            f"{path}: has a variable frame rate, intervals of {intervals.min() * 1000:.1f} to "
            f"{intervals.max() * 1000:.1f} ms; record or convert it at a constant rate"
        )
    return round(1.0 / mean, 3)


def common_rate(videos: Mapping[str, Path]) -> float:
    """Return the frames a second of all videos, by their names in messages; a CaptureError if they differ."""
    rates = {name: steady_rate(video) for name, video in videos.items()}
    slow, fast = min(rates, key=rates.__getitem__), max(rates, key=rates.__getitem__)
    if rates[fast] > MOST_FASTER * rates[slow]:
        raise CaptureError(f"{slow} has {rates[slow]:.3f} frames a second, {fast} {rates[fast]:.3f}; expected one rate")
    return rates[slow]


def copy_file(source: Path, target: Path) -> None:
    """Copy a file that a recording names, making the folder it goes to. A ValueError as in `allowed`."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(allowed(source), target)


def _in_folder(folder: Path) -> Pictures:
    images = images_in(folder)
    frames = tuple(path for path in images if path.stem.lower() != PLATE_STEM)
    if not frames:
        raise CaptureError(f"{folder}: holds no images ({', '.join(PICTURE_SUFFIXES)})")
    if len(kinds := {path.suffix.lower().replace("jpeg", "jpg") for path in frames}) > 1:
        raise CaptureError(f"{folder}: holds images of several formats, {', '.join(sorted(kinds))}, expected one")
    plate = next((path for path in images if path.stem.lower() == PLATE_STEM), None)
    return Pictures(frames, plate, is_folder=True)


def by_number(path: Path) -> list[tuple[int, str]]:
    """Return what puts files in the order of the numbers in their names: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.stem)]

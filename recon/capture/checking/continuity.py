"""Faults of a recording over time, and of its light: repeated frames, frozen cameras, unequal counts, exposures."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from recon.capture.checking.matches import Matches
from recon.capture.images import CaptureError, is_video, video_times
from recon.capture.recording import CameraStream, SensorStream, frames_after

THUMBNAIL_WIDTH = 64  # pixels: averages that noise does not reach
STILL_SHARE = 0.05  # of a camera's usual change from frame to frame
STILL_LEVELS = 0.2  # grey levels of the thumbnail: compression noise of a repeated frame
FROZEN_FRAMES = 4  # as many equal frames in a row are no hiccup
DARK_LEVELS = 8.0  # below, ratios of brightness mean nothing
MAX_JUMP = 1.08  # of the brightness from a frame to the next
MAX_UNLIKE = 2.0  # of a camera's brightness from that of the others: the object fills their pictures differently
MIN_FRAMES_FOR_RATE = 4
MAX_LEFT_TO_RIGHT = 1.15  # of the brightness of matched points
MAX_COLOUR = 1.2  # of a colour's share of it, either way
LOWEST_TINT = -0.5  # rank correlation of red by blue in two pictures; .94 to .99 in the studio's, less if exchanged
FEWEST_TINTS = 20  # points
COLOURS = ("red", "green", "blue")
SURE = 2.6  # standard deviations of a number of heads, for 99 %


@dataclass(frozen=True, eq=False)
class Glance:
    """A thumbnail that stands for a picture.

    Parameters
    ----------
    thumbnail : float32 (h, w), grey levels
    checksum : of all pixels
    """

    thumbnail: NDArray[np.float32]
    checksum: int


Glances = Mapping[str, Mapping[int, Glance]]
"""By the camera's image pattern and the frame."""


def glance_at(picture: NDArray[np.uint8]) -> Glance:
    """Take the thumbnail and checksum of a picture, uint8 (H, W, 3)."""
    size = (THUMBNAIL_WIDTH, max(1, round(THUMBNAIL_WIDTH * picture.shape[0] / picture.shape[1])))
    grey = cv2.cvtColor(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    return Glance(grey.astype(np.float32), zlib.crc32(picture.tobytes()))


def is_one_camera_twice(stream: SensorStream, glances: Glances) -> bool:
    """Tell whether a sensor's left and right pictures are the same ones, of more than one colour, in all frames."""
    if stream.right is None:
        return False
    left, right = (glances.get(side.image, {}) for side in stream.cameras)
    shared = [frame for frame in left if frame in right and np.ptp(left[frame].thumbnail) > 0]
    return bool(shared) and all(left[frame].checksum == right[frame].checksum for frame in shared)


def frozen_cameras(glances: Glances) -> Iterator[str]:
    """Say one sentence for every camera that shows the same picture for several frames."""
    for pattern, by_frame in glances.items():
        for first, last, is_frozen in _still(by_frame):
            if is_frozen:
                yield f"{pattern}: the camera is frozen, it shows the same picture from frame {first} to {last}"


def continuity_warnings(glances: Glances) -> Iterator[str]:
    """Say one sentence for every repeated run of frames, jump of the exposure and unlike exposure."""
    for pattern, by_frame in glances.items():
        for first, last, is_frozen in _still(by_frame):
            if not is_frozen:
                yield f"{pattern}: frame {last} repeats frame {first}"
        yield from _jumps(pattern, by_frame)
    yield from _unlike(glances)


def count_warnings(folder: Path, cameras: Iterable[CameraStream], n_frames: int) -> Iterator[str]:
    """Say one sentence for every camera that has recorded more frames than the capture says, or has a gap before them.

    Parameters
    ----------
    folder : the capture's
    cameras : all cameras
    n_frames : as the capture says
    """
    for camera in cameras:
        later = _later_frames(folder, camera.image, n_frames)
        if later and later[-1] >= n_frames + len(later):
            first = min(set(range(n_frames, later[-1])) - set(later))
            yield (
                f"{folder / camera.image}: lacks frame {first} but has later ones, up to {later[-1]}; where all "
                "cameras lack a frame, the motion jumps: leave the later ones out, or number them without a gap"
            )
        elif later:
            yield (
                f"{folder / camera.image}: has {n_frames + len(later)} frames, the capture {n_frames}; unequal counts "
                "mean that cameras were not started together or that another one lost frames"
            )


def matched_levels(left: NDArray[np.uint8], right: NDArray[np.uint8], matches: Matches) -> NDArray[np.float64]:
    """Read the levels around matched points of two pictures.

    Parameters
    ----------
    left, right : uint8 (H, W, 3), sRGB
    matches : of the two

    Returns
    -------
    float64 (2, N, 4): grey, red, green and blue of the points in left, and in right
    """
    levels = []
    for image, points in ((left, matches.left), (right, matches.right)):
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        smooth = cv2.blur(np.dstack([grey, image]), (5, 5)).astype(np.float64)
        columns, rows = np.round(points).astype(int).T
        levels.append(smooth[rows, columns])
    return np.stack(levels)


def level_ratios(levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Divide the levels (2, N, 4) of points in left by those in right: float64 (N, 4), NaN where it is dark."""
    left, right = levels
    return np.asarray(left / np.where(np.minimum(left, right) > DARK_LEVELS, right, np.nan))


def unlike(ratios: NDArray[np.float64], most: float) -> float | None:
    """Return the median of ratios (N,) if it is certain to be more than `most` or less than its inverse, else None.

    Points that are matched wrongly, and highlights, spread them: of a few, the median is chance. NaN are left out.
    """
    ratios = ratios[np.isfinite(ratios)]
    if not len(ratios):
        return None
    off = SURE * np.sqrt(len(ratios)) / 2  # places in order: the interval of a median
    low, high = np.interp([len(ratios) / 2 - off, len(ratios) / 2 + off], np.arange(len(ratios)), np.sort(ratios))
    return float(np.median(ratios)) if low > most or high < 1 / most else None


def is_reversed(levels: NDArray[np.float64]) -> bool:
    """Tell whether what is red in one picture is blue in the other, by the levels (2, N, 4) of points that both show.

    Another white balance changes all points alike, and keeps their order; noise of what is grey has none.
    """
    tints = (levels[..., 1] + 1) / (levels[..., 3] + 1)
    is_coloured = tints.shape[1] >= FEWEST_TINTS and np.ptp(tints, axis=1).all()
    return bool(is_coloured and spearmanr(*tints).statistic < LOWEST_TINT)


def exposure_warnings(sensor_id: str, levels: NDArray[np.float64]) -> Iterator[str]:
    """Say that left and right are unlike bright or of other colours, by levels (2, N, 4) at matches that agree."""
    brightness, *colours = level_ratios(levels).T
    ratio = unlike(brightness, MAX_LEFT_TO_RIGHT)
    if ratio is not None:
        yield (
            f"sensor {sensor_id}: the left pictures are {ratio:.2f} times as bright as the right ones at matched "
            "points; use the same exposure and gain"
        )
    if is_reversed(levels):
        yield (
            f"sensor {sensor_id}: what is red in the left pictures is blue in the right ones: one camera's order of "
            "red, green and blue is reversed; write both alike"
        )
        return
    apart = {
        name: ratio
        for name, colour in zip(COLOURS, colours, strict=True)
        if (ratio := unlike(np.maximum(colour / brightness, brightness / colour), MAX_COLOUR)) is not None
    }
    if apart:
        told = " and ".join(f"{ratio:.2f} times in {name}" for name, ratio in apart.items())
        yield (
            f"sensor {sensor_id}: for their brightness, matched points differ {told} between the left and the right "
            "pictures (median); use the same white balance"
        )


def _later_frames(folder: Path, pattern: str, n_frames: int) -> Sequence[int]:
    if not is_video(pattern):
        return frames_after(folder, pattern, n_frames - 1)
    try:
        return range(n_frames, len(video_times(folder / pattern)))
    except CaptureError:  # listed already, as its pictures cannot be read
        return ()


def _still(by_frame: Mapping[int, Glance]) -> Iterator[tuple[int, int, bool]]:
    """Yield runs of equal pictures: first frame, last frame, and whether the camera was frozen then."""
    pairs = _neighbours(by_frame)
    changes = {frame: float(np.abs(now.thumbnail - before.thumbnail).mean()) for frame, before, now in pairs}
    usual = float(np.median(list(changes.values()))) if len(changes) >= MIN_FRAMES_FOR_RATE else 0.0
    limit = min(STILL_LEVELS, STILL_SHARE * usual)
    still = [frame for frame, before, now in pairs if before.checksum == now.checksum or changes[frame] < limit]
    for run in _runs(still):
        yield run[0] - 1, run[-1], len(run) + 1 >= FROZEN_FRAMES or (len(run) == len(pairs) and len(run) > 1)


def _jumps(pattern: str, by_frame: Mapping[int, Glance]) -> Iterator[str]:
    for frame, before, now in _neighbours(by_frame):
        bright = before.thumbnail > DARK_LEVELS
        if not bright.any():
            continue
        ratio = float(np.median(now.thumbnail[bright] / before.thumbnail[bright]))
        if not 1 / MAX_JUMP < ratio < MAX_JUMP:
            yield f"{pattern}: the exposure jumps at frame {frame}, to {ratio:.2f} times that of frame {frame - 1}"


def _unlike(glances: Glances) -> Iterator[str]:
    levels = {
        pattern: float(np.median([glance.thumbnail.mean() for glance in by_frame.values()]))
        for pattern, by_frame in glances.items()
        if by_frame
    }
    if len(levels) < 2:
        return
    usual = float(np.median(list(levels.values())))
    for pattern, level in levels.items():
        if not usual / MAX_UNLIKE < max(level, 1e-3) < usual * MAX_UNLIKE:
            yield (
                f"{pattern}: is exposed unlike the other cameras, mean brightness {level:.0f} grey levels, theirs "
                f"about {usual:.0f}; use the same exposure, gain and white balance"
            )


def _neighbours(by_frame: Mapping[int, Glance]) -> list[tuple[int, Glance, Glance]]:
    return [(frame, by_frame[frame - 1], by_frame[frame]) for frame in sorted(by_frame) if frame - 1 in by_frame]


def _runs(frames: list[int]) -> list[list[int]]:
    grouped = groupby(enumerate(frames), key=lambda item: item[1] - item[0])
    return [[frame for _, frame in run] for _, run in grouped]

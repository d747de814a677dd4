"""A recording whose late sensors are put right: frames are shifted by whole ones, and resampled in time between."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.lag import Lag
from recon.capture.format import (
    CameraStream,
    Capture,
    Picture,
    SensorStream,
    depth_path,
    frame_pictures,
    image_path,
    mask_pictures,
    plate_pictures,
    read_mask,
    read_picture,
    write_capture,
)
from recon.capture.images import CaptureError, is_video, write_picture
from recon.capture.mending.files import link
from recon.capture.mending.interpolation import way_between
from recon.capture.recording import MASK
from recon.runtime.files import new_folder
from recon.runtime.workers import Progress, no_progress

SMALLEST = 0.1  # frames: less than flow gets wrong
FEWEST_FRAMES = 2
UNKNOWN = Lag(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Schedule:
    """Which instants of each sensor's recording make the new frames.

    Parameters
    ----------
    late : frames by which each sensor is behind the common clock
    first, n_frames : of the common clock, that all sensors show
    """

    late: Mapping[str, float]
    first: int
    n_frames: int

    def instant(self, sensor_id: str, frame: int) -> tuple[int, float]:
        """Return the frame of a sensor's recording, and the share of the way to the next, that make a new frame."""
        instant = self.first + frame + self.late.get(sensor_id, 0.0)
        whole = int(np.floor(instant))
        return whole, instant - whole


def schedule(capture: Capture, lags: Mapping[tuple[str, str], Lag]) -> Schedule:
    """Choose the clock on which the fewest sensors must be resampled, and the frames that all have.

    Parameters
    ----------
    capture : the recording
    lags : how late the second of two neighbours is; two of whom nothing is known stay as they are to each other

    Raises
    ------
    CaptureError
        If no sensor is known to be late, one is later than the search goes, or the sensors have hardly a frame in
        common.
    """
    late = {capture.sensors[0].id: 0.0}
    for pair in pairwise(stream.id for stream in capture.sensors):
        lag = lags.get(pair, UNKNOWN)
        if lag.is_late and lag.is_beyond:
            raise CaptureError(
                f"{capture.folder}: how late {pair[1]} is to {pair[0]} is not known, but {abs(lag.frames):.2f} frames "
                "or more; shift one by whole frames, then check again"
            )
        late[pair[1]] = late[pair[0]] + (lag.frames if lag.is_late else 0.0)
    if not any(late.values()):
        if unknown := next((pair for pair in pairwise(late) if pair not in lags), None):
            raise CaptureError(
                f"{capture.folder}: how late {unknown[1]} is behind {unknown[0]} is not known; masks of at least 13 "
                "frames, of an object that moves unevenly, tell it"
            )
        raise CaptureError(f"{capture.folder}: no sensor is late; there is nothing to resample")
    clock = max(late.values(), key=lambda at: sum(_snapped(other - at).is_integer() for other in late.values()))
    late = {name: _snapped(value - clock) for name, value in late.items()}
    begin = int(np.ceil(max(0.0, *(-value for value in late.values()))))
    n_frames = int(np.floor(capture.n_frames - 1 - max(0.0, *late.values()))) - begin + 1
    if n_frames < FEWEST_FRAMES:
        raise CaptureError(f"{capture.folder}: its sensors have {max(n_frames, 0)} instants in common")
    return Schedule(late, begin, n_frames)


def moved(capture: Capture, lags: Mapping[tuple[str, str], Lag]) -> Iterator[str]:
    """Say by how much each sensor is moved against its neighbour, and how far off that may be, or that it is not."""
    for first, second in pairwise(capture.sensors):
        lag = lags.get((first.id, second.id))
        if lag is None:
            yield f"{second.id} stays as it is to {first.id}: how late it is could not be checked"
        elif lag.is_late:
            left = max(lag.high - lag.frames, lag.frames - lag.low)
            whole = "; of a sensor with depth maps, by the nearest whole frames" if first.depth or second.depth else ""
            yield f"{second.id} is moved by {lag.frames:.2f} frames against {first.id}, give or take {left:.2f}{whole}"


def _snapped(late: float) -> float:
    """Return a lag that is nearly a whole number of frames as this number."""
    return float(round(late)) if abs(late - round(late)) < SMALLEST else round(late, 3)


def resample(
    capture: Capture, lags: Mapping[tuple[str, str], Lag], out: Path, *, progress: Progress = no_progress
) -> Capture:
    """Write a recording anew, in which all sensors show the same instants.

    Whole frames are the same files (links where the disk allows them); a picture between two frames is made of both,
    and its mask with it. Depth maps are shifted by whole frames only, and their pictures with them.

    Parameters
    ----------
    capture : the recording
    lags : how late the second of two neighbours is
    out : the folder, absent or empty
    progress : told after each frame of a sensor
    """
    plan = schedule(capture, lags)
    with new_folder(out) as folder:
        sensors = tuple(_resampled(capture, stream, plan, folder, progress) for stream in capture.sensors)
        held_out = tuple(
            replace(shot, image=f"held_out/{number:04d}{Path(shot.image).suffix}", frame=shot.frame - plan.first)
            for number, shot in enumerate(capture.held_out)
            if 0 <= shot.frame - plan.first < plan.n_frames
        )
        for shot in held_out:
            before = capture.held_out[int(Path(shot.image).stem)]
            link(image_path(capture.folder, before.image, before.frame), folder / shot.image)
        made = replace(capture, folder=folder, n_frames=plan.n_frames, sensors=sensors, held_out=held_out)
        write_capture(made)
    return replace(made, folder=out)


def _resampled(capture: Capture, stream: SensorStream, plan: Schedule, out: Path, progress: Progress) -> SensorStream:
    """Write a sensor's frames."""
    instants = [plan.instant(stream.id, frame) for frame in range(plan.n_frames)]
    if stream.depth is not None:
        instants = [(int(np.floor(frame + share + 0.5)), 0.0) for frame, share in instants]  # halves all one way
        depth = replace(stream.depth, image=f"{stream.id}/depth/{{frame:04d}}{Path(stream.depth.image).suffix}")
    else:
        depth = None
    is_copied = all(share == 0 for _, share in instants) and not any(is_video(each.image) for each in stream.cameras)
    names = {
        side: f"{stream.id}/{side}/{{frame:04d}}{Path(camera.image).suffix.lower() if is_copied else '.png'}"
        for side, camera in zip(stream.sides, stream.cameras, strict=True)
    }
    masks = {side: MASK.format(sensor=stream.id, side=side) for side in stream.sides} if stream.mask else {}
    for frame, (whole, share) in enumerate(instants):
        for place, side in enumerate(stream.sides):
            targets = image_path(out, names[side], frame), image_path(out, masks[side], frame) if masks else None
            _write_instant(capture, stream, place, (whole, share), targets)
        if stream.depth is not None and depth is not None:
            link(depth_path(capture.folder, stream.depth, whole), image_path(out, depth.image, frame))
        progress(f"Resampling {stream.id}", frame + 1, plan.n_frames)
    plates = [(picture.path, f"{stream.id}/{side}/plate{picture.path.suffix}")
              for side, picture in zip(stream.sides, plate_pictures(capture.folder, stream), strict=False)]  # fmt: skip
    for source, name in plates:
        link(source, out / name)
    left, *right = (CameraStream(camera.camera, names[side]) for side, camera in zip(stream.sides, stream.cameras,
                                                                                      strict=True))  # fmt: skip
    return replace(
        stream, left=left, right=right[0] if right else None, depth=depth,
        plate=tuple(name for _, name in plates) or None, mask=tuple(masks.values()) or None,
    )  # fmt: skip


def _write_instant(
    capture: Capture, stream: SensorStream, place: int, instant: tuple[int, float], targets: tuple[Path, Path | None]
) -> None:
    """Write a camera's picture, and its mask, of an instant of its recording."""
    whole, share = instant
    target, mask_target = targets
    frames = (whole, whole + 1) if share else (whole,)
    pictures = [frame_pictures(capture.folder, stream, frame)[place] for frame in frames]
    masks = [mask_pictures(capture.folder, stream, frame)[place] for frame in frames] if mask_target else []
    if not share:
        for picture, path in zip((*pictures, *masks), (target, mask_target), strict=False):
            if path is not None:
                _take(picture, path)
        return
    first, second = map(read_picture, pictures)
    way = way_between(first, second, share)
    _write(target, way.picture(first, second))
    if mask_target:
        _write(mask_target, np.where(way.mask(*map(read_mask, masks)), np.uint8(255), np.uint8(0)))


def _take(picture: Picture, target: Path) -> None:
    if picture.path.suffix.lower() == target.suffix:
        link(picture.path, target)
    else:
        _write(target, read_picture(picture))


def _write(path: Path, picture: NDArray[np.uint8]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_picture(path, picture)

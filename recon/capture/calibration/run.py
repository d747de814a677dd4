"""Calibration from folders or videos of a board: the calibration file, its report and its drawings.

Pictures of the same instant have the same name in every camera's folder, or the same number in every camera's video.
Beside the file, `<its name>_report/` holds
`report.json`, `corners/<sensor>/<side>/<image>.jpg` and `rectified/<sensor>.jpg`, a pair with epipolar lines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.calibration.board import Board, Corners
from recon.capture.calibration.solve import (
    CameraCalibration,
    PairCalibration,
    calibrate_camera,
    calibrate_pair,
    calibrate_rig,
)
from recon.capture.images import (
    PICTURE_SUFFIXES,
    VIDEO_SUFFIXES,
    CaptureError,
    is_video,
    read_image,
    read_video_frame,
    video_times,
    write_picture,
)
from recon.capture.importing.opencv import SUFFIXES, write_calibration
from recon.capture.pictures import by_number, common_rate, images_in, recordings_named
from recon.capture.recording import SIDES, check_sensor_id, evenly_chosen
from recon.geometry.rig import Rig, Sensor
from recon.runtime.files import check_exists, check_suffix, new_folder, write_json
from recon.runtime.workers import Progress, no_progress

SCHEMA_VERSION = 1
GREEN = (60, 200, 60)
N_LINES = 16
DOT_PX = 4
MAX_VIDEO_FRAMES = 90  # that are looked at, evenly over the video: neighbours show the board alike


@dataclass(frozen=True)
class _Shot:
    """A picture of the board: an image, or a frame of a video."""

    path: Path
    frame: int | None = None

    def read(self) -> NDArray[np.uint8]:
        return read_image(self.path) if self.frame is None else read_video_frame(self.path, self.frame)

    def __str__(self) -> str:
        return str(self.path) if self.frame is None else f"{self.path}, frame {self.frame}"


@dataclass(frozen=True, eq=False)
class _Camera:
    """One camera's recording: the pictures' size, the corners in them, and why others were rejected."""

    size: tuple[int, int]
    shots: dict[str, _Shot]
    views: dict[str, Corners]
    rejected: dict[str, str]


@dataclass(frozen=True, eq=False)
class CalibrationReport:
    """A calibrated rig and how well it fits.

    Parameters
    ----------
    pairs : every sensor, with the errors of every image
    rejected : the reason for every image that was not used, by its path
    """

    pairs: tuple[PairCalibration, ...]
    rejected: dict[str, str]

    @property
    def rig(self) -> Rig:
        """Return all sensors in one world."""
        return Rig(tuple(pair.sensor for pair in self.pairs))

    def as_json(self) -> dict[str, Any]:
        """Return the report as a JSON object."""
        return {
            "schema_version": SCHEMA_VERSION,
            "sensors": [_sensor_json(pair) for pair in self.pairs],
            "rejected": self.rejected,
        }

    def as_text(self) -> str:
        """Say one line for every camera, sensor and rejected image."""
        lines = []
        for pair in self.pairs:
            lines += [_camera_line(camera) for camera in pair.cameras]
            errors = np.sqrt(np.mean(np.square(list(pair.errors.values()))))
            lines.append(
                f"{pair.sensor.id}: baseline {pair.sensor.baseline:.2f} mm, {len(pair.errors)} shared instants, "
                f"reprojection error {errors:.3f} px"
            )
        return "\n".join([*lines, *(f"rejected {path}: {reason}" for path, reason in self.rejected.items())])


def calibrate_folders(
    sources: Sequence[Path], board: Board, out: Path, *, replaces: bool = False, progress: Progress = no_progress
) -> CalibrationReport:
    """Calibrate all sensors of a rig and write the OpenCV file and its report.

    Parameters
    ----------
    sources : one folder with `left` and `right` (folders of images, or videos `left.mp4`), or with a folder of these
        for every sensor; or the cameras' folders or videos themselves, left and right of each sensor in turn
    board : the board in the pictures
    out : the calibration file; its report is the folder `<its name>_report` beside it
    replaces : whether it takes the place of an earlier calibration and its report, once it is made
    progress : told after each picture

    Raises
    ------
    CaptureError
        If pictures are missing or cannot be used, with the reason for each, or videos have different rates, or there
        is a calibration that may not be replaced; nothing is written then.
    """
    check_suffix(out, SUFFIXES)
    report_folder = out.with_name(f"{out.stem}_report")
    for made in (out, report_folder):
        if made.exists() and not replaces:
            raise CaptureError(f"{made}: exists already; name another file, or let it be replaced (--replace)")
    folders = _camera_folders(sources)
    n_cameras, n_frames = 2 * len(folders), _shared_frames(folders)
    cameras: dict[str, tuple[_Camera, _Camera]] = {}
    for number, (name, pair) in enumerate(folders.items()):
        left = _look(pair[0], board, n_frames)
        progress("Finding corners", 2 * number + 1, n_cameras)
        cameras[name] = (left, _look(pair[1], board, n_frames))
        progress("Finding corners", 2 * number + 2, n_cameras)
    views = {name: (left.views, right.views) for name, (left, right) in cameras.items()}
    pairs = calibrate_rig(board, [_pair(name, board, pair) for name, pair in cameras.items()], views)
    report = CalibrationReport(pairs, _rejected(cameras, pairs))
    with new_folder(report_folder, replaces=replaces) as folder:
        write_json(folder / "report.json", report.as_json())
        for calibrated in report.pairs:
            _draw(folder, calibrated, cameras[calibrated.sensor.id])
        write_calibration(out, report.rig)
    return report


def _camera_folders(sources: Sequence[Path]) -> dict[str, tuple[Path, Path]]:
    for source in sources:
        check_exists(source)
    if len(sources) == 1:
        base = sources[0]
        if sides := _sides(base):
            return {"S1": sides}
        below = sorted((path for path in base.glob("*") if path.is_dir()), key=by_number)
        inside = {path.name: _sides(path) for path in below}
        sensors = {name: sides for name, sides in inside.items() if sides}
        if not sensors:
            raise CaptureError(f"{base}: holds neither left and right nor folders with left and right in them")
        for name in sensors:
            check_sensor_id(name)
        return sensors
    if len(sources) % 2:
        raise CaptureError(
            f"{len(sources)} folders, expected one with all cameras or a left and a right one per sensor"
        )
    return {f"S{i // 2 + 1}": (sources[i], sources[i + 1]) for i in range(0, len(sources), 2)}


def _sides(folder: Path) -> tuple[Path, Path] | None:
    """Return the recordings of a sensor's cameras, folders or videos, or None if one is missing."""
    recordings = []
    for side in SIDES:
        recordings += recordings_named(folder / side, VIDEO_SUFFIXES)[:1]
    return (recordings[0], recordings[1]) if len(recordings) == len(SIDES) else None


def _shared_frames(folders: Mapping[str, tuple[Path, Path]]) -> int:
    """Return how many frames all videos have, 0 without videos; a CaptureError if their rates differ."""
    videos = {str(source): source for pair in folders.values() for source in pair if is_video(source)}
    if not videos:
        return 0
    common_rate(videos)
    return min(len(video_times(video)) for video in videos.values())


def _shots(source: Path, n_frames: int) -> dict[str, _Shot]:
    if is_video(source):
        frames = evenly_chosen(n_frames, MAX_VIDEO_FRAMES)
        return {f"{frame:06d}": _Shot(source, frame) for frame in frames}
    return {path.stem: _Shot(path) for path in images_in(source)}


def _look(source: Path, board: Board, n_frames: int) -> _Camera:
    shots = _shots(source, n_frames)
    if not shots:
        raise CaptureError(f"{source}: holds no images ({', '.join(PICTURE_SUFFIXES)})")
    views, rejected, size = dict[str, Corners](), dict[str, str](), (0, 0)
    for name, shot in shots.items():
        picture = shot.read()
        size = size if any(size) else (picture.shape[1], picture.shape[0])
        try:
            if size != (picture.shape[1], picture.shape[0]):
                raise CaptureError(
                    f"is {picture.shape[1]}x{picture.shape[0]} pixels, the first one {size[0]}x{size[1]}"
                )
            views[name] = board.find(np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), dtype=np.uint8))
        except CaptureError as error:
            rejected[name] = str(error)
    return _Camera(size, shots, views, rejected)


def _pair(sensor_id: str, board: Board, cameras: tuple[_Camera, _Camera]) -> PairCalibration:
    calibrated = []
    for camera, side in zip(cameras, SIDES, strict=True):
        try:
            calibrated.append(calibrate_camera(f"{sensor_id}/{side}", board, camera.size, camera.views))
        except CaptureError as error:
            reasons = "".join(f"; {camera.shots[name]}: {reason}" for name, reason in camera.rejected.items())
            raise CaptureError(f"{error}{reasons}") from error
    return calibrate_pair(sensor_id, board, (calibrated[0], calibrated[1]), (cameras[0].views, cameras[1].views))


def _rejected(cameras: Mapping[str, tuple[_Camera, _Camera]], pairs: Sequence[PairCalibration]) -> dict[str, str]:
    reasons = {}
    for pair in pairs:
        for recorded, calibrated in zip(cameras[pair.sensor.id], pair.cameras, strict=True):
            for name, reason in {**recorded.rejected, **calibrated.rejected}.items():
                reasons[str(recorded.shots[name])] = reason
    return reasons


def _camera_line(camera: CameraCalibration) -> str:
    worst = max(camera.errors, key=camera.errors.__getitem__)
    return (
        f"{camera.name}: focal length {camera.K[0, 0]:.2f} px (known to {camera.focal_deviation:.2%}), reprojection "
        f"error {camera.error_px:.3f} px on {len(camera.errors)} images, worst {worst}: {camera.errors[worst]:.3f} px"
    )


def _sensor_json(pair: PairCalibration) -> dict[str, Any]:
    sensor = pair.sensor
    sides = {
        side: {
            "K": getattr(sensor, side).K.tolist(),
            "dist": getattr(sensor, side).dist.tolist(),
            "cam_from_world": getattr(sensor, side).cam_from_world.tolist(),
            "error_px": camera.error_px,
            "focal_deviation": camera.focal_deviation,
            "images": camera.errors,
        }
        for side, camera in zip(SIDES, pair.cameras, strict=True)
    }
    pair_errors = {name: list(errors) for name, errors in pair.errors.items()}
    return {"id": sensor.id, "baseline_mm": sensor.baseline, **sides, "pair_errors_px": pair_errors}


def _draw(folder: Path, pair: PairCalibration, cameras: tuple[_Camera, _Camera]) -> None:
    for camera, side in zip(cameras, SIDES, strict=True):
        for name, corners in camera.views.items():
            picture = camera.shots[name].read()
            for x, y in corners.pixels:
                cv2.circle(picture, (round(x), round(y)), DOT_PX, GREEN, 1, cv2.LINE_AA)
            write_picture(folder / f"corners/{pair.sensor.id}/{side}/{name}.jpg", picture)
    fullest = max(pair.errors, key=lambda name: len(cameras[0].views[name]))
    pictures = [camera.shots[fullest].read() for camera in cameras]
    write_picture(folder / f"rectified/{pair.sensor.id}.jpg", _rectified(pair.sensor, pictures))


def _rectified(sensor: Sensor, pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Put both pictures side by side, with lines on which matching points have to lie."""
    left, right = sensor.left, sensor.right
    relative = sensor.right_from_left
    turns = cv2.stereoRectify(
        left.K, left.dist, right.K, right.dist, left.size, relative[:3, :3], relative[:3, 3:], alpha=0
    )[:4]
    warped = []
    for camera, turn, projection, picture in zip((left, right), turns[:2], turns[2:], pictures, strict=True):
        maps = cv2.initUndistortRectifyMap(camera.K, camera.dist, turn, projection, camera.size, cv2.CV_32FC1)
        warped.append(cv2.remap(picture, *maps, cv2.INTER_LINEAR))
    both = np.hstack(warped)
    for row in np.linspace(0, both.shape[0] - 1, N_LINES + 2)[1:-1]:
        cv2.line(both, (0, round(row)), (both.shape[1] - 1, round(row)), GREEN, 1)
    return np.asarray(both, dtype=np.uint8)

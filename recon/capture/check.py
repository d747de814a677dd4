"""Everything that is wrong with a capture, in one go, and what accuracy its geometry promises."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import (
    Capture,
    CaptureError,
    SensorStream,
    expected_pictures,
    frame_pictures,
    mask_pictures,
    read_draft,
    read_mask,
    read_picture,
)
from recon.capture.rectify import Rectification, rectify, rectify_images, rectify_masks
from recon.capture.schema import Draft
from recon.rig import Camera, bounds_corners

SCHEMA_VERSION = 1
MAX_VERTICAL_ERROR_PX = 1.0  # above, matching along rows fails; good calibrations reach 0.1 to 0.3
MIN_MATCHES = 20  # fewer say nothing about a calibration
MAX_RATIO = 0.8  # Lowe, "Distinctive image features from scale-invariant keypoints", 2004, section 7.1
MAX_FEATURES = 4000
MEASURED_FRAMES = 3  # first, middle, last


@dataclass(frozen=True)
class Rows:
    """How well matched points of a rectified pair lie in the same row.

    Parameters
    ----------
    n_matches : number of matched points
    vertical_error_px : median of |row left - row right|, None without matches
    disparity_px : median disparity, None without matches
    """

    n_matches: int
    vertical_error_px: float | None
    disparity_px: float | None


@dataclass(frozen=True)
class SensorReport:
    """One sensor's geometry; what could not be found out is None.

    Parameters
    ----------
    rectified_size : (width, height), pixels
    depth_per_disparity_mm : mm of depth per pixel of disparity at the centre of the bounds
    mask_coverage : share of foreground pixels, mean over all frames, (left, right)
    """

    id: str
    baseline_mm: float
    rectified_size: tuple[int, int] | None = None
    n_disparities: int | None = None
    depth_per_disparity_mm: float | None = None
    rows: Rows | None = None
    mask_coverage: tuple[float, float] | None = None


@dataclass(frozen=True)
class CheckReport:
    """What `check_capture` found: the sound sensors' figures and one sentence for every problem."""

    folder: str
    n_frames: int | None
    sensors: tuple[SensorReport, ...]
    problems: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """The report as a JSON object."""
        return {"schema_version": SCHEMA_VERSION, **asdict(self)}

    def as_text(self) -> str:
        """One line for each sensor; the problems are left to the caller."""
        return "\n".join(_sensor_line(sensor) for sensor in self.sensors)


def check_capture(capture_folder: Path) -> CheckReport:
    """Read all of a capture and list everything that is wrong with it."""
    draft = read_draft(capture_folder)
    problems = [*draft.problems, *_picture_problems(capture_folder, draft)]
    reports = []
    for stream in draft.sensors:
        report, found = _check_sensor(capture_folder, draft, stream)
        reports.append(report)
        problems += found
    return CheckReport(str(capture_folder), draft.n_frames, tuple(reports), tuple(problems))


def vertical_errors(capture: Capture) -> dict[str, Rows]:
    """How well each sensor's calibration fits its pictures, by its id, measured on matched points of the object.

    Raises
    ------
    ValueError
        If a picture cannot be read, or a sensor cannot be rectified.
    """
    frames = _measured_frames(capture.n_frames)
    return {
        stream.id: _rows(
            [
                _frame_matches(capture.folder, stream, frame, rectify(stream.sensor, capture.bounds), capture.bounds)
                for frame in frames
            ]
        )
        for stream in capture.sensors
    }


def matched_rows(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    left_mask: NDArray[np.bool_],
    right_mask: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Matched points of a rectified pair: (N, 2) row difference and disparity, pixels.

    SIFT features whose descriptors are mutually nearest and clearly nearer than the second nearest. No match is
    dropped for its position, so that a wrong calibration shows.

    Parameters
    ----------
    left, right : uint8 (H, W, 3)
    left_mask, right_mask : bool (H, W), where features may lie
    """
    sift = cv2.SIFT.create(nfeatures=MAX_FEATURES)
    points, descriptors = zip(
        *(_features(sift, image, mask) for image, mask in ((left, left_mask), (right, right_mask))), strict=True
    )
    if min(len(points[0]), len(points[1])) < 2:
        return np.zeros((0, 2))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(descriptors[1], descriptors[0])}
    kept = [
        (first.queryIdx, first.trainIdx)
        for first, second in matcher.knnMatch(descriptors[0], descriptors[1], k=2)
        if first.distance < MAX_RATIO * second.distance and back[first.trainIdx] == first.queryIdx
    ]
    pairs = np.array(kept, dtype=np.intp).reshape(-1, 2)
    difference = points[0][pairs[:, 0]] - points[1][pairs[:, 1]]
    return np.asarray(difference[:, ::-1])


def _features(
    sift: Any, image: NDArray[np.uint8], mask: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found, descriptors = sift.detectAndCompute(grey, mask.astype(np.uint8))
    return np.array([feature.pt for feature in found], dtype=np.float64).reshape(-1, 2), descriptors


def _sensor_line(sensor: SensorReport) -> str:
    parts = [f"{sensor.id}: baseline {sensor.baseline_mm:.2f} mm"]
    if sensor.rectified_size is not None:
        width, height = sensor.rectified_size
        parts.append(f"rectified {width}x{height}, {sensor.n_disparities} disparities")
        parts.append(f"{sensor.depth_per_disparity_mm:.2f} mm of depth per pixel of disparity")
    if sensor.rows is not None and sensor.rows.vertical_error_px is not None:
        parts.append(
            f"median vertical error {sensor.rows.vertical_error_px:.3f} px on {sensor.rows.n_matches} matched points"
        )
    if sensor.mask_coverage is not None:
        parts.append("masks cover {:.1%} and {:.1%}".format(*sensor.mask_coverage))
    return ", ".join(parts)


def _picture_problems(folder: Path, draft: Draft) -> Iterator[str]:
    broken: set[Path] = set()
    for picture in expected_pictures(folder, draft):
        if picture.path in broken:
            continue  # a later frame of a video fails for the same reason
        try:
            read_picture(picture)
        except CaptureError as error:
            broken.add(picture.path)
            yield str(error)


def _check_sensor(folder: Path, draft: Draft, stream: SensorStream) -> tuple[SensorReport, list[str]]:
    n_frames = draft.n_frames or 0
    report = SensorReport(stream.id, stream.sensor.baseline, mask_coverage=_mask_coverage(folder, stream, n_frames))
    problems = []
    if report.mask_coverage is not None and min(report.mask_coverage) == 0:
        problems.append(f"sensor {stream.id}: the masks of a camera are empty in all frames")
    if draft.bounds is None:
        return report, problems
    try:
        rectification = rectify(stream.sensor, draft.bounds)
    except ValueError as error:
        return report, [*problems, str(error)]
    matches = []
    for frame in _measured_frames(n_frames):
        with suppress(CaptureError):  # listed already
            matches.append(_frame_matches(folder, stream, frame, rectification, draft.bounds))
    rows = _rows(matches)
    problems += _row_problems(rectification, rows)
    depth = rectification.left.points_in_camera(draft.bounds.mean(axis=0, keepdims=True))[0, 2]
    return replace(
        report,
        rectified_size=rectification.left.size,
        n_disparities=rectification.n_disparities,
        depth_per_disparity_mm=float(depth**2 / (rectification.focal * rectification.baseline)),
        rows=rows,
    ), problems


def _mask_coverage(folder: Path, stream: SensorStream, n_frames: int) -> tuple[float, float] | None:
    shares = []
    for frame in range(n_frames):
        with suppress(CaptureError):  # listed already
            shares.append([float(read_mask(picture).mean()) for picture in mask_pictures(folder, stream, frame)])
    if stream.mask is None or not shares:
        return None
    left, right = np.mean(shares, axis=0)
    return float(left), float(right)


def _measured_frames(n_frames: int) -> list[int]:
    return sorted({round(frame) for frame in np.linspace(0, n_frames - 1, min(n_frames, MEASURED_FRAMES))})


def _frame_matches(
    folder: Path, stream: SensorStream, frame: int, rectification: Rectification, bounds: NDArray[np.float64]
) -> NDArray[np.float64]:
    pictures = rectify_images(rectification, *map(read_picture, frame_pictures(folder, stream, frame)))
    masks = tuple(map(read_mask, mask_pictures(folder, stream, frame)))
    if masks:
        areas = rectify_masks(rectification, *masks)
    else:
        areas = (_bounds_area(rectification.left, bounds), _bounds_area(rectification.right, bounds))
    return matched_rows(*pictures, *areas)


def _bounds_area(camera: Camera, bounds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where a point of the bounds can lie in a picture, bool (H, W)."""
    outline = cv2.convexHull(np.round(camera.project(bounds_corners(bounds))).astype(np.int32))
    area = np.zeros((camera.size[1], camera.size[0]), dtype=np.uint8)
    return np.asarray(cv2.fillConvexPoly(area, outline, 1) > 0)


def _rows(matches: list[NDArray[np.float64]]) -> Rows:
    found = np.concatenate(matches) if matches else np.zeros((0, 2))
    if len(found) == 0:
        return Rows(0, None, None)
    return Rows(len(found), float(np.median(np.abs(found[:, 0]))), float(np.median(found[:, 1])))


def _row_problems(rectification: Rectification, rows: Rows) -> Iterator[str]:
    if rows.n_matches < MIN_MATCHES or rows.vertical_error_px is None or rows.disparity_px is None:
        return
    place = f"sensor {rectification.sensor_id}: {rows.n_matches} matched points"
    if rows.vertical_error_px > MAX_VERTICAL_ERROR_PX:
        yield (
            f"{place} differ vertically by {rows.vertical_error_px:.2f} px after rectification (median), expected at "
            f"most {MAX_VERTICAL_ERROR_PX:g}; the calibration does not fit the pictures"
        )
    if not 0 <= rows.disparity_px < rectification.n_disparities:
        yield (
            f"{place} have a disparity of {rows.disparity_px:.1f} px (median), the bounds span 0 to "
            f"{rectification.n_disparities - 1}; the bounds, the baseline or the order of left and right are wrong"
        )

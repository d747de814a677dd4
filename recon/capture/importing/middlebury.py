"""The Middlebury multi-view benchmark's recordings as captures: neighbouring views of its rings are stereo sensors.

Convention: the calibration file lists `name K(9) R(9) t(3)` a line, row by row, world to camera, without distortion;
lengths are metres. A view's number is the one its name ends with ("templeR0013.png" is view 13).

Source: Seitz, Curless, Diebel, Scharstein, Szeliski, "A comparison and evaluation of multi-view stereo
reconstruction algorithms", CVPR 2006; README of the data sets.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.capture.format import Capture, CaptureError
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.sources import ImportOptions, Recording, SensorSource, faults_at
from recon.capture.importing.views import tell_absent
from recon.capture.pictures import Pictures
from recon.capture.recording import check_bounds
from recon.geometry.rig import Camera, bounds_corners, rigid, transformed
from recon.runtime.files import check_exists, files_like, in_any_case

TEMPLE_PAIRS = ((13, 14), (20, 21), (27, 28))  # three sensors 53 degrees apart
MM_PER_METRE = 1000.0
VALUES_PER_VIEW = 21  # K, R and t
MAX_MOTION_ERROR_PX = 0.05  # well below what matching resolves
BOUNDS_MARGIN = 0.03  # of the longest edge: the published boxes are tight
FPS = 3.0  # a slow turntable: the recordings are stills
CORNER = re.compile(r"^\s*\(\s*(\S+)\s+(\S+)\s+(\S+)\s*\)\s*$", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class _View:
    path: Path
    camera: Camera


def import_middlebury(
    source: Path,
    out: Path,
    *,
    pairs: Sequence[tuple[int, int]] = TEMPLE_PAIRS,
    n_frames: int = 3,
    bounds: ArrayLike | None = None,
    name: str | None = None,
    fps: float = FPS,
) -> Capture:
    """Turn a ring of photographs into a capture of a turning object in front of fixed stereo sensors.

    Frame k of the sensor (l, r) is the pair of views (l + k, r + k), with the calibration of (l, r). That is exact if
    the relative poses of all cameras are the same in every frame, which is checked. The views that frame 0 does not
    use are held out: they show frame 0 with their own calibration.

    Parameters
    ----------
    source : the folder of a data set, with its `*_par.txt`, or that file
    out : the capture's folder, absent or empty
    pairs : numbers of the views (left, right) of each sensor at frame 0
    bounds : float64 (2, 3), mm, or None: the box in the README beside the images, turned through all frames and
        slightly enlarged
    name : the scene's name, None for the calibration file's name without `_par.txt`

    Raises
    ------
    CaptureError
        If a file is missing or unreadable, a view is not listed, or the poses of a later frame do not fit the rig.
        Nothing is left behind.
    """
    listing = _listing(source)
    views = _read_views(listing)
    options = ImportOptions(name=name, n_frames=n_frames)
    _check_listed(listing, views, pairs, n_frames)
    motions = [_motion(views, pairs[0][0], frame) for frame in range(n_frames)]
    tight = _published_bounds(listing) if bounds is None else check_bounds(bounds)
    for frame, motion in enumerate(motions):
        _check_motion(views, pairs, frame, motion, tight)
    unused = [view for number, view in sorted(views.items()) if not any(number in pair for pair in pairs)]
    recording = Recording(
        re.sub(r"(?i)_par\.txt$", "", listing.name),
        tuple(_sensor(f"S{number}", views, pair, n_frames) for number, pair in enumerate(pairs, start=1)),
        fps=fps,
        bounds=tight if bounds is not None else _swept(tight, motions),
        held_out=tuple((view.camera, view.path) for view in unused),
    )
    return write_recording(out, recording, options)


def _listing(source: Path) -> Path:
    if source.is_file():
        return source
    check_exists(source)
    calibrations = files_like(source, "*_par.txt")
    if len(calibrations) != 1:
        raise CaptureError(f"{source}: holds {len(calibrations)} files *_par.txt, expected one calibration file")
    return calibrations[0]


def _read_views(listing: Path) -> dict[int, _View]:
    try:
        lines = [line.partition("#")[0] for line in listing.read_text(encoding="utf-8-sig").split("\n")]
    except (OSError, UnicodeDecodeError) as error:
        raise CaptureError(f"{listing}: cannot be read: {error}") from error
    first, *rows = [(number, line.split()) for number, line in enumerate(lines, start=1) if line.strip()] or [(1, [""])]
    if first[1] != [str(len(rows))] or not rows:
        told = " ".join(first[1])
        raise CaptureError(f"{listing}, line {first[0]}: announces {told!r} views, {len(rows)} lines follow")
    listed: dict[int, _View | None] = {}
    for line, row in rows:
        number, view = _read_view(listing, line, row)
        if number in listed:
            raise CaptureError(f"{listing}, line {line}: view {number} is listed twice")
        listed[number] = view
    tell_absent(listing, [row[0] for (_, row), view in zip(rows, listed.values(), strict=True) if view is None])
    return {number: view for number, view in listed.items() if view is not None}


def _read_view(listing: Path, line: int, row: list[str]) -> tuple[int, _View | None]:
    """Return a view's number, and None instead of the view whose picture is not there."""
    ending = re.search(r"(\d+)\.\w+$", row[0])
    if ending is None:
        raise CaptureError(f"{listing}, line {line}: the name {row[0]!r} does not end with the view's number")
    if len(row) != 1 + VALUES_PER_VIEW:
        raise CaptureError(
            f"{listing}, line {line}: {len(row) - 1} numbers after the name, expected {VALUES_PER_VIEW}: K, R and t"
        )
    path = in_any_case(listing.parent / row[0])
    size = Pictures((path,)).size if path.is_file() else None
    with faults_at(f"{listing}, line {line}"):
        values = np.array(row[1:], dtype=np.float64)
        pose = rigid(values[9:18].reshape(3, 3), values[18:21] * MM_PER_METRE)
        return int(ending[1]), None if size is None else _View(path, Camera(values[:9].reshape(3, 3), size, pose))


def _check_listed(listing: Path, views: Mapping[int, _View], pairs: Sequence[tuple[int, int]], n_frames: int) -> None:
    if not pairs:
        raise CaptureError("pairs is empty, expected at least one pair of views")
    missing = sorted({view + k for pair in pairs for view in pair for k in range(n_frames)} - views.keys())
    if missing:
        raise CaptureError(
            f"{listing}: {n_frames} frames of the pairs {list(pairs)} need views {missing}, which it does not list, "
            "or whose pictures are not there"
        )


def _motion(views: Mapping[int, _View], view: int, frame: int) -> NDArray[np.float64]:
    """Return how the object has moved at a frame in front of the fixed rig: world from world, 4x4."""
    fixed, moved = views[view].camera.cam_from_world, views[view + frame].camera.cam_from_world
    return np.asarray(np.linalg.inv(fixed) @ moved)


def _check_motion(
    views: Mapping[int, _View],
    pairs: Sequence[tuple[int, int]],
    frame: int,
    motion: NDArray[np.float64],
    bounds: NDArray[np.float64],
) -> None:
    corners = bounds_corners(bounds)
    moved = transformed(corners, motion)
    for view in (view for pair in pairs for view in pair):
        fixed, turned = views[view], views[view + frame]
        error = float(np.linalg.norm(fixed.camera.project(moved) - turned.camera.project(corners), axis=1).max())
        if not error < MAX_MOTION_ERROR_PX:
            raise CaptureError(
                f"{turned.path}: as frame {frame} of view {view} it is off by {error:.2f} px (tolerance "
                f"{MAX_MOTION_ERROR_PX} px), because the cameras' relative poses are not those of frame 0; take fewer "
                "frames or other pairs"
            )
        if fixed.camera.size != turned.camera.size:
            raise CaptureError(
                f"{turned.path}: is {turned.camera.size} pixels, {fixed.path.name} is {fixed.camera.size}"
            )


def _published_bounds(listing: Path) -> NDArray[np.float64]:
    for path in files_like(listing.parent, "*.txt"):
        corners = CORNER.findall(path.read_text(encoding="utf-8", errors="replace"))
        if path != listing and len(corners) == 2:
            with faults_at(path):
                return check_bounds(np.array(corners, dtype=np.float64) * MM_PER_METRE)
    raise CaptureError(f"{listing.parent}: no text file holds a bounding box, two lines of (x y z); give the bounds")


def _swept(bounds: NDArray[np.float64], motions: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    corners = bounds_corners(bounds)
    swept = np.concatenate([transformed(corners, motion) for motion in motions])
    margin = BOUNDS_MARGIN * float((bounds[1] - bounds[0]).max())
    return np.stack([swept.min(axis=0) - margin, swept.max(axis=0) + margin])


def _sensor(sensor_id: str, views: Mapping[int, _View], pair: tuple[int, int], n_frames: int) -> SensorSource:
    left, right = (Pictures(tuple(views[view + frame].path for frame in range(n_frames))) for view in pair)
    return SensorSource(sensor_id, views[pair[0]].camera, views[pair[1]].camera, (left, right))

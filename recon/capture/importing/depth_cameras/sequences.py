"""Recordings of RGB-D cameras: TUM's benchmark, and folders as those of ScanNet.

Where the camera moved, its poses are known, and the scene stood still: some frames become sensors, and frames between
them are held out. Without poses the camera stood still: it is one sensor, and its frames are the recording's.

Convention: poses are camera to world, metres, z up; pixel centres at integers.

Source: Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, and its page "File formats";
Dai et al., "ScanNet", CVPR 2017.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.depth_maps import rays, read_depth_values
from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import CAMERA_FROM_WORLD, numbers, pinhole, read_text
from recon.capture.importing.sources import DepthSource, ImportOptions, Recording, SensorSource, faults_at, turn_of
from recon.capture.importing.views import View, bounds_of_points, choose_sensors, tell_absent
from recon.capture.pictures import Pictures, images_in
from recon.capture.recording import evenly_chosen
from recon.capture.rectify import scaled_camera
from recon.geometry.rig import Camera, rigid, transformed
from recon.runtime.files import allowed, first_of, in_any_case
from recon.runtime.notices import Notice

TUM_STEP_MM = 0.2  # of a depth: 5000 to the metre
TUM_CAMERAS = {  # fx, fy, cx, cy and distortion, by a part of the sequence's name
    "freiburg1": (517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "freiburg2": (520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
INTRINSICS = ("calibration.txt", "intrinsics.txt", "camera.txt")  # of other recordings in this form
LATEST_S = 0.02  # between a picture and its depth map or pose, as the benchmark's associate.py
MOST_SENSORS = 8  # of a camera that moved, unless shots are named
SAMPLED = 16  # every so many rows and columns of depth maps tell the bounds
COLOURS, DEPTHS, POSES = ("color", "rgb", "images"), ("depth",), ("pose", "poses")
SCANNET_INTRINSICS = ("intrinsic/intrinsic_{}.txt", "intrinsics_{}.txt", "intrinsic.txt", "intrinsics.txt")
METRE = 1000.0

Convert = Callable[[NDArray[np.float32]], NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Shot:
    """An instant of an RGB-D camera: its picture, its depth map, and `cam_from_world` (4, 4), mm, if it is known."""

    name: str
    picture: Path
    depth: Path
    pose: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class DepthCamera:
    """What an RGB-D camera recorded.

    Parameters
    ----------
    camera : of the pictures, without pose
    scale_mm : length of a depth of 1
    shots : in the order of time
    depth_of, size : of its depth maps, as in `DepthSource`
    """

    camera: Camera
    scale_mm: float
    shots: Sequence[Shot]
    depth_of: Convert | None = None
    size: tuple[int, int] | None = None


def recorded(source: Path, taken: DepthCamera, options: ImportOptions, up: str = "z") -> Recording:
    """Make a recording of what a depth camera recorded.

    Parameters
    ----------
    source : for the recording's name and messages
    taken : what it recorded
    options : `shots` are names of those that become sensors, of a camera that moved
    up : axis of the poses' world that points upwards
    """
    shots = list(taken.shots)
    if not shots:
        raise CaptureError(f"{source}: holds no picture with a depth map of the same instant")
    if any(shot.pose is None for shot in shots):
        return _still(source, taken, shots)
    names = [shot.name for shot in shots]
    if unknown := [name for name in options.shots or () if name not in names]:
        raise CaptureError(f"{source}: has no shot {unknown[0]}; its shots are {names[0]} to {names[-1]}")
    chosen = [names.index(name) for name in options.shots or ()] or evenly_chosen(len(shots), MOST_SENSORS)
    between = sorted({(a + b) // 2 for a, b in pairwise(chosen)} - {*chosen})
    views = {number: _view(taken, shots[number], number in between) for number in sorted([*chosen, *between])}
    points = np.concatenate([_points(taken, shots[number]) for number in chosen])
    return choose_sensors(source, views, (), bounds_of_points(points), up)


def _view(recording: DepthCamera, shot: Shot, is_test: bool) -> View:
    assert shot.pose is not None, "the caller looked"
    with faults_at(f"shot {shot.name}"):
        camera = Camera(recording.camera.K, recording.camera.size, shot.pose, recording.camera.dist)
    return View(shot.name, camera, shot.picture, None if is_test else _depth(recording, [shot]), is_test)


def _still(source: Path, recording: DepthCamera, shots: Sequence[Shot]) -> Recording:
    """Return the recording of a camera that stood still: one sensor."""
    seen = recording.camera
    camera = Camera(seen.K, seen.size, CAMERA_FROM_WORLD, seen.dist)
    pictures = Pictures(tuple(shot.picture for shot in shots))
    sensor = SensorSource("S1", camera, None, (pictures,), _depth(recording, shots))
    placed = [Shot(shot.name, shot.picture, shot.depth, CAMERA_FROM_WORLD) for shot in shots]
    points = [_points(recording, placed[number]) for number in evenly_chosen(len(shots), MOST_SENSORS)]
    return Recording(source.resolve().stem, (sensor,), bounds=bounds_of_points(np.concatenate(points)))


def _depth(recording: DepthCamera, shots: Sequence[Shot]) -> DepthSource:
    files = tuple(shot.depth for shot in shots)
    return DepthSource(files, recording.scale_mm, size=recording.size, depth_of=recording.depth_of)


def _points(recording: DepthCamera, shot: Shot) -> NDArray[np.float64]:
    """Return some of the points that a depth map shows (N, 3), mm, in the world."""
    values = read_depth_values(allowed(shot.depth))
    values = values if recording.depth_of is None else recording.depth_of(values)
    camera = scaled_camera(recording.camera, (values.shape[1], values.shape[0]))
    seen = (rays(camera) * (values * recording.scale_mm)[..., None])[::SAMPLED, ::SAMPLED].reshape(-1, 3)
    assert shot.pose is not None, "the caller looked"
    return transformed(seen[np.isfinite(seen).all(axis=1)], np.linalg.inv(shot.pose))


def read_tum(source: Path, options: ImportOptions) -> Recording:
    """Read a sequence in the form of TUM's RGB-D benchmark: `rgb.txt`, `depth.txt`, and perhaps `groundtruth.txt`."""
    folder = source if source.is_dir() else source.parent
    pictures, depths = (_stamped(in_any_case(folder / f"{name}.txt")) for name in ("rgb", "depth"))
    truth = in_any_case(folder / "groundtruth.txt")
    poses = _stamped(truth) if truth.is_file() else {}
    if truth.is_file() and not poses:
        raise CaptureError(f"{truth}: holds no pose; remove it if the camera stood still")
    unit_mm = options.unit_mm or METRE
    shots, absent = [], []
    for stamp, words in pictures.items():
        depth, place = _nearest(depths, stamp), _nearest(poses, stamp)
        if depth is None or (poses and place is None):
            continue
        files = in_any_case(folder / words[0]), in_any_case(folder / depth[0])
        if missing := [path.name for path in files if not path.is_file()]:
            absent.append(" and ".join(missing))
            continue
        with faults_at(truth):
            pose = None if place is None else _pose(np.array(place[:7], np.float64), unit_mm)
        shots.append(Shot(Path(words[0]).stem, *files, pose))
    tell_absent(folder, absent)
    _tell_left_out(folder, len(pictures) - len(shots) - len(absent), "depth map or pose of their time")
    if not shots:
        raise CaptureError(f"{folder}: no picture in rgb.txt has a depth map within {LATEST_S} s, and a pose if any")
    camera = _tum_camera(folder, Pictures((shots[0].picture,)).size)
    return recorded(folder, DepthCamera(camera, TUM_STEP_MM, shots), options)


def _tell_left_out(folder: Path, n_pictures: int, lacking: str) -> None:
    if n_pictures > 0:
        warnings.warn(f"{folder}: without {lacking}, and left out: {n_pictures} of the pictures", Notice, stacklevel=2)


def _stamped(path: Path) -> dict[float, list[str]]:
    """Return what stands behind the time in each line of a list."""
    rows = (line.split() for line in read_text(path).splitlines() if line.partition("#")[0].strip())
    with faults_at(path):
        return {float(stamp): [first, *others] for stamp, first, *others in rows}


def _nearest(listed: dict[float, list[str]], stamp: float) -> list[str] | None:
    times = np.fromiter(listed, np.float64, len(listed))
    if not len(times):
        return None
    place = int(np.abs(times - stamp).argmin())
    return listed[float(times[place])] if abs(times[place] - stamp) <= LATEST_S else None


def _pose(values: NDArray[np.float64], unit_mm: float) -> NDArray[np.float64]:
    """Return `cam_from_world` of tx, ty, tz and a quaternion whose w is last."""
    rotation = turn_of(values[3:]).T
    return rigid(rotation, -rotation @ values[:3] * unit_mm)


def _tum_camera(folder: Path, size: tuple[int, int]) -> Camera:
    """Return the camera of a sequence: of a file beside it, else that of the benchmark by its name."""
    told = first_of(folder, INTRINSICS)
    name = next((name for name in TUM_CAMERAS if name in folder.resolve().name.lower()), None)
    if told is None and name is None:
        raise CaptureError(
            f"{folder}: nothing tells its camera; write fx fy cx cy, and k1 k2 p1 p2 k3 where it has them, into "
            f"{folder / INTRINSICS[0]}, or name the folder as the benchmark does ({', '.join(TUM_CAMERAS)})"
        )
    with faults_at(told or folder):
        values = TUM_CAMERAS[str(name)] if told is None else numbers(read_text(told)).tolist()
        return Camera(pinhole(values[:4]), size, np.eye(4), np.array(values[4:]))


def read_scannet(source: Path, options: ImportOptions) -> Recording:
    """Read folders as those of ScanNet: `color`, `depth` (mm), `pose` and `intrinsic`; each frame by its number.

    Where the depth maps have a matrix of their own, they are brought into the pictures' camera.
    """
    pictures, depths = (_folder(source, names) for names in (COLOURS, DEPTHS))
    poses = first_of(source, POSES)
    unit_mm = options.unit_mm or METRE
    shots, absent, n_unplaced = list[Shot](), list[str](), 0
    for picture in images_in(pictures):
        depth = first_of(depths, (picture.stem + suffix for suffix in (".png", ".exr", ".npy")))
        pose = None if poses is None else in_any_case(poses / f"{picture.stem}.txt")
        if depth is None or (pose is not None and not pose.is_file()):
            absent.append(f"depth or pose of {picture.name}")
            continue
        placed = None if pose is None else _matrix(pose, unit_mm)
        if placed is None or np.isfinite(placed).all():  # a frame that could not be placed has infinities
            shots.append(Shot(picture.stem, picture, depth, placed))
        else:
            n_unplaced += 1
    tell_absent(source, absent)
    _tell_left_out(source, n_unplaced, "finite pose")
    if not shots:
        raise CaptureError(f"{source}: no picture in {pictures.name} has a depth map and a pose of its number")
    K = _intrinsics(source, "color")
    with faults_at(source):
        camera = Camera(K, Pictures((shots[0].picture,)).size, np.eye(4))
    size = read_depth_values(allowed(shots[0].depth)).shape[::-1]
    of_depth = _intrinsics(source, "depth")
    is_other = not np.allclose(of_depth, K) and size != camera.size
    move = _moved(of_depth, scaled_camera(camera, (size[0], size[1])).K) if is_other else None
    given = None if size == camera.size else (size[0], size[1])
    return recorded(source, DepthCamera(camera, 1.0, shots, move, given), options)


def _folder(source: Path, names: Sequence[str]) -> Path:
    folder = first_of(source, names)
    if folder is None:
        raise CaptureError(f"{source}: holds no folder {' or '.join(names)}")
    return folder


def _intrinsics(source: Path, kind: str) -> NDArray[np.float64]:
    names = [name.format(kind) for name in SCANNET_INTRINSICS]
    path = first_of(source, names)
    if path is None:
        raise CaptureError(f"{source}: nothing tells its camera; expected {', '.join(names)}")
    with faults_at(path):
        values = numbers(read_text(path))
        return values.reshape((4, 4) if values.size == 16 else (3, 3))[:3, :3]


def _matrix(path: Path, unit_mm: float) -> NDArray[np.float64]:
    """Return `cam_from_world`, mm, of a file with the pose of a camera; not finite where it says nothing."""
    with faults_at(path):
        pose = numbers(read_text(path)).reshape(4, 4)
    if not np.isfinite(pose).all():
        return pose
    return rigid(pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3] * unit_mm)


def _moved(depth_K: NDArray[np.float64], picture_K: NDArray[np.float64]) -> Convert:
    """Return what brings a depth map into another matrix of the same camera: the nearest value, as edges stay edges."""

    def move(values: NDArray[np.float32]) -> NDArray[np.float32]:
        rows, columns = np.indices(values.shape, dtype=np.float64)
        homography = depth_K @ np.linalg.inv(picture_K)
        places = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ homography.T
        moved = cv2.remap(
            values,
            places[..., 0].astype(np.float32),
            places[..., 1].astype(np.float32),
            cv2.INTER_NEAREST,
            borderValue=float("nan"),
        )
        return np.asarray(moved, np.float32)

    return move

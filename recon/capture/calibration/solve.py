"""Calibration by pictures of a board: every camera, every stereo pair, then all sensors in one world.

Convention: without a pose of its own, the world is the first sensor's left camera turned by half a circle about x (x
right, y up), as in `recon.capture.importing.opencv`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.capture.calibration.board import Board, Corners
from recon.capture.calibration.bundle_adjustment import Poses, Sighting, adjusted, reprojection_error
from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import CAMERA_FROM_WORLD
from recon.capture.recording import SIDES
from recon.geometry.rig import Camera, Sensor, rigid

MIN_IMAGES = 6
MIN_SHARED = 6  # corners that both cameras of a pair see
MAX_ERROR_FACTOR = 3.0  # times the median of a camera's images
MIN_REJECTED_PX = 0.5  # an image with a smaller error is never rejected for it
MAX_TOGETHER_PX = 1.0  # median error with all cameras fitted together; good ones have as much as each by itself
MAX_TOGETHER_FACTOR = 5.0  # times the error of each by itself
MIN_TILT_DEG = 20.0
MAX_FOCAL_DEVIATION = 0.01  # share; a larger standard deviation means that the views are too alike
FLAGS = cv2.CALIB_FIX_K3  # one radial coefficient less: lenses of studios are mild, and k3 is ill determined
TANGENTIAL = slice(6, 8)  # p1 and p2 among OpenCV's intrinsics
MIN_SIGNIFICANCE = 3.0  # standard deviations; tangential distortion below is noise, and would move the principal point

Views = Mapping[str, Corners]
"""The corners that a camera found, by the image's name; equal names mean the same instant."""


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """One camera by itself.

    Parameters
    ----------
    K, dist : float64 (3, 3) and (5,)
    boards : `camera_from_board` 4x4 of every image that is used
    errors : root mean square reprojection error of every image that is used, pixels
    focal_deviation : standard deviation of the focal length, share
    tilt_deg : largest angle between two views' boards; without tilt the focal length cannot be told from the distance
    """

    name: str
    size: tuple[int, int]
    K: NDArray[np.float64]
    dist: NDArray[np.float64]
    boards: Poses
    errors: dict[str, float]
    focal_deviation: float
    tilt_deg: float
    rejected: dict[str, str]

    @property
    def error_px(self) -> float:
        """Root mean square reprojection error over all images, pixels."""
        return float(np.sqrt(np.mean(np.square(list(self.errors.values())))))


@dataclass(frozen=True, eq=False)
class PairCalibration:
    """A stereo sensor.

    Parameters
    ----------
    boards : `left_from_board` 4x4 of every instant that a camera sees
    errors : root mean square reprojection error (left, right) of every instant that both see, pixels
    """

    sensor: Sensor
    cameras: tuple[CameraCalibration, CameraCalibration]
    boards: Poses
    errors: dict[str, tuple[float, float]]


def calibrate_camera(name: str, board: Board, size: tuple[int, int], views: Views) -> CameraCalibration:
    """Calibrate one camera's intrinsics; images whose error is far above the others' are rejected.

    Parameters
    ----------
    name : of the camera, for messages
    board : the board in the images
    size : (width, height), pixels
    views : corners by image

    Raises
    ------
    CaptureError
        If there are too few images, or they show the board too much alike.
    """
    kept, rejected = dict(views), dict[str, str]()
    while True:
        if len(kept) < MIN_IMAGES:
            raise CaptureError(f"{name}: {len(kept)} usable images of the board, expected at least {MIN_IMAGES}")
        fit = _solve(name, board, size, kept)
        median = float(np.median(list(fit.errors.values())))
        worst = max(fit.errors, key=fit.errors.__getitem__)
        if fit.errors[worst] <= max(MIN_REJECTED_PX, MAX_ERROR_FACTOR * median):
            break
        rejected[worst] = f"its reprojection error is {fit.errors[worst]:.2f} px, the others' {median:.2f} px"
        del kept[worst]
    if fit.tilt_deg < MIN_TILT_DEG or not fit.focal_deviation < MAX_FOCAL_DEVIATION:
        raise CaptureError(
            f"{name}: the views are too alike: they differ in tilt by {fit.tilt_deg:.0f} degrees, the focal length "
            f"is known to {fit.focal_deviation:.1%}; tilt the board by 20 to 45 degrees in all directions, near and "
            "far, and into the corners of the picture"
        )
    return replace(fit, rejected=rejected)


def _solve(name: str, board: Board, size: tuple[int, int], views: Views) -> CameraCalibration:
    """Fit the camera that all views make likeliest, without tangential distortion where it is not significant."""
    objects = [board.points[corners.ids].astype(np.float32) for corners in views.values()]
    images = [corners.pixels.astype(np.float32) for corners in views.values()]
    for flags in (FLAGS, FLAGS | cv2.CALIB_ZERO_TANGENT_DIST):
        try:
            _, K, dist, turns, shifts, deviations, _, errors = cv2.calibrateCameraExtended(
                objects, images, size, np.eye(3), np.zeros(5), flags=flags
            )
        except cv2.error as error:
            raise CaptureError(f"{name}: cannot be calibrated: {error.err}") from error
        significance = np.abs(np.ravel(dist)[2:4]) / np.maximum(np.ravel(deviations)[TANGENTIAL], 1e-12)
        if significance.max() > MIN_SIGNIFICANCE:
            break
    poses = [rigid(cv2.Rodrigues(turn)[0], np.ravel(shift)) for turn, shift in zip(turns, shifts, strict=True)]
    return CameraCalibration(
        name,
        size,
        K,
        np.ravel(dist)[:5],
        dict(zip(views, poses, strict=True)),
        dict(zip(views, map(float, np.ravel(errors)), strict=True)),
        focal_deviation=float(deviations[0, 0] / K[0, 0]),
        tilt_deg=_tilt(poses),
        rejected={},
    )


def _tilt(boards: Sequence[NDArray[np.float64]]) -> float:
    """Return the largest angle between the normals of two boards, degrees."""
    normals = np.array([pose[:3, 2] for pose in boards])
    return float(np.rad2deg(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0))))


def calibrate_pair(
    sensor_id: str, board: Board, cameras: tuple[CameraCalibration, CameraCalibration], views: tuple[Views, Views]
) -> PairCalibration:
    """Calibrate a stereo sensor: its two cameras, refined together on all their images.

    Parameters
    ----------
    sensor_id : for messages
    board : the board in the images
    cameras : left and right, each calibrated by itself
    views : corners by image, left and right

    Raises
    ------
    CaptureError
        If they share too few instants, or do not show the same ones.
    """
    first, second = cameras
    shared = [
        name
        for name in first.boards
        if name in second.boards and len(np.intersect1d(views[0][name].ids, views[1][name].ids)) >= MIN_SHARED
    ]
    if len(shared) < MIN_IMAGES:
        raise CaptureError(
            f"sensor {sensor_id}: {len(shared)} instants show the board to both cameras, expected at least "
            f"{MIN_IMAGES}; images belong together by their names"
        )
    right_from_left = _mean_pose([second.boards[name] @ np.linalg.inv(first.boards[name]) for name in shared])
    boards = {name: np.linalg.inv(right_from_left) @ pose for name, pose in second.boards.items()} | first.boards
    left = Camera(first.K, first.size, np.eye(4), first.dist)
    right = Camera(second.K, second.size, right_from_left, second.dist)
    unrefined = PairCalibration(Sensor(sensor_id, left, right), cameras, boards, dict.fromkeys(shared, (0.0, 0.0)))
    (refined,) = _refined(board, [unrefined], {sensor_id: views}, {sensor_id: np.eye(4)}, boards)
    return refined


def calibrate_rig(
    board: Board, pairs: Sequence[PairCalibration], views: Mapping[str, tuple[Views, Views]]
) -> tuple[PairCalibration, ...]:
    """Chain sensors into one world by the instants they share, then refine all together; returns the errors left, too.

    Parameters
    ----------
    board : the board in the images
    pairs : the sensors, each calibrated by itself
    views : corners by image, left and right, of every sensor

    Raises
    ------
    CaptureError
        If a sensor shares no instant with those that are placed already, does not show the same ones, or the board has
        no first corner.
    """
    if len(pairs) > 1 and board.is_symmetric:
        raise CaptureError(
            f"the board of {board.columns}x{board.rows} corners looks the same turned by half a circle, so sensors "
            "cannot be joined by it; take one with one more or one fewer corner along one side, or a ChArUco board"
        )
    from_world = {pairs[0].sensor.id: CAMERA_FROM_WORLD}
    boards = {name: np.linalg.inv(CAMERA_FROM_WORLD) @ pose for name, pose in pairs[0].boards.items()}
    left = list(pairs[1:])
    while left:
        best = max(left, key=lambda pair: len(pair.boards.keys() & boards.keys()))
        shared = sorted(best.boards.keys() & boards.keys())
        if not shared:
            raise CaptureError(
                f"sensor {best.sensor.id}: shares no image of the board with {', '.join(from_world)}; show the board "
                "where neighbouring sensors both see it"
            )
        pose = _mean_pose([best.boards[name] @ np.linalg.inv(boards[name]) for name in shared])
        from_world[best.sensor.id] = pose
        for name, board_pose in best.boards.items():
            boards.setdefault(name, np.linalg.inv(pose) @ board_pose)
        left.remove(best)
    return _refined(board, pairs, views, from_world, boards)


def _refined(
    board: Board,
    pairs: Sequence[PairCalibration],
    views: Mapping[str, tuple[Views, Views]],
    from_world: Poses,
    boards: Poses,
) -> tuple[PairCalibration, ...]:
    """Refine the pairs, placed by `left_from_world` 4x4 of every sensor, with all boards on all that cameras saw."""
    start = {
        f"{pair.sensor.id}/{side}": _placed(getattr(pair.sensor, side), from_world[pair.sensor.id])
        for pair in pairs
        for side in SIDES
    }
    sightings = list(_sightings(board, pairs, views))
    cameras, boards = adjusted(sightings, start, boards, fixed=f"{pairs[0].sensor.id}/left")
    errors = {
        (sighting.camera, sighting.board): reprojection_error(
            sighting, cameras[sighting.camera], boards[sighting.board]
        )
        for sighting in sightings
    }
    refined = tuple(_refined_pair(pair, cameras, boards, errors) for pair in pairs)
    for pair in refined:
        _check_instants(pair)
    return refined


def _check_instants(pair: PairCalibration) -> None:
    """Raise a CaptureError if images of one name cannot be of one instant: each camera fits, but not all together."""
    together = float(np.median(list(pair.errors.values())))
    alone = max(camera.error_px for camera in pair.cameras)
    if together > max(MAX_TOGETHER_PX, MAX_TOGETHER_FACTOR * alone):
        raise CaptureError(
            f"sensor {pair.sensor.id}: corners are {together:.2f} px off with all cameras fitted together (median), "
            f"{alone:.2f} px with each by itself; images of one name must be of one instant, and no camera may move "
            "between them"
        )


def _refined_pair(
    pair: PairCalibration, cameras: Mapping[str, Camera], boards: Poses, errors: Mapping[tuple[str, str], float]
) -> PairCalibration:
    left, right = (f"{pair.sensor.id}/{side}" for side in SIDES)
    return replace(
        pair,
        sensor=Sensor(pair.sensor.id, cameras[left], cameras[right]),
        boards={name: cameras[left].cam_from_world @ boards[name] for name in pair.boards},
        errors={name: (errors[left, name], errors[right, name]) for name in pair.errors},
    )


def _sightings(
    board: Board, pairs: Sequence[PairCalibration], views: Mapping[str, tuple[Views, Views]]
) -> Iterator[Sighting]:
    """Yield the corners in all images that are used."""
    for pair in pairs:
        for side, camera, seen in zip(SIDES, pair.cameras, views[pair.sensor.id], strict=True):
            for name in camera.boards:
                points = board.points[seen[name].ids]
                yield Sighting(f"{pair.sensor.id}/{side}", name, points, seen[name].pixels)


def _mean_pose(poses: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    rotation = Rotation.from_matrix([pose[:3, :3] for pose in poses]).mean().as_matrix()
    return rigid(rotation, np.median([pose[:3, 3] for pose in poses], axis=0))


def _placed(camera: Camera, left_from_world: NDArray[np.float64]) -> Camera:
    return replace(camera, cam_from_world=camera.cam_from_world @ left_from_world)

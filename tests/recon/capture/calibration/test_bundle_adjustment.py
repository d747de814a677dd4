"""Cameras and boards, refined together."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.calibration.board import parse_board
from recon.capture.calibration.bundle_adjustment import (
    N_LENS,
    N_POSE,
    Cameras,
    Poses,
    Sighting,
    _linearised,
    _moved_camera,
    adjusted,
)
from recon.geometry.rig import Camera, rigid
from tests.recon.capture.calibration.board_pictures import board_pose, project, studio_rig

BOARD = parse_board("chessboard:6x5:90")
N_BOARDS = 8


def truth(n_sensors: int = 3) -> tuple[Cameras, Poses]:
    rng, rig = np.random.default_rng(1), studio_rig(n_sensors)
    cameras = {f"{sensor.id}/{side}": getattr(sensor, side) for sensor in rig.sensors for side in ("left", "right")}
    return cameras, {str(k): board_pose(BOARD, rng) for k in range(N_BOARDS)}


def seen_by(cameras: Cameras, boards: Poses, noise_px: float = 0.0) -> list[Sighting]:
    """Every corner of every board by all cameras."""
    rng = np.random.default_rng(2)
    found = []
    for camera_name, camera in cameras.items():
        for name, pose in boards.items():
            pixels = project(camera, BOARD.points @ pose[:3, :3].T + pose[:3, 3])
            found.append(Sighting(camera_name, name, BOARD.points, pixels + rng.normal(0, noise_px, pixels.shape)))
    return found


def shaken(pose: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    return np.asarray(rigid(cv2.Rodrigues(rng.normal(0, 0.01, 3))[0], rng.normal(0, 10, 3)) @ pose)


def misjudged(camera: Camera, rng: np.random.Generator) -> Camera:
    """Its focal length, principal point and distortion as a first estimate has them."""
    K = camera.K + np.array([[5.0, 0, 8.0], [0, 4.0, -6.0], [0, 0, 0]]) * rng.normal(1, 0.3)
    return replace(camera, K=K, dist=camera.dist + np.array([0.01, -0.02, 0, 0, 0]))


def test_cameras_and_boards_that_were_shaken_come_back() -> None:
    cameras, boards = truth()
    rng = np.random.default_rng(3)
    start = {name: misjudged(camera, rng) for name, camera in cameras.items()}
    for name in list(start)[1:]:
        start[name] = replace(start[name], cam_from_world=shaken(start[name].cam_from_world, rng))
    shaken_boards = {name: shaken(pose, rng) for name, pose in boards.items()}
    found, placed = adjusted(seen_by(cameras, boards), start, shaken_boards, fixed="S1/left")
    np.testing.assert_array_equal(found["S1/left"].cam_from_world, cameras["S1/left"].cam_from_world)
    for name, camera in found.items():
        np.testing.assert_allclose(camera.cam_from_world, cameras[name].cam_from_world, atol=1e-3)
        np.testing.assert_allclose(camera.K, cameras[name].K, atol=1e-3)
        np.testing.assert_allclose(camera.dist, cameras[name].dist, atol=1e-5)
    for name, pose in placed.items():
        np.testing.assert_allclose(pose, boards[name], atol=1e-3)


def test_tangential_distortion_that_is_zero_stays_zero_and_other_is_found() -> None:
    cameras, boards = truth(1)
    bent = cameras | {"S1/right": replace(cameras["S1/right"], dist=np.array([-0.12, 0.08, 1e-3, -5e-4, 0.0]))}
    start = bent | {"S1/right": replace(cameras["S1/right"], dist=np.array([-0.12, 0.08, 5e-4, 0.0, 0.0]))}
    found, _ = adjusted(seen_by(bent, boards, noise_px=0.01), start, boards, fixed="S1/left")
    np.testing.assert_array_equal(found["S1/left"].dist[2:], 0)
    np.testing.assert_allclose(found["S1/right"].dist[2:4], (1e-3, -5e-4), atol=1e-4)


def test_corners_that_are_wrong_hardly_count() -> None:
    cameras, boards = truth()
    sightings = seen_by(cameras, boards, noise_px=0.02)
    sightings[-1].pixels[::10] += 40.0
    found, _ = adjusted(sightings, cameras, boards, fixed="S1/left")
    turn = cv2.Rodrigues(found["S3/right"].rotation @ cameras["S3/right"].rotation.T)[0]
    assert np.rad2deg(np.linalg.norm(turn)) < 0.05


def test_derivatives_are_those_of_finite_differences() -> None:
    cameras, boards = truth(1)
    sighting = seen_by(cameras, boards)[-1]
    camera, board = cameras[sighting.camera], boards[sighting.board]
    _, by_camera, by_board = _linearised(sighting, camera, board)
    for k in range(N_POSE + N_LENS):
        step = np.zeros(N_POSE + N_LENS)
        step[k] = 1e-5 if k < 3 or k > N_POSE + 3 else 1e-3
        ahead, behind = (_linearised(sighting, _moved_camera(camera, sign * step), board)[0] for sign in (1, -1))
        np.testing.assert_allclose(by_camera[:, k], (ahead - behind) / (2 * step[k]), rtol=1e-4, atol=1e-3)
    for k in range(N_POSE):
        step = np.zeros(N_POSE)
        step[k] = 1e-5 if k < 3 else 1e-3
        ahead, behind = (
            _linearised(
                sighting, camera, rigid(cv2.Rodrigues(s * step[:3])[0] @ board[:3, :3], board[:3, 3] + s * step[3:])
            )[0]
            for s in (1, -1)
        )
        np.testing.assert_allclose(by_board[:, k], (ahead - behind) / (2 * step[k]), rtol=1e-4, atol=1e-3)

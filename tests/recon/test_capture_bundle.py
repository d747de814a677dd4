"""Poses of sensors and boards, refined together."""

from __future__ import annotations

import cv2
import numpy as np
from board_pictures import board_pose, project, studio_rig
from numpy.typing import NDArray

from recon.capture.board import parse_board
from recon.capture.bundle import Sighting, _linearised, adjusted
from recon.rig import Camera, Rig, rigid

BOARD = parse_board("chessboard:6x5:90")
N_BOARDS = 8


def seen_by(rig: Rig, boards: dict[str, NDArray[np.float64]], noise_px: float = 0.0) -> list[Sighting]:
    """Every corner of every board by all cameras, each camera placed by its sensor's left one."""
    rng = np.random.default_rng(2)
    found = []
    for sensor in rig.sensors:
        for camera in (sensor.left, sensor.right):
            relative = camera.cam_from_world @ np.linalg.inv(sensor.left.cam_from_world)
            placed = Camera(camera.K, camera.size, relative, camera.dist)
            for name, pose in boards.items():
                pixels = project(camera, BOARD.points @ pose[:3, :3].T + pose[:3, 3])
                pixels += rng.normal(0, noise_px, pixels.shape)
                found.append(Sighting(sensor.id, name, placed, BOARD.points, pixels))
    return found


def truth(n_sensors: int = 3) -> tuple[Rig, dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    rng, rig = np.random.default_rng(1), studio_rig(n_sensors)
    boards = {str(k): board_pose(BOARD, rng) for k in range(N_BOARDS)}
    return rig, {sensor.id: sensor.left.cam_from_world for sensor in rig.sensors}, boards


def shaken(pose: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    return np.asarray(rigid(cv2.Rodrigues(rng.normal(0, 0.01, 3))[0], rng.normal(0, 10, 3)) @ pose)


def test_poses_that_were_shaken_come_back() -> None:
    rig, sensors, boards = truth()
    rng = np.random.default_rng(3)
    start = {name: pose if name == "S1" else shaken(pose, rng) for name, pose in sensors.items()}
    found, placed = adjusted(seen_by(rig, boards), start, {n: shaken(p, rng) for n, p in boards.items()}, fixed="S1")
    np.testing.assert_array_equal(found["S1"], sensors["S1"])
    for poses, expected in ((found, sensors), (placed, boards)):
        for name, pose in poses.items():
            np.testing.assert_allclose(pose, expected[name], atol=1e-4)


def test_corners_that_are_wrong_hardly_count() -> None:
    rig, sensors, boards = truth()
    sightings = seen_by(rig, boards, noise_px=0.05)
    sightings[-1].pixels[::10] += 40.0
    found, _ = adjusted(sightings, sensors, boards, fixed="S1")
    turn = cv2.Rodrigues(found["S3"][:3, :3] @ sensors["S3"][:3, :3].T)[0]
    assert np.rad2deg(np.linalg.norm(turn)) < 0.01


def test_derivatives_are_those_of_finite_differences() -> None:
    rig, sensors, boards = truth(1)
    sighting = seen_by(rig, boards)[1]
    sensor, board = sensors["S1"], boards[sighting.board]
    _, by_sensor, by_board = _linearised(sighting, sensor, board)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5 if k < 3 else 1e-3
        sides = []
        for sign in (1, -1):
            turn, shift = cv2.Rodrigues(sign * step[:3])[0], sign * step[3:]
            moved_board = rigid(turn @ board[:3, :3], board[:3, 3] + shift)
            moved = _linearised(sighting, rigid(turn, shift) @ sensor, board)[0]
            sides.append((moved, _linearised(sighting, sensor, moved_board)[0]))
        for which, derivatives in enumerate((by_sensor, by_board)):
            measured = (sides[0][which] - sides[1][which]) / (2 * step[k])
            np.testing.assert_allclose(derivatives[:, k], measured, rtol=1e-4, atol=1e-3)

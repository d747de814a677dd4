"""Poses of sensors and boards refined together, by the corners that all cameras found.

Source: Triggs et al., "Bundle adjustment - a modern synthesis" (1999), sections 4 and 6: Gauss-Newton steps damped
after Levenberg and Marquardt, the boards' unknowns eliminated first, since each of them meets only the sensors'.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.rig import Camera, rigid

MAX_STEPS = 30
SMALLEST_GAIN = 1e-9  # of the cost, share; a smaller one ends
ROBUST_PX = 1.0  # beyond which an error counts linearly: corners are found to a third of it
FIRST_DAMPING, LARGEST_DAMPING = 1e-6, 1e3  # of the diagonal
CHANGE = 10.0  # of the damping, from step to step

Poses = dict[str, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Sighting:
    """One camera's corners on one board.

    Parameters
    ----------
    sensor, board : names
    camera : its `cam_from_world` is `camera_from_sensor`, from the sensor's left camera
    points : float64 (N, 3), mm, corners on the board
    pixels : float64 (N, 2), where they were found
    """

    sensor: str
    board: str
    camera: Camera
    points: NDArray[np.float64]
    pixels: NDArray[np.float64]


def adjusted(sightings: Sequence[Sighting], sensors: Poses, boards: Poses, *, fixed: str) -> tuple[Poses, Poses]:
    """The poses nearest to the corners found, with intrinsics and stereo poses held.

    Parameters
    ----------
    sensors : `sensor_from_world` 4x4 by name, to begin with
    boards : `world_from_board` 4x4 by name, likewise
    fixed : the sensor that does not move, which ties down the world

    Returns
    -------
    The sensors' and the boards' poses.
    """
    free = [name for name in sensors if name != fixed]
    damping, cost = FIRST_DAMPING, _cost(sightings, sensors, boards)
    for _ in range(MAX_STEPS):
        system = _System(free, list(boards))
        for sighting in sightings:
            system.add(sighting, sensors[sighting.sensor], boards[sighting.board])
        while damping < LARGEST_DAMPING:
            sensor_steps, board_steps = system.solved(damping)
            moved = (
                sensors | {name: _turned_sensor(sensors[name], step) for name, step in sensor_steps.items()},
                {name: _turned_board(boards[name], step) for name, step in board_steps.items()},
            )
            moved_cost = _cost(sightings, *moved)
            if moved_cost <= cost:
                break
            damping *= CHANGE
        else:
            break  # no step makes it better: the minimum, to rounding
        gain, cost, (sensors, boards) = cost - moved_cost, moved_cost, moved
        damping /= CHANGE
        if gain <= SMALLEST_GAIN * cost:
            break
    return sensors, boards


class _System:
    """Normal equations of small turns and shifts: 6 unknowns of each free sensor, 6 of each board."""

    def __init__(self, sensors: Sequence[str], boards: Sequence[str]) -> None:
        n = 6 * len(sensors)
        self._sensors = {name: slice(6 * k, 6 * k + 6) for k, name in enumerate(sensors)}
        self._matrix, self._right = np.zeros((n, n)), np.zeros(n)
        self._own = {name: np.zeros((6, 6)) for name in boards}
        self._shared = {name: np.zeros((n, 6)) for name in boards}
        self._board_right = {name: np.zeros(6) for name in boards}

    def add(self, sighting: Sighting, sensor_from_world: NDArray[np.float64], board: NDArray[np.float64]) -> None:
        errors, by_sensor, by_board = _linearised(sighting, sensor_from_world, board)
        weights = 1 / np.sqrt(1 + (errors / ROBUST_PX) ** 2)  # of the soft L1 cost
        weighted = by_board * weights[:, None]
        self._own[sighting.board] += weighted.T @ by_board
        self._board_right[sighting.board] -= weighted.T @ errors
        if sighting.sensor in self._sensors:
            place = self._sensors[sighting.sensor]
            self._matrix[place, place] += (by_sensor * weights[:, None]).T @ by_sensor
            self._right[place] -= by_sensor.T @ (weights * errors)
            self._shared[sighting.board][place] += by_sensor.T @ weighted

    def solved(self, damping: float) -> tuple[Poses, Poses]:
        """The steps (6,) of every free sensor and of every board: turn in radians, then shift in mm."""
        matrix, right = _damped(self._matrix, damping), self._right.copy()
        inverses = {name: np.linalg.inv(_damped(own, damping)) for name, own in self._own.items()}
        for name, inverse in inverses.items():
            shared = self._shared[name] @ inverse
            matrix -= shared @ self._shared[name].T
            right -= shared @ self._board_right[name]
        step = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
        boards = {
            name: np.asarray(inverse @ (self._board_right[name] - self._shared[name].T @ step), dtype=np.float64)
            for name, inverse in inverses.items()
        }
        return {name: step[place] for name, place in self._sensors.items()}, boards


def _linearised(
    sighting: Sighting, sensor_from_world: NDArray[np.float64], world_from_board: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Errors (2N,), and their derivatives (2N, 6) by the sensor's and by the board's turn and shift, pixels."""
    in_world = sighting.points @ world_from_board[:3, :3].T + world_from_board[:3, 3]
    in_sensor = in_world @ sensor_from_world[:3, :3].T + sensor_from_world[:3, 3]
    pixels, by_place = _projected(sighting.camera, in_sensor)
    errors = (pixels - sighting.pixels).ravel()
    by_sensor = _by_motion(by_place, in_sensor)
    by_board = _by_motion(by_place @ sensor_from_world[:3, :3], in_world - world_from_board[:3, 3])
    return errors, by_sensor, by_board


def _projected(camera: Camera, in_sensor: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) of points (N, 3) of the sensor's frame, and their derivatives (N, 2, 3) by the points."""
    in_camera = camera.points_in_camera(in_sensor)
    pixels, derivatives = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), camera.K, camera.dist)
    by_shift = np.asarray(derivatives)[:, 3:6].reshape(-1, 2, 3)
    return np.asarray(pixels[:, 0], dtype=np.float64), by_shift @ camera.rotation


def _by_motion(by_place: NDArray[np.float64], offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives (2N, 6) by a turn about where `offsets` (N, 3) begin, and a shift: a point moves by w x p + t."""
    by_turn = np.cross(offsets[:, None, :], by_place)  # row . (w x p) = w . (p x row)
    return np.concatenate([by_turn, by_place], axis=2).reshape(-1, 6)


def _turned_sensor(pose: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(rigid(cv2.Rodrigues(step[:3])[0], step[3:]) @ pose)


def _turned_board(pose: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turned about the board's own first corner, so that turn and shift hardly depend on each other."""
    return np.asarray(rigid(cv2.Rodrigues(step[:3])[0] @ pose[:3, :3], pose[:3, 3] + step[3:]))


def _damped(matrix: NDArray[np.float64], damping: float) -> NDArray[np.float64]:
    return np.asarray(matrix + damping * np.diag(np.diag(matrix)))


def _cost(sightings: Sequence[Sighting], sensors: Mapping[str, NDArray[np.float64]], boards: Poses) -> float:
    """The soft L1 cost of all errors."""
    total = 0.0
    for sighting in sightings:
        pose = sensors[sighting.sensor] @ boards[sighting.board]
        pixels, _ = _projected(sighting.camera, sighting.points @ pose[:3, :3].T + pose[:3, 3])
        squares = ((pixels - sighting.pixels) / ROBUST_PX) ** 2
        total += float((2 * ROBUST_PX**2 * (np.sqrt(1 + squares) - 1)).sum())
    return total

"""Bundle adjustment: cameras and boards refined together by all corners.

Source: Triggs et al., "Bundle adjustment - a modern synthesis" (1999), sections 4 and 6: Gauss-Newton steps damped
after Levenberg and Marquardt, the boards' unknowns eliminated first, since each of them meets only the cameras'.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera, rigid, transformed

MAX_STEPS = 30
SMALLEST_GAIN = 1e-9  # of the cost, share; a smaller one ends
ROBUST_PX = 1.0  # beyond which an error counts linearly: corners are found to a third of it
FIRST_DAMPING, LARGEST_DAMPING = 1e-6, 1e3  # of the diagonal
CHANGE = 10.0  # of the damping, from step to step
N_POSE = 6  # turn in radians, shift in mm
N_LENS = 8  # fx, fy, cx, cy, k1, k2, p1, p2
POSE, TANGENTIAL = slice(0, N_POSE), slice(N_POSE + 6, N_POSE + N_LENS)  # among a camera's unknowns

Poses = dict[str, NDArray[np.float64]]
Cameras = dict[str, Camera]


@dataclass(frozen=True, eq=False)
class Sighting:
    """The corners of one board as one camera saw them.

    Parameters
    ----------
    camera, board : names
    points : float64 (N, 3), mm, corners on the board
    pixels : float64 (N, 2), their places in the picture
    """

    camera: str
    board: str
    points: NDArray[np.float64]
    pixels: NDArray[np.float64]


def adjusted(
    sightings: Sequence[Sighting],
    cameras: Mapping[str, Camera],
    boards: Mapping[str, NDArray[np.float64]],
    *,
    fixed: str,
) -> tuple[Cameras, Poses]:
    """Refine cameras and boards, and return both: poses, focal lengths, principal points and distortion.

    Parameters
    ----------
    sightings : all corners that were seen, (N, 2) each
    cameras : initial cameras by name, with five coefficients of distortion; where the tangential ones are zero they
        stay zero, and k3 stays as it is
    boards : initial `world_from_board`, float64 (4, 4), by name
    fixed : the camera that does not move, which ties down the world; its lens is refined as the others'
    """
    cameras, boards = dict(cameras), dict(boards)
    free = {name: _free_unknowns(camera, is_fixed=name == fixed) for name, camera in cameras.items()}
    damping, cost = FIRST_DAMPING, _cost(sightings, cameras, boards)
    for _ in range(MAX_STEPS):
        system = _System(free, list(boards))
        for sighting in sightings:
            system.add(sighting, cameras[sighting.camera], boards[sighting.board])
        while damping < LARGEST_DAMPING:
            camera_steps, board_steps = system.solved(damping)
            with suppress(ValueError):  # a step to a lens that no camera has is too long
                moved = (
                    {name: _moved_camera(camera, camera_steps[name]) for name, camera in cameras.items()},
                    {name: _turned_board(pose, board_steps[name]) for name, pose in boards.items()},
                )
                moved_cost = _cost(sightings, *moved)
                if moved_cost <= cost:
                    break
            damping *= CHANGE
        else:
            break  # no step makes it better: the minimum, to rounding
        gain, cost, (cameras, boards) = cost - moved_cost, moved_cost, moved
        damping /= CHANGE
        if gain <= SMALLEST_GAIN * cost:
            break
    return cameras, boards


def reprojection_error(sighting: Sighting, camera: Camera, world_from_board: NDArray[np.float64]) -> float:
    """Compute the root mean square distance between seen and projected corners, pixels.

    Parameters
    ----------
    sighting : corners (N, 2) and the board's points (N, 3)
    camera : the camera that saw them
    world_from_board : float64 (4, 4), the board's pose
    """
    return float(np.sqrt((_errors(sighting, camera, world_from_board) ** 2).sum(axis=1).mean()))


class _System:
    """Normal equations: the free unknowns of every camera, bool (N_POSE + N_LENS,), and the pose of every board."""

    def __init__(self, free: Mapping[str, NDArray[np.bool_]], boards: Sequence[str]) -> None:
        ends = np.cumsum([0, *(int(which.sum()) for which in free.values())])
        self._free = free
        self._places = {name: slice(*ends[k : k + 2]) for k, name in enumerate(free)}
        self._matrix, self._right = np.zeros((ends[-1], ends[-1])), np.zeros(ends[-1])
        self._own = {name: np.zeros((N_POSE, N_POSE)) for name in boards}
        self._shared = {name: np.zeros((ends[-1], N_POSE)) for name in boards}
        self._board_right = {name: np.zeros(N_POSE) for name in boards}

    def add(self, sighting: Sighting, camera: Camera, board: NDArray[np.float64]) -> None:
        errors, by_camera, by_board = _linearised(sighting, camera, board)
        place, by_camera = self._places[sighting.camera], by_camera[:, self._free[sighting.camera]]
        weights = 1 / np.sqrt(1 + (errors / ROBUST_PX) ** 2)  # of the soft L1 cost
        weighted = by_board * weights[:, None]
        self._own[sighting.board] += weighted.T @ by_board
        self._board_right[sighting.board] -= weighted.T @ errors
        self._matrix[place, place] += (by_camera * weights[:, None]).T @ by_camera
        self._right[place] -= by_camera.T @ (weights * errors)
        self._shared[sighting.board][place] += by_camera.T @ weighted

    def solved(self, damping: float) -> tuple[Poses, Poses]:
        """Return the steps (N_POSE + N_LENS,) of every camera, zero where it is held, and (N_POSE,) of every board."""
        matrix, right = _damped(self._matrix, damping), self._right.copy()
        inverses = {name: np.linalg.inv(_damped(block, damping)) for name, block in self._own.items()}
        for name, inverse in inverses.items():
            shared = self._shared[name] @ inverse
            matrix -= shared @ self._shared[name].T
            right -= shared @ self._board_right[name]
        step = np.linalg.solve(matrix, right)
        boards = {
            name: np.asarray(inverse @ (self._board_right[name] - self._shared[name].T @ step), dtype=np.float64)
            for name, inverse in inverses.items()
        }
        cameras = {name: np.zeros(N_POSE + N_LENS) for name in self._places}
        for name, place in self._places.items():
            cameras[name][self._free[name]] = step[place]
        return cameras, boards


def _free_unknowns(camera: Camera, *, is_fixed: bool) -> NDArray[np.bool_]:
    free = np.ones(N_POSE + N_LENS, dtype=np.bool_)
    free[POSE] = not is_fixed
    free[TANGENTIAL] = camera.dist[2:4].any()
    return free


def _linearised(
    sighting: Sighting, camera: Camera, world_from_board: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return errors (2N,), pixels, and derivatives by the camera's unknowns (2N, N_POSE + N_LENS) and the board's."""
    in_world = transformed(sighting.points, world_from_board)
    in_camera = camera.points_in_camera(in_world)
    pixels, derivatives = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), camera.K, camera.dist)
    by_place = derivatives[:, 3:6].reshape(-1, 2, 3)
    by_lens = derivatives[:, 6 : 6 + N_LENS]
    by_camera = np.hstack([_by_motion(by_place, in_camera), by_lens])
    by_board = _by_motion(by_place @ camera.rotation, in_world - world_from_board[:3, 3])
    return (pixels[:, 0] - sighting.pixels).ravel(), by_camera, by_board


def _by_motion(by_place: NDArray[np.float64], offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differentiate (2N, 6) by a turn about the origin of `offsets` (N, 3), and a shift: a point moves by w x p + t."""
    by_turn = np.cross(offsets[:, None, :], by_place)  # row . (w x p) = w . (p x row)
    return np.concatenate([by_turn, by_place], axis=2).reshape(-1, N_POSE)


def _moved_camera(camera: Camera, step: NDArray[np.float64]) -> Camera:
    pose, lens = step[POSE], step[N_POSE:]
    K = camera.K.copy()
    K[[0, 1, 0, 1], [0, 1, 2, 2]] += lens[:4]
    dist = camera.dist.copy()
    dist[:4] += lens[4:]
    moved = rigid(cv2.Rodrigues(pose[:3])[0], pose[3:]) @ camera.cam_from_world
    return replace(camera, K=K, dist=dist, cam_from_world=moved)


def _turned_board(pose: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn a board about its own first corner, so that turn and shift hardly depend on each other."""
    return np.asarray(rigid(cv2.Rodrigues(step[:3])[0] @ pose[:3, :3], pose[:3, 3] + step[3:]))


def _damped(matrix: NDArray[np.float64], damping: float) -> NDArray[np.float64]:
    return np.asarray(matrix + damping * np.diag(np.diag(matrix)))


def _cost(sightings: Sequence[Sighting], cameras: Mapping[str, Camera], boards: Poses) -> float:
    """Sum the soft L1 cost of all errors."""
    total = 0.0
    for sighting in sightings:
        squares = (_errors(sighting, cameras[sighting.camera], boards[sighting.board]) / ROBUST_PX) ** 2
        total += float((2 * ROBUST_PX**2 * (np.sqrt(1 + squares) - 1)).sum())
    return total


def _errors(sighting: Sighting, camera: Camera, world_from_board: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return projected corners less seen corners (N, 2), pixels."""
    pose = camera.cam_from_world @ world_from_board
    pixels, _ = cv2.projectPoints(sighting.points, cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3], camera.K, camera.dist)
    return np.asarray(pixels[:, 0] - sighting.pixels, dtype=np.float64)

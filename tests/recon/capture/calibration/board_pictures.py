"""Pictures of a calibration board by cameras that are known: what calibration has to find again."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.capture.calibration.board import Board, Corners
from recon.geometry.rig import Camera, Rig, Sensor, look_at, rigid

PIXELS_PER_MM = 2.0
SUPERSAMPLING = 2
BACKGROUND = 90.0


def studio_camera(x: float, seed: int, size: tuple[int, int] = (1280, 720)) -> Camera:
    """A camera 2.5 m from the middle of the working volume, its values not round."""
    rng = np.random.default_rng(seed)
    focal = 1.17 * size[0] * (1 + rng.normal(0, 0.004))
    centre = np.array(size) / 2 + rng.normal(0, 5, 2)
    K = np.array([[focal, 0, centre[0]], [0, focal * (1 + rng.normal(0, 0.001)), centre[1]], [0, 0, 1]])
    return Camera(K, size, look_at((x, 300.0, 2500.0), (0, 0, 0)), np.array([-0.12, 0.08, 0.0, 0.0, 0.0]))


def studio_rig(n_sensors: int = 1, size: tuple[int, int] = (1280, 720)) -> Rig:
    """Sensors of about 240 mm baseline, 600 mm apart."""
    starts = 600.0 * (np.arange(n_sensors) - (n_sensors - 1) / 2)
    return Rig(
        tuple(
            Sensor(f"S{i + 1}", studio_camera(x - 120.0, 2 * i, size), studio_camera(x + 120.0, 2 * i + 1, size))
            for i, x in enumerate(starts)
        )
    )


def board_pose(board: Board, rng: np.random.Generator) -> NDArray[np.float64]:
    """`world_from_board` of a board in the working volume that faces the cameras, tilted by up to 45 degrees."""
    tilt = Rotation.from_euler("xyz", rng.uniform(-45, 45, 3) * (1, 1, 0.7), degrees=True).as_matrix()
    turn = tilt @ np.diag([1.0, -1.0, -1.0])
    place = rng.uniform((-550, -300, -600), (550, 300, 1100))
    return rigid(turn, place - turn @ board.points.mean(axis=0))


def project(camera: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels (N, 2) of world points, with distortion."""
    pose = camera.cam_from_world
    turn = cv2.Rodrigues(pose[:3, :3])[0]
    return np.asarray(cv2.projectPoints(points, turn, pose[:3, 3], camera.K, camera.dist)[0][:, 0])


def corners_seen(
    board: Board, rig: Rig, n_views: int, noise_px: float, seed: int
) -> dict[str, list[dict[str, Corners]]]:
    """The corners that each sensor's cameras (left, right) find, without pictures, by the view's name."""
    rng = np.random.default_rng(seed)
    seen: dict[str, list[dict[str, Corners]]] = {sensor.id: [{}, {}] for sensor in rig.sensors}
    for view in range(n_views):
        pose = board_pose(board, rng)
        points = board.points @ pose[:3, :3].T + pose[:3, 3]
        for sensor in rig.sensors:
            for side, camera in enumerate((sensor.left, sensor.right)):
                pixels = project(camera, points)
                inside = ((pixels > 5) & (pixels < np.array(camera.size) - 5)).all(axis=1)
                if inside.sum() >= 12:
                    noisy = pixels[inside] + rng.normal(0, noise_px, (inside.sum(), 2))
                    seen[sensor.id][side][f"{view:03d}"] = Corners(np.flatnonzero(inside), noisy)
    return seen


def board_picture(
    board: Board, camera: Camera, world_from_board: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """What a camera sees of a board: every pixel's ray meets its plane; lens blur, shading and sensor noise on top.

    Nothing is printed on its back.
    """
    width, height = camera.size
    picture = np.full((height, width), BACKGROUND, dtype=np.float32)
    board_from_camera = np.linalg.inv(camera.cam_from_world @ world_from_board)
    (left, top), (right, bottom) = _around(board, camera, world_from_board)
    is_front = board_from_camera[2, 3] < 0  # z goes into the board
    if is_front and left < right and top < bottom:
        slopes = _fine_slopes(camera, slice(left, right), slice(top, bottom))
        rays = np.column_stack([slopes, np.ones(len(slopes))]) @ board_from_camera[:3, :3].T
        origin = board_from_camera[:3, 3]
        on_board = origin[:2] - rays[:, :2] * (origin[2] / rays[:, 2:])
        # the picture has a margin of one square; a chessboard's first corner is the first inner one
        first = board.square_mm * (1 if board.kind == "charuco" else 2)
        texels = ((on_board + first) * PIXELS_PER_MM - 0.5).astype(np.float32)
        columns, rows = texels.reshape(SUPERSAMPLING * (bottom - top), -1, 2).transpose(2, 0, 1)
        fine = cv2.remap(_printed(board), columns, rows, cv2.INTER_LINEAR, borderValue=BACKGROUND)
        size = (right - left, bottom - top)
        picture[top:bottom, left:right] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
    lit = 20.0 + cv2.GaussianBlur(picture, (0, 0), 0.7) * np.linspace(0.65, 0.85, width, dtype=np.float32)
    noisy = lit + 2.0 * rng.standard_normal(lit.shape, dtype=np.float32)
    return np.asarray(noisy.round().clip(0, 255), dtype=np.uint8)


@lru_cache(maxsize=4)
def _printed(board: Board) -> NDArray[np.float32]:
    return board.picture(PIXELS_PER_MM).astype(np.float32)


def _around(board: Board, camera: Camera, world_from_board: NDArray[np.float64]) -> NDArray[np.int64]:
    """The first and the end (column, row) of the part of a picture that shows the board and its margin, (2, 2)."""
    low, high = board.points.min(axis=0), board.points.max(axis=0)
    margin = 2 * board.square_mm
    corners = [(x, y, 0.0) for x in (low[0] - margin, high[0] + margin) for y in (low[1] - margin, high[1] + margin)]
    pixels = project(camera, np.array(corners) @ world_from_board[:3, :3].T + world_from_board[:3, 3])
    limits = np.stack([np.floor(pixels.min(axis=0)) - 4, np.ceil(pixels.max(axis=0)) + 5])
    return np.asarray(limits.clip(0, camera.size), dtype=np.int64)


def _fine_slopes(camera: Camera, columns: slice, rows: slice) -> NDArray[np.float64]:
    """Slopes x/z, y/z of the rays through the parts of a window's pixels, (N, 2)."""
    across, down = (
        np.arange(part.start + 0.5 / SUPERSAMPLING - 0.5, part.stop - 0.5, 1 / SUPERSAMPLING)
        for part in (columns, rows)
    )
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 1, 2)
    return np.asarray(cv2.undistortPoints(pixels, camera.K, camera.dist)[:, 0])


def photograph_board(folder: Path, board: Board, rig: Rig, n_views: int, seed: int) -> None:
    """Write `<sensor>/<side>/<view>.png` of a board held up `n_views` times."""
    rng = np.random.default_rng(seed)
    for view in range(n_views):
        pose = board_pose(board, rng)
        for sensor in rig.sensors:
            for side in ("left", "right"):
                path = folder / sensor.id / side / f"{view:03d}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(path), board_picture(board, getattr(sensor, side), pose, rng))


def relative_error(found: Sensor, truth: Sensor) -> dict[str, float]:
    """Largest relative error of the focal lengths, that of the baseline, and the relative rotation's in degrees."""
    focal = [
        abs(getattr(found, side).K[i, i] / getattr(truth, side).K[i, i] - 1)
        for side in ("left", "right")
        for i in (0, 1)
    ]
    turns = [sensor.right.rotation @ sensor.left.rotation.T for sensor in (found, truth)]
    angle = float(np.rad2deg(np.linalg.norm(cv2.Rodrigues(turns[0] @ turns[1].T)[0])))
    return {"focal": max(focal), "baseline": abs(found.baseline / truth.baseline - 1), "rotation_deg": angle}

"""Calibration and segmentation against known truth.

Boards are rendered as the studio's three sensors see them, found in the pictures, and 0.3 px of noise is added to every
corner; scenes of the studio are segmented with their clean plates, and with strokes on one frame in twenty, made from
the truth as a person would draw them: along the middle of the object's parts, around it, and in the gaps between arms
and trunk. `bench/capture.py` prints the figures.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.calibration.board import MIN_CORNERS, Board, Corners, parse_board
from recon.capture.calibration.solve import PairCalibration, calibrate_camera, calibrate_pair, calibrate_rig
from recon.capture.format import read_capture
from recon.capture.images import CaptureError
from recon.capture.masks.segment import segment_capture
from recon.geometry.rig import Camera, Rig, Sensor, rigid
from recon.studio import SynthParameters, synthesise
from recon.studio.rigs import Field, arc_rig

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.recon.capture.calibration.board_pictures import board_picture, board_pose, project, relative_error
from tests.recon.capture.masks.drawn_scribbles import SIDES, intersection_over_union, write_strokes

Seen = dict[str, Corners]
BOARDS = {"ChArUco": "charuco:14x10:50:37", "chessboard": "chessboard:14x9:50"}
N_VIEWS = {"ChArUco": 70, "chessboard": 140}  # a chessboard counts only where all of it is seen
BOARD_SIZE = (1280, 720)
SIZE = (960, 540)
NOISE_PX = 0.3
MARGIN_PX = 5  # of a picture in which no corner is found
LEAST_FACING = 0.4  # cosine of the angle from the board's normal to the line of sight: drawn boards are found as far
DISTORTION = (-0.1, 0.03, 0.0, 0.0, 0.0)  # tangential one could not be told from the principal point
FIELD = Field((0.0, 1100.0, 0.0), 1500.0, 1000.0)  # mm, what the sensors' cameras are aimed at
MOST_TURNED_DEG = 60.0  # of a board from the middle sensor, so that neighbours see it together
SCENES = ("ball", "box", "people", "standing", "face")


def calibration_row(board_name: str, seed: int, *, is_drawn: bool) -> dict[str, float | str]:
    """Errors of focal length, baseline and rotation, the worst of three sensors, and processor time."""
    board = parse_board(BOARDS[board_name])
    rig = _with_lenses(arc_rig(FIELD, n_sensors=3, size=BOARD_SIZE, rng=np.random.default_rng(seed)))
    started = time.process_time()
    seen = _corners(board, rig, seed, N_VIEWS[board_name], is_drawn=is_drawn)
    looked, started = time.process_time() - started, time.process_time()
    pairs = calibrate_rig(board, [_pair(board, sensor, seen[sensor.id]) for sensor in rig.sensors], seen)
    seconds = time.process_time() - started
    calibrated = Rig(tuple(pair.sensor for pair in pairs))
    errors = [relative_error(sensor, truth) for sensor, truth in zip(calibrated.sensors, rig.sensors, strict=True)]
    worst = {key: max(error[key] for error in errors) for key in errors[0]}
    return {
        "board": board_name,
        "seed": seed,
        "views": "+".join(str(len(pair.errors)) for pair in pairs),
        "focal_percent": round(100 * worst["focal"], 3),
        "baseline_percent": round(100 * worst["baseline"], 3),
        "rotation_deg": round(worst["rotation_deg"], 3),
        "between_sensors_deg": round(_apart_deg(calibrated, rig), 3),
        "find_processor_s": round(looked, 1),
        "calibrate_processor_s": round(seconds, 1),
    }


def _with_lenses(rig: Rig) -> Rig:
    def lens(camera: Camera) -> Camera:
        return replace(camera, dist=np.array(DISTORTION))

    return Rig(tuple(Sensor(sensor.id, lens(sensor.left), lens(sensor.right)) for sensor in rig.sensors))


def _corners(board: Board, rig: Rig, seed: int, n_views: int, *, is_drawn: bool) -> dict[str, tuple[Seen, Seen]]:
    """What each camera finds of a board held up in the middle, with noise on every corner.

    Pictures are drawn and searched, or, in a hundredth of the time, corners are put where they are.
    """
    poses_rng = np.random.default_rng((seed, 1))
    poses = [_held_up(board, poses_rng) for _ in range(n_views)]

    def look(task: tuple[int, Camera]) -> Seen:
        index, camera = task
        rng, seen_here = np.random.default_rng((seed, 2, index)), {}
        for view, pose in enumerate(poses):
            with suppress(CaptureError):  # turned away from this camera, or out of its picture
                corners = (
                    board.find(board_picture(board, camera, pose, rng)) if is_drawn else _projected(board, camera, pose)
                )
                noise = rng.normal(0, NOISE_PX, corners.pixels.shape)
                seen_here[f"{view:03d}"] = Corners(corners.ids, corners.pixels + noise)
        return seen_here

    cameras = [getattr(sensor, side) for sensor in rig.sensors for side in SIDES]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        seen = list(pool.map(look, enumerate(cameras)))
    return {sensor.id: (seen[2 * k], seen[2 * k + 1]) for k, sensor in enumerate(rig.sensors)}


def _projected(board: Board, camera: Camera, world_from_board: NDArray[np.float64]) -> Corners:
    """The corners inside a picture, of a board that is turned towards the camera."""
    points = board.points @ world_from_board[:3, :3].T + world_from_board[:3, 3]
    sight = points.mean(axis=0) - camera.centre
    facing = world_from_board[:3, 2] @ sight / np.linalg.norm(sight)
    pixels = project(camera, points)
    inside = ((pixels > MARGIN_PX) & (pixels < np.array(camera.size) - MARGIN_PX)).all(axis=1)
    if facing < LEAST_FACING or inside.sum() < (len(points) if board.kind == "chessboard" else MIN_CORNERS):
        raise CaptureError("the board is not found")
    return Corners(np.flatnonzero(inside), pixels[inside])


def _held_up(board: Board, rng: np.random.Generator) -> NDArray[np.float64]:
    """`world_from_board` of a board in the middle of the field, turned towards one of the sensors, and tilted."""
    pose = board_pose(board, rng)
    turn = np.deg2rad(rng.uniform(-MOST_TURNED_DEG, MOST_TURNED_DEG))
    around = np.array([[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]])
    return rigid(around, np.asarray(FIELD.centre)) @ pose


def _pair(board: Board, truth: Sensor, views: tuple[Seen, Seen]) -> PairCalibration:
    left, right = (
        calibrate_camera(f"{truth.id}/{side}", board, truth.left.size, seen)
        for side, seen in zip(SIDES, views, strict=True)
    )
    return calibrate_pair(truth.id, board, (left, right), views)


def _apart_deg(calibrated: Rig, truth: Rig) -> float:
    """The largest error of a sensor's rotation against the first one, degrees."""
    turns = [[s.left.rotation @ rig.sensors[0].left.rotation.T for s in rig.sensors[1:]] for rig in (calibrated, truth)]
    return max(
        float(np.rad2deg(np.linalg.norm(cv2.Rodrigues(one @ other.T)[0]))) for one, other in zip(*turns, strict=True)
    )


def segmentation_rows(scene: str) -> Iterator[dict[str, float | str]]:
    """Mean and lowest intersection over union, by clean plate and by scribbles on one frame in twenty."""
    with tempfile.TemporaryDirectory() as folder:
        parameters = SynthParameters(scene=scene, n_sensors=1, n_frames=20, size=SIZE)
        capture = synthesise(Path(folder) / scene, parameters)
        strokes = write_strokes(Path(folder) / "strokes", capture, frame=10)
        for name, scribbles in (("plate", None), ("scribbles", strokes)):
            started = time.process_time()
            segment_capture(capture.folder, scribbles=scribbles)
            seconds = time.process_time() - started
            overlaps = intersection_over_union(read_capture(capture.folder))
            yield {
                "scene": scene,
                "by": name,
                "mean_iou": round(float(np.mean(overlaps)), 4),
                "lowest_iou": round(min(overlaps), 4),
                "processor_s_per_picture": round(seconds / len(overlaps), 2),
            }

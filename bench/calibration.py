"""Calibration and segmentation against known truth.

Boards are rendered as the studio's three sensors see them, found in the pictures, and 0.3 px of noise is added to every
corner; scenes of the studio are segmented with their clean plates, and with strokes on one frame in twenty, made from
the truth as a person would draw them: along the middle of the object's parts, around it, and in the gaps between arms
and trunk.

    python bench/calibration.py [calibration|segmentation] [--seeds 3]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.board import Board, Corners, parse_board
from recon.capture.calibrate import PairCalibration, calibrate_camera, calibrate_pair, calibrate_rig
from recon.capture.format import read_capture
from recon.capture.images import CaptureError
from recon.capture.segment import segment_capture
from recon.rig import Camera, Rig, Sensor, rigid
from recon.studio import SynthParameters, synthesise
from recon.studio.rigs import Field, arc_rig

sys.path.insert(0, str(Path(__file__).parent.parent / "tests/recon"))
from board_pictures import board_picture, board_pose, relative_error
from strokes import SIDES, intersection_over_union, write_strokes

Seen = dict[str, Corners]
BOARDS = {"ChArUco": "charuco:14x10:50:37", "chessboard": "chessboard:9x6:80"}
BOARD_SIZE = (1280, 720)
SIZE = (960, 540)
N_VIEWS = 70
NOISE_PX = 0.3
DISTORTION = (-0.1, 0.03, 0.0, 0.0, 0.0)  # tangential one could not be told from the principal point
FIELD = Field((0.0, 1100.0, 0.0), 1500.0, 1000.0)  # mm, what the sensors' cameras are aimed at
MOST_TURNED_DEG = 60.0  # of a board from the middle sensor, so that neighbours see it together
SCENES = ("ball", "box", "people", "standing", "face")


def bench_calibration(n_seeds: int) -> None:
    """Print errors of focal length, baseline and rotation, the worst of three sensors a row."""
    for name, text in BOARDS.items():
        board = parse_board(text)
        for seed in range(n_seeds):
            rng = np.random.default_rng(seed)
            rig = _with_lenses(arc_rig(FIELD, n_sensors=3, size=BOARD_SIZE, rng=rng))
            started = time.perf_counter()
            seen = _corners_in_pictures(board, rig, seed)
            looked, started = time.perf_counter() - started, time.perf_counter()
            pairs = [_pair(board, sensor, seen[sensor.id]) for sensor in rig.sensors]
            each, started = time.perf_counter() - started, time.perf_counter()
            found = calibrate_rig(board, pairs, seen)
            joint = time.perf_counter() - started
            errors = [relative_error(sensor, truth) for sensor, truth in zip(found.sensors, rig.sensors, strict=True)]
            worst = {key: max(error[key] for error in errors) for key in errors[0]}
            print(
                f"{name} seed {seed}: {'+'.join(str(len(pair.errors)) for pair in pairs)} views, focal "
                f"{worst['focal']:.3%}, baseline {worst['baseline']:.3%}, rotation {worst['rotation_deg']:.3f} deg, "
                f"between sensors {_apart_deg(found, rig):.3f} deg; drawn and found in {looked:.0f} s, calibrated in "
                f"{each:.1f} + {joint:.1f} s"
            )


def _with_lenses(rig: Rig) -> Rig:
    def lens(camera: Camera) -> Camera:
        return replace(camera, dist=np.array(DISTORTION))

    return Rig(tuple(Sensor(sensor.id, lens(sensor.left), lens(sensor.right)) for sensor in rig.sensors))


def _corners_in_pictures(board: Board, rig: Rig, seed: int) -> dict[str, tuple[Seen, Seen]]:
    """What each camera finds of a board held up in the middle, with noise on every corner."""
    poses_rng = np.random.default_rng((seed, 1))
    poses = [_held_up(board, poses_rng) for _ in range(N_VIEWS)]

    def look(task: tuple[int, Camera]) -> Seen:
        index, camera = task
        rng, found = np.random.default_rng((seed, 2, index)), {}
        for view, pose in enumerate(poses):
            with suppress(CaptureError):  # turned away from this camera, or out of its picture
                corners = board.find(board_picture(board, camera, pose, rng))
                noise = rng.normal(0, NOISE_PX, corners.pixels.shape)
                found[f"{view:03d}"] = Corners(corners.ids, corners.pixels + noise)
        return found

    cameras = [getattr(sensor, side) for sensor in rig.sensors for side in SIDES]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        seen = list(pool.map(look, enumerate(cameras)))
    return {sensor.id: (seen[2 * k], seen[2 * k + 1]) for k, sensor in enumerate(rig.sensors)}


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


def _apart_deg(found: Rig, truth: Rig) -> float:
    """The largest error of a sensor's rotation against the first one, degrees."""
    turns = [[s.left.rotation @ rig.sensors[0].left.rotation.T for s in rig.sensors[1:]] for rig in (found, truth)]
    return max(
        float(np.rad2deg(np.linalg.norm(cv2.Rodrigues(one @ other.T)[0]))) for one, other in zip(*turns, strict=True)
    )


def bench_segmentation(scenes: list[str]) -> None:
    """Mean and lowest intersection over union, by clean plate and by scribbles on one frame in twenty."""
    for scene in scenes:
        with tempfile.TemporaryDirectory() as folder:
            parameters = SynthParameters(scene=scene, n_sensors=1, n_frames=20, size=SIZE)
            capture = synthesise(Path(folder) / scene, parameters)
            strokes = write_strokes(Path(folder) / "strokes", capture, frame=10)
            for name, scribbles in (("plate", None), ("scribbles", strokes)):
                started = time.perf_counter()
                segment_capture(capture.folder, scribbles=scribbles)
                overlaps = intersection_over_union(read_capture(capture.folder))
                seconds = (time.perf_counter() - started) / len(overlaps)
                print(
                    f"{scene} {name}: mean {np.mean(overlaps):.4f}, lowest {min(overlaps):.4f}, {seconds:.2f} s/picture"
                )


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser()
    parser.add_argument("part", nargs="?", choices=["calibration", "segmentation"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--scenes", default=",".join(SCENES))
    arguments = parser.parse_args()
    if arguments.part != "segmentation":
        bench_calibration(arguments.seeds)
    if arguments.part != "calibration":
        bench_segmentation(arguments.scenes.split(","))


if __name__ == "__main__":
    main()

"""Calibration and segmentation against known truth.

Boards are projected into cameras like the studio's with 0.3 px of noise on every corner; scenes of the studio are
segmented with their clean plates, and with strokes on one frame in twenty, made from the truth as a person would draw
them: along the middle of the object's parts, around it, and in the gaps between arms and trunk.

    python bench/calibration.py [calibration|segmentation] [--seeds 5]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from recon.capture.board import parse_board
from recon.capture.calibrate import calibrate_camera, calibrate_pair
from recon.capture.format import read_capture
from recon.capture.segment import segment_capture
from recon.studio import SynthParameters, synthesise

sys.path.insert(0, str(Path(__file__).parent.parent / "tests/recon"))
from board_pictures import corners_seen, relative_error, studio_rig
from strokes import SIDES, intersection_over_union, write_strokes

BOARD = parse_board("charuco:14x10:50:37")
SIZE = (960, 540)
N_VIEWS = 70
NOISE_PX = 0.3
SCENES = ("ball", "box", "people", "standing", "face")


def bench_calibration(n_seeds: int) -> None:
    """Errors of focal length, baseline and rotation."""
    rig = studio_rig()
    truth = rig.sensors[0]
    for seed in range(n_seeds):
        left, right = corners_seen(BOARD, rig, N_VIEWS, NOISE_PX, seed)["S1"]
        started = time.perf_counter()
        cameras = [
            calibrate_camera(side, BOARD, truth.left.size, views)
            for side, views in zip(SIDES, (left, right), strict=True)
        ]
        pair = calibrate_pair("S1", BOARD, (cameras[0], cameras[1]), (left, right))
        error = relative_error(pair.sensor, truth)
        print(
            f"calibration seed {seed}: {len(pair.errors)} views, focal {error['focal']:.3%}, baseline "
            f"{error['baseline']:.3%}, rotation {error['rotation_deg']:.3f} deg, {time.perf_counter() - started:.1f} s"
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
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--scenes", default=",".join(SCENES))
    arguments = parser.parse_args()
    if arguments.part != "segmentation":
        bench_calibration(arguments.seeds)
    if arguments.part != "calibration":
        bench_segmentation(arguments.scenes.split(","))


if __name__ == "__main__":
    main()

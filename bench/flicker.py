"""How much models flicker beside the true ones, and what trails they leave: `python bench/flicker.py [CAPTURE RUN...]`.

CAPTURE is a synthetic recording, each RUN a reconstruction of it. Every model is drawn from still cameras, so that all
change in the pictures is the model's own. Of each approach are printed

- film: how much luma changes from frame to frame inside the silhouettes of parts of a film, in the true models' own
- flicker: the same from still cameras
- still: the same where the truth moves by less than `STILL_MM` a frame, grey levels, and rim: beside the outlines there
- still truth, rim truth: what the true models have there
- moving, moving p95: distance from what moves by more than `MOVING_MM` a frame to the model, mm
- trail, trail p95: distance from the model, near what moved or moves, to the truth, mm
- all: distance from the truth to the model, mm
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from films import timed
from numpy.typing import NDArray

from recon.capture.format import read_capture
from recon.geometry.mesh import Mesh
from recon.geometry.mesh_files import read_mesh
from recon.geometry.rig import Camera, Rig
from recon.pipeline.run import Run, read_run
from recon.render.camera_path import camera_path
from recon.render.encoding.quality import luma_of
from recon.render.frames import render_masked_frames
from recon.render.scene import scene_around
from recon.studio.truth import MESH
from recon.studio.truth_models import TRUTH, write_truth_models
from recon.validation.triangles import TriangleTree

STILL_MM, MOVING_MM = 4.0, 20.0  # a frame
NEAR_MM = 60.0  # of what moves: fingers and sleeves, with what trails behind them
LENGTH, PLACES = 375, (60, 180, 300)  # frames of a film, and where its parts begin
RIM_PX = 3
N_POINTS = 4000

Drawn = tuple[NDArray[np.float32], NDArray[np.bool_]]  # luma and silhouette


def cameras_of(run: Run, n_frames: int, size: tuple[int, int], *, moving: bool) -> list[list[Camera]]:
    """Return the cameras of films of `n_frames`: three that stand still, or three parts of a film's path."""
    path = camera_path(Rig(tuple(stream.sensor for stream in run.capture.sensors)), run.capture.bounds, LENGTH, size)
    return [list(path[at : at + n_frames]) if moving else [path[at]] * n_frames for at in PLACES]


def drawn(models: list[Mesh], run: Run, size: tuple[int, int], *, moving: bool = False) -> list[list[Drawn]]:
    """Draw models in films."""
    films = cameras_of(run, len(models), size, moving=moving)
    scene = scene_around(run.capture.bounds, [camera for film in films for camera in film])
    return [
        [
            (luma_of(picture).astype(np.float32), mask)
            for picture, mask in render_masked_frames(models, film, scene, renderer="software")
        ]
        for film in films
    ]


def still_pixels(models: list[Mesh], run: Run, size: tuple[int, int]) -> list[list[NDArray[np.bool_]]]:
    """Draw where the truth moves little from each frame to the next: true meshes share their vertices."""
    moves = [np.linalg.norm(b.vertices - a.vertices, axis=1) for a, b in pairwise(models)]
    shades = [np.repeat(np.where(move < STILL_MM, 255, 0).astype(np.uint8)[:, None], 3, axis=1) for move in moves]
    painted = [
        Mesh(model.vertices, model.faces, model.normals, shade) for model, shade in zip(models, shades, strict=False)
    ]
    films = cameras_of(run, len(painted), size, moving=False)
    scene = scene_around(run.capture.bounds, [film[0] for film in films], "plain")
    return [
        [
            mask & (cv2.erode(picture[..., 0], np.ones((5, 5))) > 250)
            for picture, mask in render_masked_frames(painted, film, scene, renderer="software")
        ]
        for film in films
    ]


def film_ratio(films: list[list[Drawn]], truths: list[list[Drawn]]) -> float:
    """Mean change from frame to frame inside the silhouettes, in the truth's."""
    change = [0.0, 0.0]
    for film, truth in zip(films, truths, strict=True):
        for (a, b), (c, d) in zip(pairwise(film), pairwise(truth), strict=True):
            both = a[1] | b[1] | c[1] | d[1]
            for kind, (x, y) in enumerate(((a, b), (c, d))):
                change[kind] += float(np.abs(y[0] - x[0])[both].sum(dtype=np.float64))
    return change[0] / change[1]


def changes(
    films: list[list[Drawn]], truths: list[list[Drawn]], still: list[list[NDArray[np.bool_]]]
) -> dict[str, float]:
    """Mean change from frame to frame, of a model's pictures and of the truth's."""
    sums: dict[str, list[float]] = defaultdict(list)
    weights: dict[str, list[int]] = defaultdict(list)
    for film, truth, stills in zip(films, truths, still, strict=True):
        for (a, b), (c, d), is_still in zip(pairwise(film), pairwise(truth), stills, strict=True):
            solid = np.ones((2 * RIM_PX + 1,) * 2)
            edge = cv2.dilate(c[1].astype(np.uint8), solid) - cv2.erode(c[1].astype(np.uint8), solid) > 0
            rim = edge & (cv2.dilate(is_still.astype(np.uint8), np.ones((7, 7))) > 0)
            for name, region in (("still", is_still), ("rim", rim)):
                for kind, (x, y) in (("", (a, b)), (" truth", (c, d))):
                    sums[name + kind].append(float(np.abs(y[0] - x[0])[region].sum(dtype=np.float64)))
                    weights[name + kind].append(int(region.sum()))
    mean = {name: sum(sums[name]) / max(sum(weights[name]), 1) for name in sums}
    return {"flicker": film_ratio(films, truths)} | mean


def trails(models: list[Mesh], truths: list[Mesh]) -> dict[str, float]:
    """Distances between a model and the truth where this moves, and everywhere, mm."""
    found: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    rng = np.random.default_rng(1)
    for model, before, now in zip(models[1:], truths, truths[1:], strict=False):
        moves = np.linalg.norm(now.vertices - before.vertices, axis=1) > MOVING_MM
        to_model = TriangleTree(model.vertices, model.faces)
        found["all"].append(np.abs(to_model.nearest(_some(now.vertices, rng)).signed))
        if not moves.any():
            continue
        found["moving"].append(np.abs(to_model.nearest(_some(now.vertices[moves], rng)).signed))
        corners = moves[now.faces].any(axis=1)
        swept = [
            np.abs(TriangleTree(t.vertices, t.faces[corners]).nearest(model.vertices).signed) for t in (before, now)
        ]
        near = model.vertices[np.minimum(*swept) < NEAR_MM]
        if len(near):
            to_truth = TriangleTree(now.vertices, now.faces)
            found["trail"].append(np.abs(to_truth.nearest(_some(near, rng)).signed))
    joined = {name: np.concatenate(values) for name, values in found.items()}
    tails = {f"{name} p95": float(np.percentile(joined[name], 95)) for name in ("moving", "trail") if name in joined}
    return {name: float(values.mean()) for name, values in joined.items()} | tails


def _some(points: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float64]:
    return points[rng.permutation(len(points))[:N_POINTS]].astype(np.float64)


def record(folder: Path) -> None:
    """Record and reconstruct a scene that moves, small."""
    capture, run = str(folder / "capture"), str(folder / "run")
    timed("capture", "synth", capture, "--scene", "people", "--size", "480x270")
    timed("capture", "segment", capture)
    timed("reconstruct", capture, "-o", run, "--depth", "dr", "--frames", "6", "--colour", "vertices,photographs")


def compare(capture: Path, runs: Sequence[Run], size: tuple[int, int]) -> None:
    """Print the measures of every approach."""
    frames = runs[0].frames
    with tempfile.TemporaryDirectory() as folder:
        write_truth_models(read_capture(capture), Path(folder) / "models", range(frames[0], frames[-1] + 1))
        textured = [read_mesh(Path(folder) / "models" / TRUTH / f"{frame:04d}.glb") for frame in frames]
    truths = [read_mesh(capture / MESH.format(frame=frame)) for frame in frames]
    moving, still = (drawn(textured, runs[0], size, moving=is_moving) for is_moving in (True, False))
    pixels = still_pixels(truths, runs[0], size)
    for run in runs:
        for approach in run.approaches:
            models = [read_mesh(run.folder / run.mesh_name(approach, frame)) for frame in frames]
            row = {"film": film_ratio(drawn(models, run, size, moving=True), moving)}
            row |= changes(drawn(models, run, size), still, pixels) | trails(models, truths)
            print(f"{run.folder.name} {approach}: " + ", ".join(f"{name} {row[name]:.2f}" for name in row), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("capture", type=Path, nargs="?", help="default: a small one is recorded and reconstructed")
    parser.add_argument("runs", type=Path, nargs="*")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 360), help="of the films")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        capture, runs = arguments.capture, arguments.runs
        if capture is None:
            record(Path(temporary))
            capture, runs = Path(temporary) / "capture", [Path(temporary) / "run"]
        compare(capture, [read_run(run) for run in runs], tuple(arguments.size))


if __name__ == "__main__":
    main()

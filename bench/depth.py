"""Accuracy, speed and memory of the depth methods beside OpenCV's semi-global matcher, mode HH, in the same run.

    python bench/depth.py FOLDER...          accuracy and speed on pairs with truth
    python bench/depth.py --synthetic        the same on a made-up pair
    python bench/depth.py --rooms FOLDER...  errors as ratios to SGM's in made-up rooms of slanted walls; their
                                             textures are noise and, if folders are given, parts of their pictures
    python bench/depth.py --sequence FOLDER  PM's processor time as ratios to SGM's, and errors, in sequences of a pair
    python bench/depth.py --full-hd          time and peak memory at 1920x1080, 128 and 256 disparities
    python bench/depth.py --gpu FOLDER...    time on a GPU beside the processor's, and how many disparities are the
                                             same; on pairs, and made-up ones at 1920x1080
    python bench/depth.py --picture OUT.png  the picture of docs/depth.md

A pair is a folder of the Middlebury kind: im2 and im6, im3 and im4 or view1 and view5, with disp2, disp3 or disp1
(and disp6 or disp5). Unmatched pixels are filled with the smaller of the nearest valid disparities left and right;
non-occluded is where left and right truth agree within a pixel, or what the truth's forward warp leaves visible.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from memory import memory_mb
from numpy.typing import NDArray
from rooms import KINDS, noise_texture, room

from recon.depth import MATCHERS, StereoPair, match_frames, match_sgm
from recon.depth.cvf import IdParameters, match_id
from recon.depth.disparity_io import colour_preview
from recon.depth.gpu import open_gpu
from recon.methods.approaches import DEPTH_METHODS
from recon.runtime.files import whole_file

Disparity = NDArray[np.float32]
# left, right, left truth, right truth, truth values a pixel, disparities, unscored border
LAYOUTS = (
    ("im2", "im6", "disp2", "disp6", 4, 60, 0),
    ("im3", "im4", "disp3", "disp4", 16, 16, 18),
    ("view1", "view5", "disp1", "disp5", 2, 96, 0),
)
FULL_HD = (1920, 1080)
ROOMS_OF_A_KIND = 8
FIRST_ROOM = 1000  # rooms that no setting was chosen on
PANEL = (198, 165)  # pixels, of the picture


@dataclass(frozen=True, eq=False)
class Scene:
    """A pair with its truth: disparities float32 (H, W) of both views, NaN where unknown."""

    name: str
    pair: StereoPair
    truth: Disparity
    right_truth: Disparity | None


def read_scene(folder: Path) -> Scene:
    """Read a pair with truth.

    Raises
    ------
    ValueError
        If the folder holds no known pair.
    """
    for left, right, truth, right_truth, scale, n_disparities, border in LAYOUTS:
        files = [next(iter(sorted(folder.glob(f"{name}.p[ngp]*"))), None) for name in (left, right, truth, right_truth)]
        if files[0] and files[1] and files[2]:
            pair = StereoPair(_image(files[0]), _image(files[1]), n_disparities)
            known = _truth(files[2], scale)
            if border:
                known[:border] = known[-border:] = np.nan
                known[:, :border] = known[:, -border:] = np.nan
            return Scene(folder.name, pair, known, None if files[3] is None else _truth(files[3], scale))
    raise ValueError(f"{folder}: no pair with truth here; expected im2 + im6, im3 + im4 or view1 + view5 with disp*")


def _image(path: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"{path}: is not readable as an image")
    return np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


def _truth(path: Path, scale: int) -> Disparity:
    values = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if values is None:
        raise ValueError(f"{path}: is not readable as an image")
    return np.where(values == 0, np.nan, values / scale).astype(np.float32)


def synthetic_scene(width: int = 450, height: int = 375, n_disparities: int = 60, seed: int = 0) -> Scene:
    """A textured background with slanted rectangles in front of it, with the truth of both views."""
    rng = np.random.default_rng(seed)
    images = np.zeros((2, height, width, 3), np.float32)
    truths = np.full((2, height, width), -np.inf, np.float32)
    y, x = (grid.astype(np.float32) for grid in np.indices((height, width)))
    for layer in range(9):
        slope_x, slope_y = rng.uniform(-0.03, 0.03, 2) if layer else (0.0, 0.0)
        centre = rng.uniform((0.1, 0.1), (0.9, 0.9)) * (width, height)
        half = rng.uniform(0.05, 0.2, 2) * (width, height) if layer else np.array([width, height]) * 2.0
        depth = n_disparities * (0.15 + 0.08 * layer)
        texture = noise_texture(rng, height, width + n_disparities)
        for view in (0, 1):
            shifted = x if view == 0 else (x + depth - slope_x * centre[0] + slope_y * (y - centre[1])) / (1 - slope_x)
            disparity = depth + slope_x * (shifted - centre[0]) + slope_y * (y - centre[1])
            inside = (np.abs(shifted - centre[0]) < half[0]) & (np.abs(y - centre[1]) < half[1])
            seen = inside & (disparity > truths[view])
            colour = cv2.remap(texture, shifted.astype(np.float32), y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
            images[view][seen], truths[view][seen] = colour[seen], disparity[seen]
    noisy = np.clip(images + rng.normal(0, 1, images.shape), 0, 255).round().astype(np.uint8)
    return Scene("synthetic", StereoPair(noisy[0], noisy[1], n_disparities), truths[0], truths[1])


def filled(disparity: Disparity) -> Disparity:
    """Unmatched pixels filled with the smaller of the nearest valid disparities left and right."""
    towards: list[Disparity] = []
    for values in (disparity, disparity[:, ::-1]):
        valid = np.isfinite(values)
        nearest = np.maximum.accumulate(np.where(valid, np.arange(values.shape[1]), -1), axis=1)
        taken = np.take_along_axis(values, np.maximum(nearest, 0), axis=1)
        towards.append(np.where(nearest >= 0, taken, np.float32(np.inf)))
    lower = np.minimum(towards[0], towards[1][:, ::-1])
    return np.where(np.isfinite(lower), lower, 0).astype(np.float32)


def non_occluded(truth: Disparity, right_truth: Disparity | None) -> NDArray[np.bool_]:
    """Where both views see the scene."""
    known = np.isfinite(truth)
    rows, columns = np.arange(truth.shape[0])[:, None], np.arange(truth.shape[1])[None]
    there = np.rint(columns - np.where(known, truth, 0)).astype(np.intp)
    rows = np.broadcast_to(rows, there.shape)
    inside = known & (there >= 0)
    there = np.clip(there, 0, truth.shape[1] - 1)
    if right_truth is not None:
        return np.asarray(inside & (np.abs(right_truth[rows, there] - truth) <= 1))
    nearest = np.full(truth.shape, -np.inf)
    np.maximum.at(nearest, (rows[inside], there[inside]), truth[inside])
    return np.asarray(inside & (truth >= nearest[rows, there] - 1))


def accuracy(disparity: Disparity, scene: Scene) -> dict[str, float]:
    """Bad pixels in percent, root mean square errors in pixels, density in percent."""
    error = np.abs(filled(disparity) - scene.truth)
    visible, known = non_occluded(scene.truth, scene.right_truth), np.isfinite(scene.truth)
    scores: dict[str, float] = {}
    for name, region in (("nonocc", visible), ("all", known)):
        scores |= {f"bad-{limit} {name}": 100 * float((error[region] > limit).mean()) for limit in (0.5, 1, 2)}
        scores[f"rms {name}"] = float(np.sqrt((error[region] ** 2).mean()))
    kept = visible & np.isfinite(disparity)
    inliers = kept & (error <= 1)
    scores["density"] = 100 * float(kept.sum() / visible.sum())
    scores["bad-1 kept"] = 100 * float((error[kept] > 1).mean())
    scores["rms inliers"] = float(np.sqrt((error[inliers] ** 2).mean()))
    return scores


METHODS: dict[str, Callable[[StereoPair], Disparity]] = {
    "sgm": match_sgm,
    "id full": lambda pair: match_id(pair, IdParameters(levels=0)),
    **MATCHERS,
}


def seconds(methods: list[str], pair: StereoPair, *, rounds: int) -> dict[str, float]:
    """Median wall time of each method, taken in turns so that a busy machine slows all alike."""
    taken: dict[str, list[float]] = {name: [] for name in methods}
    for name in methods:
        METHODS[name](pair)
    for _ in range(rounds):
        for name in methods:
            begin = time.perf_counter()
            METHODS[name](pair)
            taken[name].append(time.perf_counter() - begin)
    return {name: float(np.median(times)) for name, times in taken.items()}


def print_scene(scene: Scene, *, rounds: int) -> None:
    """One table: a line a method."""
    fast = [name for name in METHODS if name != "pm"]
    times = seconds(fast, scene.pair, rounds=rounds) | seconds(["pm"], scene.pair, rounds=1)
    print(f"\n{scene.name}: {scene.pair.width}x{scene.pair.height}, {scene.pair.n_disparities} disparities")
    for row, name in enumerate(METHODS):
        scores = accuracy(METHODS[name](scene.pair), scene)
        if row == 0:
            print(" ".join(["method  ", *(f"{key:>13s}" for key in scores), "           ms", "        ratio"]))
        cells = [*scores.values(), 1000 * times[name], times[name] / times["sgm"]]
        print(f"{name:8s} " + " ".join(f"{cell:13.3f}" for cell in cells))


def print_rooms(folders: list[Path]) -> None:
    """One table: a line a kind of rooms, with the methods' errors as ratios to those of SGM."""
    pictures = [read_scene(folder).pair.left for folder in folders]
    others = [name for name in METHODS if name != "sgm"]
    print(f"errors above 1 pixel, non-occluded, as ratios to SGM's in {ROOMS_OF_A_KIND} rooms of each kind:")
    print("geometric mean (worst)    SGM, % " + "".join(f"{name:>15s}" for name in others))
    everywhere = []
    for number, (name, kind) in enumerate(KINDS.items()):
        first = FIRST_ROOM + 100 * number
        scenes = [Scene(name, *room(kind, seed, pictures)) for seed in range(first, first + ROOMS_OF_A_KIND)]
        errors = {method: np.array([_bad_percent(method, scene) for scene in scenes]) for method in METHODS}
        ratios = np.array([errors[method] / errors["sgm"] for method in others])
        cells = zip(np.exp(np.log(ratios).mean(1)), ratios.max(1), strict=True)
        print(
            f"{name:25s}{errors['sgm'].mean():7.2f} " + "".join(f"{mean:8.2f} ({worst:4.2f})" for mean, worst in cells)
        )
        everywhere.append(ratios)
    worse = (np.hstack(everywhere) > 1).sum(1)
    print(f"{f'worse, of {len(KINDS) * ROOMS_OF_A_KIND} rooms':33s}" + "".join(f"{n:15d}" for n in worse))


def _bad_percent(method: str, scene: Scene) -> float:
    return accuracy(METHODS[method](scene.pair), scene)["bad-1 nonocc"]


def print_sequence(scene: Scene, *, rounds: int) -> None:
    """One table: PM's ratio of processor time to SGM's, and its errors, in the first frames of made-up sequences."""
    other = synthetic_scene(scene.pair.width, scene.pair.height, scene.pair.n_disparities)
    upper = np.arange(scene.pair.height)[:, None] < scene.pair.height // 3
    mixed = [np.where(upper[..., None], *views) for views in zip(_images(other), _images(scene), strict=True)]
    sequences = {
        "the same": [scene.pair] * 3,
        "new noise of 1": [_noisy(scene.pair, 1, seed) for seed in range(3)],
        "new noise of 3": [_noisy(scene.pair, 3, seed) for seed in range(3)],
        "a third changes": [replace(scene.pair, left=mixed[0], right=mixed[1]), scene.pair, scene.pair],
        "all changes": [other.pair, scene.pair, scene.pair],
    }
    print(f"\n{scene.name}: ratio to SGM's time, of three frames, and bad-1 of the last, in the sequence and alone")
    for name, pairs in sequences.items():
        ratios: list[list[float]] = []
        for _ in range(rounds):
            ours: list[float] = []
            theirs: list[float] = []
            for disparity in _timed_frames(pairs, ours):
                last = disparity
                theirs.append(_processor_seconds(partial(match_sgm, scene.pair)))
            ratios.append([mine / np.median(theirs) for mine in ours])
        cells = " ".join(f"{ratio:7.1f}" for ratio in np.median(ratios, axis=0))
        errors = [accuracy(found, scene)["bad-1 nonocc"] for found in (last, MATCHERS["pm"](pairs[-1]))]
        print(f"{name:20s} {cells} {errors[0]:8.2f} {errors[1]:8.2f}")


def _images(scene: Scene) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    return scene.pair.left, scene.pair.right


def _noisy(pair: StereoPair, deviation: float, seed: int) -> StereoPair:
    rng = np.random.default_rng(seed)
    views = [view + rng.normal(0, deviation, view.shape) for view in (pair.left, pair.right)]
    left, right = (np.clip(view, 0, 255).round().astype(np.uint8) for view in views)
    return replace(pair, left=left, right=right)


def _timed_frames(pairs: Iterable[StereoPair], seconds_taken: list[float]) -> Iterator[Disparity]:
    """PM's disparities, frame by frame; the processor time of each is appended."""
    frames = match_frames(pairs, MATCHERS["pm"])
    while True:
        begin = time.process_time()
        disparity = next(frames, None)
        if disparity is None:
            return
        seconds_taken.append(time.process_time() - begin)
        yield disparity


def _processor_seconds(match: Callable[[], Disparity]) -> float:
    begin = time.process_time()
    match()
    return time.process_time() - begin


def print_full_hd(*, rounds: int) -> None:
    """Time in turns, and peak memory each in its own process."""
    for n_disparities in (128, 256):
        pair = full_hd_pair(n_disparities)
        methods = ["sgm", "id full", "id", "dr"]
        times = seconds(methods, pair, rounds=rounds)
        print(f"\nfull HD, {n_disparities} disparities\nmethod              ms        ratio     peak MiB")
        for name in methods:
            memory = peak_memory(name, n_disparities)
            print(f"{name:8s} {1000 * times[name]:13.1f} {times[name] / times['sgm']:12.3f} {memory:12.0f}")
    print_masked_pm(128)


def print_masked_pm(n_disparities: int) -> None:
    """Time of PM at full HD, with masks of a standing person's size."""
    pair = masked_pair(n_disparities)
    taken = seconds(["pm"], pair, rounds=1)["pm"]
    assert pair.left_mask is not None
    print(f"\nPM at full HD, {n_disparities} disparities, masks of {100 * pair.left_mask.mean():.0f} %: {taken:.1f} s")


def print_gpu(folders: list[Path], *, rounds: int) -> None:
    """One table: for each pair and method the times on the processor and the GPU, and where they agree."""
    gpu = open_gpu()
    pairs = {folder.name: read_scene(folder).pair for folder in folders}
    pairs |= {"full HD": full_hd_pair(128), "full HD masked": masked_pair(128)}
    print(f"{'pair':16s} method   first, ms     GPU, ms  processor, ms   same, %")
    for name, pair in pairs.items():
        for method in DEPTH_METHODS:
            expected, on_processor = timed(MATCHERS[method], pair, rounds=1 if method == "pm" else rounds)
            found, on_gpu = timed(partial(MATCHERS[method], gpu=gpu), pair, rounds=rounds)
            same = 100 * float(np.mean((found == expected) | (np.isnan(found) & np.isnan(expected))))
            times = (1000 * on_gpu[0], 1000 * np.median(on_gpu[1:]), 1000 * np.median(on_processor[1:]))
            print(f"{name:16s} {method:6s} " + "".join(f"{time:12.1f}" for time in times) + f"{same:13.4f}")


def timed(match: Callable[[StereoPair], Disparity], pair: StereoPair, *, rounds: int) -> tuple[Disparity, list[float]]:
    """The disparities of a method, and its wall times: the first, then those of some rounds."""
    taken: list[float] = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        disparity = match(pair)
        taken.append(time.perf_counter() - begin)
    return disparity, taken


def full_hd_pair(n_disparities: int) -> StereoPair:
    """A made-up pair of 1920x1080."""
    return synthetic_scene(*FULL_HD, n_disparities).pair


def masked_pair(n_disparities: int) -> StereoPair:
    """The same, with masks of a standing person's size."""
    width, height = FULL_HD
    y, x = np.indices((height, width))
    left, right = (((x - centre) / 230) ** 2 + ((y - height / 2) / 430) ** 2 < 1 for centre in (1000, 940))
    return replace(full_hd_pair(n_disparities), left_mask=left, right_mask=right)


def peak_memory(method: str, n_disparities: int) -> float:
    """Peak resident memory of a process that reads a pair and matches it, MiB."""
    pair = full_hd_pair(n_disparities)
    path = Path(f"/tmp/bench-depth-{os.getpid()}.npz")
    np.savez(path, left=pair.left, right=pair.right)
    try:
        command = [sys.executable, __file__, "--peak-of", method, str(n_disparities), str(path)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    finally:
        path.unlink()
    return float(json.loads(done.stdout))


def print_peak(method: str, n_disparities: int, path: Path) -> None:
    """In a process of its own: match once, print the peak in MiB."""
    images = np.load(path)
    METHODS[method](StereoPair(images["left"], images["right"], n_disparities))
    print(json.dumps(memory_mb("VmHWM")))


def write_picture(path: Path) -> None:
    """The made-up left image, and each method's disparities with their relief below."""
    scene = synthetic_scene()
    panels = [(scene.pair.left, colour_preview(scene.truth))]
    for method in DEPTH_METHODS:
        disparity = MATCHERS[method](scene.pair)
        panels.append((colour_preview(disparity), relief(disparity)))
    columns = [np.vstack([cv2.resize(half, PANEL, interpolation=cv2.INTER_AREA) for half in pair]) for pair in panels]
    with whole_file(path) as temporary:
        if not cv2.imwrite(str(temporary), np.hstack(columns)[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9]):
            raise ValueError(f"{path}: could not be written")


def relief(disparity: Disparity) -> NDArray[np.uint8]:
    """The surface lit from the left: steps show as lines; unmatched is black."""
    slope = np.gradient(disparity, axis=1)
    shade = np.nan_to_num(np.clip(128 + 400 * slope, 1, 255), nan=0)
    return np.repeat(shade[..., None], 3, axis=2).astype(np.uint8)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--synthetic", action="store_true")
    parser.add_argument("--rooms", nargs="*", type=Path)
    parser.add_argument("--sequence", nargs="*", type=Path, default=[])
    parser.add_argument("--full-hd", action="store_true")
    parser.add_argument("--gpu", action="store_true")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--peak-of", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak_of:
        method, n_disparities, path = options.peak_of
        print_peak(method, int(n_disparities), Path(path))
        return
    if options.gpu:
        print_gpu(options.folders, rounds=options.rounds)
        return
    for folder in options.folders:
        print_scene(read_scene(folder), rounds=options.rounds)
    for folder in options.sequence:
        print_sequence(read_scene(folder), rounds=min(options.rounds, 3))
    if options.synthetic:
        print_scene(synthetic_scene(), rounds=options.rounds)
    if options.rooms is not None:
        print_rooms(options.rooms)
    if options.picture:
        write_picture(options.picture)
    if options.full_hd:
        print_full_hd(rounds=max(options.rounds // 3, 1))


if __name__ == "__main__":
    main()

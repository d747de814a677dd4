"""The whole way from a capture to a stimulus set: one straight function per product.

Every artefact is keyed by what it was made from, so a run that was stopped is resumed where it stopped.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from recon.approaches import FUSION_METHODS, approaches
from recon.capture.format import Capture, read_capture
from recon.capture.images import read_stored_image
from recon.cloud import CloudParameters
from recon.depth import DEFAULTS, MATCHERS, StereoPair, matched
from recon.depth.disparity_io import write_disparity
from recon.depth.temporal import TemporalParameters
from recon.pipeline.film import PARTS, WHERE, Film, RenderOptions, is_finished, make_film, make_part
from recon.pipeline.manifest import write_manifest
from recon.pipeline.preview import make_preview
from recon.pipeline.run import Run, cloud_name, continue_log, keep_log, log, mesh_name, read_run, versions, write_run
from recon.pipeline.stages import (
    compare_colours,
    filter_sequence,
    frames_without_points,
    make_cloud,
    make_mesh,
    match_frame,
)
from recon.render.frames import choose_renderer
from recon.storage.artefacts import Artefacts
from recon.storage.files import remove_leftovers
from recon.storage.remote import remove
from recon.surface import SurfaceParameters
from recon.workers import Pool, Progress, no_progress, open_pool

PLACE_VOXELS = 3  # width of the places where sensors' colours are compared


@dataclass(frozen=True)
class ReconstructOptions:
    """What to make of a capture.

    Parameters
    ----------
    depths, fusions : the methods; every combination is an approach
    frames : which frames; None for all
    temporal : of the filter over a sensor's frames; None for none
    cloud, surface : parameters of these stages; without a voxel size, one that suits the depth resolution
    balance_colours : whether to make the sensors' colours agree, as estimated from what several of them saw
    workers : local processes, each on one thread; 1 works in this process with all threads
    cluster : address of a Dask scheduler whose workers do the work instead; None for none
    """

    depths: tuple[str, ...] = tuple(MATCHERS)
    fusions: tuple[str, ...] = FUSION_METHODS
    frames: range | None = None
    temporal: TemporalParameters | None = field(default_factory=TemporalParameters)
    cloud: CloudParameters = field(default_factory=CloudParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    balance_colours: bool = False
    workers: int = 1
    cluster: str | None = None


def match_files(
    left: Path, right: Path, out: Path, *, method: str, n_disparities: int, min_disparity: int = 0
) -> dict[str, Any]:
    """Match the images of two files, write the disparity, and say how it went.

    Raises
    ------
    ValueError
        If the method is unknown or the images cannot be matched; nothing is written then.
    """
    _check_method(method)
    images = [np.asarray(read_stored_image(path)) for path in (left, right)]
    pair = StereoPair(images[0], images[1], n_disparities, min_disparity)  # which refuses what is not 8 bits
    started = time.perf_counter()
    disparity, warnings = matched(method, pair)
    seconds = time.perf_counter() - started
    write_disparity(out, disparity)
    return {
        "out": str(out),
        "method": method,
        "seconds": seconds,
        "density": float(np.isfinite(disparity).mean()),
        "size": [pair.width, pair.height],
        "warnings": warnings,
        "parameters": {"n_disparities": n_disparities, "min_disparity": min_disparity} | asdict(DEFAULTS[method]),
    }


def reconstruct(
    capture_folder: Path, run: Path, options: ReconstructOptions, progress: Progress = no_progress
) -> dict[str, Any]:
    """Make depth maps, clouds and meshes of a capture, and return the content of ``run.json``.

    A sensor that sees nothing in a frame is left out of that frame's models, and a warning says so.

    Raises
    ------
    ValueError
        If the capture, a method or the frames are wrong, or no sensor sees anything in a frame; `run` then holds only
        whole files.
    """
    capture, run = read_capture(capture_folder.resolve()), run.resolve()
    wanted = approaches(options.depths, options.fusions)
    for method in options.depths:
        _check_method(method)
    frames = _chosen_frames(capture, options.frames)
    voxel = options.surface.voxel_mm or depth_resolution(capture)
    surface = replace(options.surface, voxel_mm=voxel)
    sequences = [(method, stream.id) for method in options.depths for stream in capture.sensors]
    views = [(*sequence, frame) for sequence in sequences for frame in frames]

    timings: dict[str, float] = {}
    with open_pool(options.workers, options.cluster) as pool:
        run.mkdir(parents=True, exist_ok=True)
        remove_leftovers(run)
        continue_log(run)

        def make(stage: str, tasks: Sequence[partial[list[str]]]) -> None:
            timings[stage] = _run_stage(stage, tasks, run, pool, progress)

        make("matching", [partial(match_frame, capture, run, *view) for view in views])
        make(
            "depth maps", [partial(filter_sequence, capture, run, *ids, frames, options.temporal) for ids in sequences]
        )
        make("clouds", [partial(make_cloud, capture, run, *view, options.cloud) for view in views])
        _check_points(capture, run, options.depths, frames)
        if options.balance_colours:
            place = PLACE_VOXELS * voxel
            make("colours", [partial(compare_colours, capture, run, options.depths[-1], frames[0], place)])
        balanced = options.balance_colours
        models = [(approach, frame) for approach in wanted for frame in frames]
        make("meshes", [partial(make_mesh, capture, run, *model, surface, balanced=balanced) for model in models])
        remove_leftovers(run)  # of workers that were lost
    names = [cloud_name(*view) for view in views] + [mesh_name(str(approach), frame) for approach, frame in models]
    finished = Run(run, capture, tuple(map(str, wanted)), tuple(frames), versions())
    content = write_run(
        finished,
        options=_as_json(replace(options, surface=surface)),
        timings=timings,
        warnings=Artefacts(run).warnings(names),
    )
    make_preview(read_run(run), frames[0])
    return content


def render(runs: Sequence[Path], out: Path, options: RenderOptions, progress: Progress = no_progress) -> Path:
    """Make a video of every approach of every run, and the manifest; returns the manifest's path.

    Path, light, background, renderer and encoder settings are the same for all approaches of a scene.

    Raises
    ------
    ValueError
        If a folder is not a run, or two runs are of the same scene.
    """
    out = out.resolve()
    options = replace(options, renderer=choose_renderer(options.renderer))
    read = [read_run(run.resolve()) for run in runs]
    films = [Film(run, approach, options) for run in read for approach in run.approaches]
    with open_pool(options.workers, options.cluster) as pool:
        remove_leftovers(out)
        parts = [
            partial(make_part, film, out, part, threads=pool.threads)
            for film in films
            if not is_finished(film, out)
            for part in film.parts
        ]
        _run_parts(parts, pool, progress)
        stimuli = list(pool.run([partial(make_film, film, out) for film in films]))
        remove_leftovers(out)  # of workers that were lost
    remove(out / PARTS)
    provenance = {
        "runs": [{"dataset": run.dataset, "versions": run.versions} for run in read],
        "render": {name: value for name, value in asdict(options).items() if name not in WHERE},
        "versions": versions(),
    }
    stimuli.sort(key=lambda stimulus: (stimulus.dataset, stimulus.approach))
    return write_manifest(out, out.name, stimuli, provenance)


def depth_resolution(capture: Capture) -> float:
    """A voxel size that loses neither depth nor picture resolution at the middle of the bounds, mm.

    A third of the depth step of one pixel of disparity, so that a slice of whole disparities still meets the next,
    and not less than the width of a pixel; the coarsest of the sensors decides.
    """
    centre = capture.bounds.mean(axis=0)
    sizes: list[float] = []
    for stream in capture.sensors:
        camera = stream.left.camera
        distance = float(np.linalg.norm(camera.centre - centre))
        pixel = distance / float(camera.K[0, 0])
        sizes.append(max(pixel, pixel * distance / stream.sensor.baseline / 3))
    return round(max(sizes), 3)


def _check_method(method: str) -> None:
    if method not in MATCHERS:
        raise ValueError(f"unknown depth method {method!r}, expected one of {', '.join(MATCHERS)}")


def _chosen_frames(capture: Capture, wanted: range | None) -> list[int]:
    frames = [frame for frame in range(capture.n_frames) if wanted is None or frame in wanted]
    if not frames:
        raise ValueError(f"{capture.folder}: has frames 0 to {capture.n_frames - 1}, none of them in {wanted}")
    return frames


def _check_points(capture: Capture, run: Path, methods: Sequence[str], frames: Sequence[int]) -> None:
    """Stop where a frame has no points of any sensor, before a model of another one is made."""
    for method in methods:
        empty = frames_without_points(capture, run, method, frames)
        if empty:
            raise ValueError(
                f"{capture.folder}: no sensor sees anything in frame {', '.join(map(str, empty))} (depth method "
                f"{method}), so that there is no model to show; look at the masks and pictures, or choose other frames "
                "with --frames A:B"
            )


def _as_json(options: ReconstructOptions) -> dict[str, Any]:
    return {name: value for name, value in asdict(options).items() if name not in ("frames", *WHERE)}


def _run_stage(stage: str, tasks: Sequence[partial[list[str]]], run: Path, pool: Pool, progress: Progress) -> float:
    """Run the tasks of a stage, log what they made, and return how long that took, s."""
    artefacts = Artefacts(run)
    started = time.perf_counter()
    progress(stage, 0, len(tasks))
    for done, names in enumerate(pool.run(tasks), start=1):
        for name in names:
            warnings = artefacts.warnings([name])
            log(run, {"time": time.time(), "made": name} | ({"warnings": warnings} if warnings else {}))
        progress(stage, done, len(tasks))
    keep_log(run)
    return time.perf_counter() - started


def _run_parts(parts: Sequence[partial[int]], pool: Pool, progress: Progress) -> None:
    """Make the parts of videos; progress counts frames."""
    total = sum(len(part.args[2]) for part in parts)
    done = 0
    progress("video frames", done, total)
    for n_frames in pool.run(parts):
        done += n_frames
        progress("video frames", done, total)

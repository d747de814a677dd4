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
from recon.capture.images import read_image
from recon.cloud import CloudParameters
from recon.depth import MATCHERS, Matcher, StereoPair
from recon.depth.disparity_io import write_disparity
from recon.depth.temporal import TemporalParameters
from recon.execute import Progress, run_tasks, silent
from recon.files import remove_leftovers
from recon.flythrough import RenderOptions, make_video
from recon.manifest import Stimulus, write_manifest
from recon.preview import make_preview
from recon.products import compare_colours, filter_sequence, make_cloud, make_mesh, match_frame
from recon.render.frames import choose_renderer
from recon.run import Run, log, read_run, versions, write_run
from recon.surface import SurfaceParameters

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
    workers : local processes; 1 works in this process with all threads
    """

    depths: tuple[str, ...] = tuple(MATCHERS)
    fusions: tuple[str, ...] = FUSION_METHODS
    frames: range | None = None
    temporal: TemporalParameters | None = field(default_factory=TemporalParameters)
    cloud: CloudParameters = field(default_factory=CloudParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    balance_colours: bool = False
    workers: int = 1


def match_files(
    left: Path, right: Path, out: Path, *, method: str, n_disparities: int, min_disparity: int = 0
) -> dict[str, Any]:
    """Match the images of two files, write the disparity, and say how it went.

    Raises
    ------
    ValueError
        If the method is unknown or the images cannot be matched; nothing is written then.
    """
    pair = StereoPair(read_image(left), read_image(right), n_disparities, min_disparity)
    started = time.perf_counter()
    disparity = _matcher(method)(pair)
    seconds = time.perf_counter() - started
    write_disparity(out, disparity)
    return {
        "out": str(out),
        "method": method,
        "seconds": seconds,
        "density": float(np.isfinite(disparity).mean()),
        "size": [pair.width, pair.height],
        "parameters": {"n_disparities": n_disparities, "min_disparity": min_disparity},
    }


def reconstruct(
    capture_folder: Path, run: Path, options: ReconstructOptions, progress: Progress = silent
) -> dict[str, Any]:
    """Make depth maps, clouds and meshes of a capture, and return the content of ``run.json``.

    Raises
    ------
    ValueError
        If the capture, a method or the frames are wrong; `run` then holds only whole files.
    """
    capture = read_capture(capture_folder)
    wanted = approaches(options.depths, options.fusions)
    for method in options.depths:
        _matcher(method)
    frames = _chosen_frames(capture, options.frames)
    voxel = options.surface.voxel_mm or depth_resolution(capture)
    surface = replace(options.surface, voxel_mm=voxel)
    sequences = [(method, stream.id) for method in options.depths for stream in capture.sensors]
    views = [(*sequence, frame) for sequence in sequences for frame in frames]

    run.mkdir(parents=True, exist_ok=True)
    remove_leftovers(run)
    stages = {
        "matching": [partial(match_frame, capture, run, *view) for view in views],
        "depth maps": [partial(filter_sequence, capture, run, *ids, frames, options.temporal) for ids in sequences],
        "clouds": [partial(make_cloud, capture, run, *view, options.cloud) for view in views],
        "colours": [partial(compare_colours, capture, run, options.depths[-1], frames[0], PLACE_VOXELS * voxel)]
        * options.balance_colours,
        "meshes": [
            partial(make_mesh, capture, run, approach, frame, surface, balanced=options.balance_colours)
            for approach in wanted
            for frame in frames
        ],
    }
    timings = {
        stage: _run_stage(stage, tasks, run, options.workers, progress) for stage, tasks in stages.items() if tasks
    }
    finished = Run(run, capture, tuple(map(str, wanted)), tuple(frames), versions())
    content = write_run(finished, options=_as_json(replace(options, surface=surface)), timings=timings)
    make_preview(read_run(run), frames[0])
    return content


def render(runs: Sequence[Path], out: Path, options: RenderOptions, progress: Progress = silent) -> Path:
    """Make a video of every approach of every run, and the manifest; returns the manifest's path.

    Path, light, background, renderer and encoder settings are the same for all approaches of a scene.

    Raises
    ------
    ValueError
        If a folder is not a run, or two runs are of the same scene.
    """
    options = replace(options, renderer=choose_renderer(options.renderer))
    read = [read_run(run) for run in runs]
    tasks = [partial(make_video, run, out, approach, options) for run in read for approach in run.approaches]
    remove_leftovers(out)
    stimuli: list[Stimulus] = []
    progress("videos", 0, len(tasks))
    for stimulus in run_tasks(tasks, workers=options.workers):
        stimuli.append(stimulus)
        progress("videos", len(stimuli), len(tasks))
    provenance = {
        "runs": [{"dataset": run.dataset, "versions": run.versions} for run in read],
        "render": {name: value for name, value in asdict(options).items() if name != "workers"},
        "versions": versions(),
    }
    stimuli.sort(key=lambda stimulus: (stimulus.dataset, stimulus.approach))
    return write_manifest(out, out.resolve().name, stimuli, provenance)


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


def _matcher(method: str) -> Matcher:
    if method not in MATCHERS:
        raise ValueError(f"unknown depth method {method!r}, expected one of {', '.join(MATCHERS)}")
    return MATCHERS[method]


def _chosen_frames(capture: Capture, wanted: range | None) -> list[int]:
    frames = [frame for frame in range(capture.n_frames) if wanted is None or frame in wanted]
    if not frames:
        raise ValueError(f"{capture.folder}: has frames 0 to {capture.n_frames - 1}, none of them in {wanted}")
    return frames


def _as_json(options: ReconstructOptions) -> dict[str, Any]:
    return {name: value for name, value in asdict(options).items() if name not in ("frames", "workers")}


def _run_stage(stage: str, tasks: Sequence[partial[list[str]]], run: Path, workers: int, progress: Progress) -> float:
    started = time.perf_counter()
    progress(stage, 0, len(tasks))
    for done, names in enumerate(run_tasks(tasks, workers=workers), start=1):
        for name in names:
            log(run, {"time": time.time(), "made": name})
        progress(stage, done, len(tasks))
    return time.perf_counter() - started

"""The whole way from a capture to a stimulus set: `reconstruct` makes a run, `render` films runs and models folders.

Both go on where an earlier start was stopped; `recon.pipeline.run` says how they know.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from itertools import chain
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np

from recon.approaches import VERTICES, check_colours
from recon.capture.depth_maps import depth_view
from recon.capture.format import Capture, read_capture
from recon.capture.images import read_stored_image
from recon.depth import StereoPair
from recon.depth.disparity_io import write_disparity
from recon.geometry.mesh import Cloud, Mesh
from recon.pipeline.film import PARTS, WHERE, Film, RenderOptions, is_finished, make_film, make_part, make_path
from recon.pipeline.film_plan import check_loops, check_path_is_read_only, planned_films
from recon.pipeline.manifest import write_manifest
from recon.pipeline.methods import Methods, depth_key, fuse, fusion_key, match, with_limit
from recon.pipeline.preview import make_preview
from recon.pipeline.run import (
    Run,
    address_from,
    fetch_log,
    log,
    mesh_name,
    store_log,
    versions,
    write_run,
)
from recon.pipeline.sources import Source, read_sources, scenes_apart
from recon.pipeline.stages import (
    Job,
    ReconstructOptions,
    check_sensors,
    compare_colours,
    default_depths,
    filter_sequence,
    frames_without_points,
    make_cloud,
    make_mesh,
    match_frame,
)
from recon.pipeline.textures import compare_photographs, make_textured
from recon.programs import ProgramError
from recon.render.frames import choose_renderer
from recon.storage.artefacts import Artefacts
from recon.storage.files import remove_leftovers
from recon.storage.remote import remove
from recon.surface import SurfaceParameters
from recon.surface.outlines import widened
from recon.workers import Pool, Progress, no_progress, open_pool

PLACE_VOXELS = 3  # width of the places where sensors' colours are compared


def match_files(
    left: Path,
    right: Path,
    out: Path,
    *,
    method: str,
    n_disparities: int,
    min_disparity: int = 0,
    methods: Methods = Methods(),
) -> dict[str, Any]:
    """Match the images of two files, write the disparity, and say how it went.

    Parameters
    ----------
    left, right, out : files of the rectified images and of the disparity
    method : a name in `methods`
    n_disparities, min_disparity : the range to search, pixels
    methods : what the name stands for

    Raises
    ------
    ValueError
        If the method is unknown or the images cannot be matched; nothing is written then but the log of a program.
    """
    methods.check((method,), ())
    images = [np.asarray(read_stored_image(path)) for path in (left, right)]
    pair = StereoPair(images[0], images[1], n_disparities, min_disparity)  # which refuses what is not 8 bits
    started = time.perf_counter()
    with _program_folder(method) as folder:
        disparity, warnings = match(methods.depth[method], pair, folder)
    seconds = time.perf_counter() - started
    write_disparity(out, disparity)
    described = with_limit(depth_key(methods.depth[method]), methods.depth[method])
    parameters = {name: value for name, value in described.items() if name not in ("method", "parameters")}
    parameters |= described.get("parameters", {})
    return {
        "out": str(out),
        "method": method,
        "seconds": seconds,
        "density": float(np.isfinite(disparity).mean()),
        "size": [pair.width, pair.height],
        "warnings": warnings,
        "parameters": {"n_disparities": n_disparities, "min_disparity": min_disparity} | parameters,
    }


def fuse_clouds(
    clouds: Sequence[Cloud], method: str, surface: SurfaceParameters, *, methods: Methods = Methods()
) -> tuple[Mesh, list[str]]:
    """Fuse clouds; returns the mesh and a sentence for each warning.

    Parameters
    ----------
    clouds : one per sensor
    method : a name in `methods`
    surface : where its voxel is None, one is chosen for the clouds
    methods : what the name stands for

    Raises
    ------
    ValueError
        If the method is unknown, needs cameras, or fails.
    """
    methods.check((), (method,))
    with _program_folder(method) as folder:
        return fuse(methods.fusion[method], clouds, surface, views=None, folder=folder)


def reconstruct(
    capture_folder: Path, run: Path, options: ReconstructOptions, progress: Progress = no_progress
) -> dict[str, Any]:
    """Make depth maps, clouds and meshes of a capture, and return the content of ``run.json``.

    A sensor that sees nothing in a frame is left out of that frame's models, and a warning says so.

    Parameters
    ----------
    capture_folder, run : folders of the capture and of the run
    options : what to make
    progress : told after each file

    Raises
    ------
    ValueError
        If the capture, a method or the frames are wrong, or no sensor sees anything in a frame; `run` then holds only
        whole files.
    """
    capture, run = read_capture(capture_folder.resolve()), run.resolve()
    options = replace(options, depths=options.depths or default_depths(capture))
    options.methods.check(options.depth_methods, options.fusion_methods)
    check_colours(options.colours)
    check_sensors(capture, options.depth_methods)
    voxel = options.surface.voxel_mm or depth_resolution(capture)
    options = replace(options, surface=replace(options.surface, voxel_mm=voxel))
    options = replace(options, outlines=options.outlines and any(stream.mask for stream in capture.sensors))
    if options.outlines:
        options = replace(options, surface=widened(options.surface))
    job = Job(capture, _chosen_frames(capture, options.frames), options, Artefacts(run))
    views, models = list(chain.from_iterable(job.sequences)), job.models

    timings: dict[str, float] = {}
    with open_pool(options.workers, options.cluster) as pool:
        run.mkdir(parents=True, exist_ok=True)
        remove_leftovers(run)
        fetch_log(run)

        def make(stage: str, tasks: Sequence[partial[list[str]]]) -> None:
            timings[stage] = _run_stage(stage, tasks, job.artefacts, pool, progress)

        make("matching", [partial(match_frame, job, view) for view in views])
        make("depth maps", [partial(filter_sequence, job, sequence) for sequence in job.sequences])
        make("clouds", [partial(make_cloud, job, view) for view in views])
        _check_points(job)
        if options.balance_colours:
            make("colours", [partial(compare_colours, job, PLACE_VOXELS * voxel)])
        make("meshes", [partial(make_mesh, job, *surface) for surface in job.surfaces])
        if pictured := [model for model in models if model[0].colour != VERTICES]:
            make("exposures", [partial(compare_photographs, job)])
            make("textures", [partial(make_textured, job, *model) for model in pictured])
        remove_leftovers(run)  # of workers that were lost
    names = tuple(dict.fromkeys(str(approach) for approach, _ in models))
    finished = Run(run, capture, names, tuple(job.frames), versions(), address_from(run, capture.folder))
    files = [view.cloud for view in views] + [mesh_name(str(approach), frame) for approach, frame in job.surfaces]
    content = write_run(
        finished,
        options=_described(options),
        timings=timings,
        warnings=job.artefacts.warnings(files),
    )
    make_preview(finished, job.frames[0])
    return content


def render(
    folders: Sequence[Path],
    out: Path,
    options: RenderOptions,
    progress: Progress = no_progress,
    *,
    practice: str = "",
) -> Path:
    """Make a video of every approach of every run and models folder, and the manifest; returns the manifest's path.

    Path, light, background, renderer and encoder settings are the same for all approaches of a scene. The path is
    written beside the videos, as ``paths/DATASET.json``.

    Parameters
    ----------
    folders, out : runs and models folders, and the folder of the stimulus set
    options : how to show the models
    progress : told after each model that is checked, and after each part of a video, in frames
    practice : the scene whose two videos are for practice only; empty: none

    Raises
    ------
    ValueError
        If a folder is neither a run nor a models folder, a model cannot be filmed, two folders have a film in common or
        would take different paths around one scene, a file of cameras does not fit, or the practice does not have two
        videos beside others. Nothing is written then.
    """
    out = out.resolve()
    options = replace(options, renderer=choose_renderer(options.renderer))
    sources = read_sources([folder.resolve() for folder in folders])
    check_loops(sources, options)
    check_path_is_read_only(sources, options, out)
    with open_pool(options.workers, options.cluster) as pool:
        films, warnings = planned_films(sources, options, pool, progress)
        _check_practice(practice, films)
        remove_leftovers(out)
        paths = {film.dataset: make_path(film, out) for film in {film.dataset: film for film in films}.values()}
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
    path = options.path.name if isinstance(options.path, Path) else options.path
    provenance = {
        "runs": [source.provenance for source in sources if source.is_run],
        "models": [source.provenance | _digests(source, films) for source in sources if not source.is_run],
        "render": {name: value for name, value in asdict(options).items() if name not in WHERE} | {"path": path},
        "paths": paths,
        "warnings": [*warnings, *scenes_apart(sources, practice)],
        "versions": versions(),
    }
    stimuli.sort(key=lambda stimulus: (stimulus.dataset, stimulus.approach))
    return write_manifest(out, out.name, stimuli, provenance, practice=practice)


def _check_practice(practice: str, films: Sequence[Film]) -> None:
    if not practice:
        return
    datasets = [film.dataset for film in films]
    n_practised = datasets.count(practice)
    n_compared = len(datasets) - n_practised
    if n_practised != 2 or n_compared == 0:
        raise ValueError(
            f"the practice {practice!r} has {n_practised} videos, and other scenes have {n_compared}; expected a scene "
            f"with two, one plainly better, beside those that are compared: {', '.join(sorted(set(datasets)))}"
        )


def _digests(source: Source, films: Sequence[Film]) -> dict[str, Any]:
    """Return the digests of a models folder's models by approach and file, for the manifest."""
    names = {item.approach for item in source.sequences}
    shown = [film.sequence for film in films if film.dataset == source.dataset and film.sequence.approach in names]
    return {
        "sha256": {
            item.approach: {file.name: digest for file, digest in zip(item.files, item.digests, strict=True)}
            for item in shown
        }
    }


@contextmanager
def _program_folder(method: str) -> Iterator[Path]:
    """Yield a folder for a method that may be a program; it stays, with the log, if the program fails."""
    folder = Path(mkdtemp(prefix=f"reconstudy-{method}-"))
    try:
        yield folder
    except ProgramError as error:
        raise ProgramError(f"{method}: {error}") from error
    except ValueError:
        rmtree(folder)
        raise
    rmtree(folder)


def _described(options: ReconstructOptions) -> dict[str, Any]:
    """Return the options for ``run.json``, with what the methods' names stand for."""
    methods = options.methods
    depths: dict[str, Any] = {}
    for name in options.depth_methods:
        temporal = methods.temporal_of(name, options.temporal)
        depths[name] = with_limit(depth_key(methods.depth[name]), methods.depth[name])
        depths[name]["temporal"] = None if temporal is None else asdict(temporal)
    fusions = {
        name: with_limit(fusion_key(methods.fusion[name], options.surface), methods.fusion[name])
        for name in options.fusion_methods
    }
    content = {name: value for name, value in asdict(options).items() if name not in ("frames", "methods", *WHERE)}
    return content | {"methods": {"depth": depths, "fusion": fusions}}


def depth_resolution(capture: Capture) -> float:
    """Return a voxel size that loses neither depth nor picture resolution at the middle of the bounds, mm.

    A third of the depth step of one pixel of disparity, so that a slice of whole disparities still meets the next,
    and not less than the width of a pixel; for depth maps without a pair, the width of a pixel. The coarsest decides.
    """
    centre = capture.bounds.mean(axis=0)
    sizes: list[float] = []
    for stream in capture.sensors:
        camera = stream.left.camera if stream.right else depth_view(stream, capture.bounds).left
        distance = float(np.linalg.norm(camera.centre - centre))
        pixel = distance / float(camera.K[0, 0])
        sizes.append(max(pixel, pixel * distance / stream.sensor.baseline / 3) if stream.right else pixel)
    return round(max(sizes), 3)


def _chosen_frames(capture: Capture, wanted: range | None) -> list[int]:
    frames = [frame for frame in range(capture.n_frames) if wanted is None or frame in wanted]
    if not frames:
        raise ValueError(f"{capture.folder}: has frames 0 to {capture.n_frames - 1}, none of them in {wanted}")
    return frames


def _check_points(job: Job) -> None:
    """Stop where a frame has no points of any sensor, before a model of another one is made."""
    for method in job.options.depth_methods:
        empty = frames_without_points(job, method)
        if empty:
            raise ValueError(
                f"{job.capture.folder}: no sensor sees anything in frame {', '.join(map(str, empty))} (depth method "
                f"{method}), so that there is no model to show; look at the masks and pictures, or choose other frames "
                "with --frames A:B"
            )


def _run_stage(
    stage: str, tasks: Sequence[partial[list[str]]], artefacts: Artefacts, pool: Pool, progress: Progress
) -> float:
    """Run the tasks of a stage, log what they made, and return how long that took, s."""
    started = time.perf_counter()
    progress(stage, 0, len(tasks))
    for done, names in enumerate(pool.run(tasks), start=1):
        for name in names:
            warnings = artefacts.warnings([name])
            log(artefacts.folder, {"time": time.time(), "made": name} | ({"warnings": warnings} if warnings else {}))
        progress(stage, done, len(tasks))
    store_log(artefacts.folder)
    return time.perf_counter() - started


def _run_parts(parts: Sequence[partial[int]], pool: Pool, progress: Progress) -> None:
    """Make the parts of videos; progress counts frames."""
    total = sum(len(part.args[2]) for part in parts)
    done = 0
    progress("video frames", done, total)
    for n_frames in pool.run(parts):
        done += n_frames
        progress("video frames", done, total)

"""From a capture to a run: depth maps, clouds and meshes, and each of these steps on files of its own.

`reconstruct` goes on where an earlier start was stopped; `recon.pipeline.run` says how it knows.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from itertools import chain, repeat, zip_longest
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np

from recon.capture.checking.rows import aligned, rows_of
from recon.capture.format import Capture, read_capture
from recon.capture.images import read_stored_image
from recon.depth import CPU, StereoPair, check_device
from recon.depth.disparity_io import check_suffix, write_disparity
from recon.geometry.mesh import Cloud, Mesh
from recon.methods.approaches import VERTICES, Approach
from recon.pipeline.film import WHERE
from recon.pipeline.job import Job, ReconstructOptions, planned_job, with_voxels
from recon.pipeline.meshes import make_meshes
from recon.pipeline.methods import Methods, depth_key, fuse, fusion_key, match, with_limit
from recon.pipeline.preview import make_preview
from recon.pipeline.run import (
    ROWS_NAME,
    RUN_FILE,
    Run,
    address_from,
    approaches_before,
    check_is_run,
    fetch_log,
    log,
    store_log,
    versions,
    write_run,
)
from recon.pipeline.stages import (
    compare_colours,
    filter_sequence,
    frames_without_points,
    make_cloud,
    match_stretch,
    measure_rows,
    nothing_seen,
)
from recon.pipeline.textures import compare_photographs, make_textures
from recon.render.camera_path import NoPathError
from recon.runtime.artefacts import Artefacts
from recon.runtime.files import alone_in, check_not_read, remove_leftovers
from recon.runtime.programs import ProgramError
from recon.runtime.remote import remove
from recon.runtime.workers import Pool, Progress, no_progress, open_pool
from recon.surface import SurfaceParameters


def match_files(
    left: Path,
    right: Path,
    out: Path,
    *,
    method: str,
    n_disparities: int,
    min_disparity: int = 0,
    methods: Methods = Methods(),
    device: str = CPU,
) -> dict[str, Any]:
    """Match the images of two files, write the disparity, and say how it went.

    Parameters
    ----------
    left, right, out : files of the rectified images and of the disparity
    method : a name in `methods`
    n_disparities, min_disparity : the range to search, pixels
    methods : what the name stands for
    device : where ours match, of `recon.depth.DEVICES`

    Raises
    ------
    ValueError
        If the method is unknown, there is no GPU where one is asked for, `out` is one of the images or of no known
        format, or the images cannot be matched; nothing is written then but the log of a program.
    """
    methods.check((method,), ())
    check_device(device)
    check_suffix(out)
    check_not_read(out, (left, right))
    images = [np.asarray(read_stored_image(path)) for path in (left, right)]
    pair = StereoPair(images[0], images[1], n_disparities, min_disparity)  # which refuses what is not 8 bits
    fit = rows_of([(pair.left, pair.right, None)], ((pair.width - 1) / 2, (pair.height - 1) / 2))
    if fit is not None and fit.is_off:
        pair = replace(pair, right=aligned(pair.right, fit))
    started = time.perf_counter()
    with _program_folder(method) as folder:
        disparity, warnings = match(methods.depth[method], pair, folder, device)
    warnings = [*warnings, *([str(fit)] if fit is not None and fit.is_off else [])]
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
        If the capture, a method or the frames are wrong, no sensor sees anything in a frame, or another start is
        writing into `run`, which then holds only whole files.
    """
    return reconstruct_capture(read_capture(capture_folder.resolve()), run, options, progress)


def reconstruct_capture(
    capture: Capture, run: Path, options: ReconstructOptions, progress: Progress = no_progress
) -> dict[str, Any]:
    """Do as `reconstruct` does, for a capture that was read already.

    Parameters
    ----------
    capture : the recording
    run : folder of the run
    options, progress : as of `reconstruct`
    """
    run = run.resolve()
    if run == capture.folder.resolve():
        raise ValueError(f"{run}: is the capture itself; choose another folder for the run")
    check_is_run(run)
    job = planned_job(capture, run, options)
    with alone_in(run):
        return _made(job, progress)


def _made(job: Job, progress: Progress) -> dict[str, Any]:
    """Make what is not finished of a run, and return the content of ``run.json``."""
    run = job.artefacts.folder
    options, models = job.options, job.models
    by_frame = chain.from_iterable(zip_longest(*job.sequences))  # so that the time left can be told
    views = [view for view in by_frame if view is not None and view.frame in job.kept_frames]

    timings: dict[str, float] = {}
    with open_pool(options.workers, options.cluster) as pool:
        remove_leftovers(run)
        fetch_log(run)
        before = approaches_before(run)
        remove(run / RUN_FILE)  # it describes the files of an earlier start, which this one may replace

        def make(stage: str, tasks: Sequence[partial[list[str]]], work: Iterable[int] = repeat(1)) -> None:
            weighed = dict(zip(tasks, work, strict=False))
            timings[stage] = _run_stage(stage, weighed, job.artefacts, pool, progress)

        make("rows", [partial(measure_rows, job, sensor) for sensor in job.matched_sensors])
        make("matching", [partial(match_stretch, job, each) for each in job.stretches], map(job.work, job.stretches))
        make("depth maps", [partial(filter_sequence, job, sequence) for sequence in job.sequences])
        make("clouds", [partial(make_cloud, job, view) for view in views])
        _check_points(job)
        job = with_voxels(job)
        if options.balance_colours:
            make("colours", [partial(compare_colours, job)])
        make("meshes", [partial(make_meshes, job, *each) for each in _grouped(job.surfaces, by_depth=True)])
        if pictured := [model for model in models if model[0].colour != VERTICES]:
            make("exposures", [partial(compare_photographs, job)])
            make("textures", [partial(make_textures, job, *each) for each in _grouped(pictured)])
        remove_leftovers(run)  # of workers that were lost
    names = tuple(dict.fromkeys(str(approach) for approach, _ in models))
    recording = address_from(run, job.capture.folder)
    still = tuple(str(approach) for approach in options.models if len(job.frames_of(approach.depth)) < len(job.frames))
    finished = Run(run, job.capture, names, tuple(job.frames), versions(), recording, still, tuple(job.packed_frames))
    files = [ROWS_NAME.format(sensor=sensor) for sensor in job.matched_sensors]
    files += [view.cloud for view in views] + [job.mesh_name(*each) for each in job.surfaces]
    warnings = list(dict.fromkeys(job.artefacts.warnings(files)))
    progress("preview", 0, 1)
    try:
        make_preview(finished, job.frames[0])
        progress("preview", 1, 1)
    except NoPathError as error:
        warnings.append(f"no preview was drawn: {error}")
    if left := [name for name in before if name not in names]:
        warnings.append(
            f"models of {', '.join(left)} from an earlier start stay in meshes, but the run is of {', '.join(names)} "
            "alone now; for all of them, start again with all of their methods: what is there is not made again"
        )
    return write_run(finished, options=_described(job), timings=timings, warnings=warnings)


def _grouped(models: Sequence[tuple[Approach, int]], *, by_depth: bool = False) -> list[tuple[list[Approach], int]]:
    """Group models that share what they are made of: those of a frame, or of a frame by the same depth method."""
    groups: dict[tuple[int, str], list[Approach]] = {}
    for approach, frame in models:
        groups.setdefault((frame, approach.depth if by_depth else ""), []).append(approach)
    return [(approaches, frame) for (frame, _), approaches in groups.items()]


@contextmanager
def _program_folder(method: str) -> Iterator[Path]:
    """Yield a folder for a method that may be a program; it stays, with the log, if the program fails."""
    folder = Path(mkdtemp(prefix=f"reconstudy-{method}-"))
    try:
        yield folder
    except ProgramError as error:
        raise ProgramError(f"{method}: {error}") from error
    except BaseException:
        rmtree(folder)
        raise
    rmtree(folder)


def _described(job: Job) -> dict[str, Any]:
    """Return the options for ``run.json``, with what the methods' names stand for and the voxel of each depth method.

    The voxel of the surface is the finest of them: that of a mesh as good as the best.
    """
    voxels = {name: job.surface(name).voxel_mm for name in job.options.depth_methods}
    finest = replace(job.options.surface, voxel_mm=min(voxel for voxel in voxels.values() if voxel is not None))
    options = replace(job.options, surface=finest)
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
    return content | {"methods": {"depth": depths, "fusion": fusions}, "voxels_mm": voxels}


def _check_points(job: Job) -> None:
    """Stop where a frame has no points of any sensor, before a model of another one is made."""
    for method in job.options.depth_methods:
        empty = frames_without_points(job, method)
        if empty:
            raise nothing_seen(job, method, empty)


def _run_stage(
    stage: str, tasks: Mapping[partial[list[str]], int], artefacts: Artefacts, pool: Pool, progress: Progress
) -> float:
    """Run the tasks of a stage, log what they made, and return how long that took, s.

    Progress counts their work. What was finished before took no time, and would make the time that is left too short.
    """
    started = time.perf_counter()
    made, whole = 0, sum(tasks.values())
    total = whole
    progress(stage, made, total)
    for names, work in pool.run([partial(_with_work, *each) for each in tasks.items()]):
        for name in names:
            warnings = artefacts.warnings([name])
            log(artefacts.folder, {"time": time.time(), "made": name} | ({"warnings": warnings} if warnings else {}))
        made, total = (made + work, total) if names else (made, total - work)
        progress(stage, *((made, total) if total else (whole, whole)))
    store_log(artefacts.folder)
    return time.perf_counter() - started


def _with_work(task: partial[list[str]], work: int) -> tuple[list[str], int]:
    """Run a task; tells with what it made how much work that was."""
    return task(), work

"""Models of one frame by every approach, as a folder for the dashboard, which shows them side by side.

The folder holds `meshes/DATASET/APPROACH.ply` and `clouds/DATASET/APPROACH.ply` in world coordinates, mm. If the
recording is synthetic, their points carry the signed distance to the true surface as the property `error`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from recon.cloud import merge_clouds
from recon.geometry.mesh import Cloud, Mesh, Shape
from recon.geometry.mesh_files import read_mesh, write_cloud, write_measured, write_mesh
from recon.methods.approaches import parse_approach
from recon.pipeline.run import Run, View, read_clouds, read_run, recorded_in
from recon.runtime.remote import is_there
from recon.runtime.workers import Progress
from recon.studio.truth import MESH
from recon.validation.clouds import read_shape
from recon.validation.truth.evaluation import signed_distances_to

MESHES, CLOUDS = "meshes", "clouds"


def write_models(runs: Sequence[Path], out: Path, frame: int | None, progress: Progress) -> list[Path]:
    """Write the models of every approach of runs, and return their paths.

    Parameters
    ----------
    runs, out : folders of the runs and of the models
    frame : of the recording; None: the middle one of each run
    progress : told after each approach

    Raises
    ------
    ValueError
        If a folder is not a finished run, has no such frame, or two runs are of the same dataset.
    """
    scenes = [read_run(folder) for folder in runs]
    if len({run.dataset for run in scenes}) < len(scenes):
        raise ValueError(f"two of {', '.join(map(str, runs))} are of the same dataset; give one run for each scene")
    tasks = [(run, approach) for run in scenes for approach in run.approaches]
    written = []
    for number, (run, approach) in enumerate(tasks, 1):
        written += _write_approach(run, approach, _frame(run, frame), out)
        progress("models", number, len(tasks))
    return written


def _write_approach(run: Run, approach: str, frame: int, out: Path) -> list[Path]:
    frame = run.shown_in(approach, frame)
    truth = _truth(run, frame)
    depth = parse_approach(approach).depth
    names = [View(depth, stream.id, frame).cloud for stream in run.capture.sensors_for(depth)]
    if not all(is_there(run.folder / name) for name in names):
        raise ValueError(
            f"{run.folder}: the clouds of frame {frame} are not on disk, those of frames {run.frames[0]} and "
            f"{run.frames[len(run.frames) // 2]} are; choose one of these, or reconstruct again with --clouds all"
        )
    cloud = replace(merge_clouds(read_clouds(run.artefacts, names)), sigma=None)  # nobody looks at sigmas
    mesh = replace(read_mesh(run.artefacts.path(run.mesh_name(approach, frame))), texture=None)  # PLY holds none
    return [
        _write(out / MESHES / run.dataset / f"{approach}.ply", mesh, truth),
        _write(out / CLOUDS / run.dataset / f"{approach}.ply", cloud, truth),
    ]


def _write(path: Path, model: Mesh | Cloud, truth: Shape | None) -> Path:
    if truth is not None:
        points = model.vertices if isinstance(model, Mesh) else model.points
        return write_measured(path, model, signed_distances_to(truth, points))
    return write_mesh(path, model) if isinstance(model, Mesh) else write_cloud(path, model)


def _truth(run: Run, frame: int) -> Shape | None:
    """Read the true surface, if the recording is synthetic and still there."""
    path = recorded_in(run) / MESH.format(frame=frame)
    return read_shape(path) if path.is_file() else None


def _frame(run: Run, frame: int | None) -> int:
    if frame is None:
        return run.frames[len(run.frames) // 2]
    if frame not in run.frames:
        raise ValueError(f"{run.folder}: has no frame {frame}; it has {run.frames[0]} to {run.frames[-1]}")
    return frame

"""A run on disk: where each artefact of a reconstruction lies, and what `run.json` says about them.

A run is ``run.json``, ``log.jsonl``, ``capture.json`` (the rig and bounds it was made with), ``matched/`` and
``depth/<method>/<sensor>/<frame>.npy`` (before and after filtering in time), ``clouds/<method>/<sensor>/<frame>.ply``
``meshes/<approach>/<frame>.ply``, and ``previews/<frame>.png`` to look at.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from recon.capture.format import Capture, CaptureError, read_draft, write_capture
from recon.geometry.mesh import Cloud, holds_points, read_cloud
from recon.storage.artefacts import Artefacts
from recon.storage.files import read_json, write_json
from recon.storage.remote import address_of, fetched, is_copy, is_there, place, stored

SCHEMA_VERSION = 1
RUN_FILE = "run.json"
LOG_FILE = "log.jsonl"
COLOURS_NAME = "colours.json"  # gains and offsets of the sensors' colours


def matched_name(method: str, sensor_id: str, frame: int) -> str:
    """Where the disparities of one frame by itself lie in their run."""
    return f"matched/{method}/{sensor_id}/{frame:04d}.npy"


def depth_name(method: str, sensor_id: str, frame: int) -> str:
    """Where a disparity map, filtered in time, lies in its run."""
    return f"depth/{method}/{sensor_id}/{frame:04d}.npy"


def cloud_name(method: str, sensor_id: str, frame: int) -> str:
    """Where a sensor's cloud lies in its run."""
    return f"clouds/{method}/{sensor_id}/{frame:04d}.ply"


def mesh_name(approach: str, frame: int) -> str:
    """Where a mesh lies in its run."""
    return f"meshes/{approach}/{frame:04d}.ply"


def read_clouds(folder: Path, names: Iterable[str]) -> list[Cloud]:
    """Clouds of a run, in their order; one without points where a sensor saw nothing."""
    points = np.empty((0, 3), np.float32)
    nothing = Cloud(points, points, points.astype(np.uint8), points[:, 0])
    paths = [fetched(folder / name) for name in names]
    return [read_cloud(path) if holds_points(path) else nothing for path in paths]


@dataclass(frozen=True, eq=False)
class Run:
    """A finished reconstruction.

    Parameters
    ----------
    folder : where it lies
    capture : rig, bounds and frame rate of the recording; its images may be elsewhere or gone
    approaches : names such as "pm_fb"
    frames : numbers of the recording's frames that were reconstructed
    versions : of what made it
    """

    folder: Path
    capture: Capture
    approaches: tuple[str, ...]
    frames: tuple[int, ...]
    versions: dict[str, str]

    @property
    def dataset(self) -> str:
        """The scene's name."""
        return self.capture.name


def read_run(folder: Path) -> Run:
    """Read a run.

    Raises
    ------
    ValueError
        If the folder is not a finished run.
    """
    path = folder / RUN_FILE
    if not is_there(path):
        raise ValueError(
            f"{address_of(folder)}: is not a finished run, it has no {RUN_FILE}; make one with `reconstudy reconstruct`"
        )
    content = read_json(fetched(path))
    if content.get("schema_version") != SCHEMA_VERSION:
        raise ValueError(
            f"{path}: schema_version is {content.get('schema_version')!r}, this program reads {SCHEMA_VERSION}"
        )
    draft = read_draft(folder)
    if draft.capture is None:
        raise CaptureError(draft.problems[0])
    try:
        return Run(
            folder,
            draft.capture,
            tuple(map(str, content["approaches"])),
            tuple(map(int, content["frames"])),
            dict(content["versions"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error!r} is missing or wrong; reconstruct again to write it anew") from error


def recorded_in(run: Run) -> Path:
    """The folder of the recording that a run was made of, if neither was moved.

    Raises
    ------
    ValueError
        If the run does not say.
    """
    recording = read_json(fetched(run.folder / RUN_FILE)).get("recording")
    if not isinstance(recording, str):
        raise ValueError(f"{run.folder / RUN_FILE}: does not say where its recording is; reconstruct again")
    return run.folder / place(recording)


def write_run(
    run: Run, *, options: Mapping[str, Any], timings: Mapping[str, float], warnings: Sequence[str]
) -> dict[str, Any]:
    """Write ``run.json`` and the capture's description beside it; returns the content of ``run.json``."""
    write_capture(replace(run.capture, folder=run.folder))
    names = [mesh_name(approach, frame) for approach in run.approaches for frame in run.frames]
    content = {
        "schema_version": SCHEMA_VERSION,
        "dataset": run.dataset,
        "recording": _recording(run),
        "approaches": list(run.approaches),
        "frames": list(run.frames),
        "options": dict(options),
        "versions": run.versions,
        "warnings": list(warnings),
        "seconds": {stage: round(seconds, 3) for stage, seconds in timings.items()},
        "meshes": dict(zip(names, Artefacts(run.folder).digests(names), strict=True)),
    }
    write_json(run.folder / RUN_FILE, content)
    stored(run.folder / RUN_FILE)
    return content


def _recording(run: Run) -> str:
    """Where the recording is: its URL, or its path from the run."""
    folder = run.capture.folder
    return address_of(folder) if is_copy(folder) else Path(os.path.relpath(folder, run.folder)).as_posix()


def continue_log(folder: Path) -> None:
    """Go on with the log of an earlier start."""
    if is_there(folder / LOG_FILE):
        fetched(folder / LOG_FILE)


def keep_log(folder: Path) -> None:
    """Put the log where the run is; nothing can be appended to a file behind a URL."""
    if (folder / LOG_FILE).is_file():
        stored(folder / LOG_FILE)


def log(folder: Path, event: Mapping[str, Any]) -> None:
    """Append one event to the run's ``log.jsonl``: a whole line or nothing."""
    path = folder / LOG_FILE
    before = path.stat().st_size if path.exists() else 0
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(event) + "\n")
    except OSError:
        os.truncate(path, before)
        raise


def versions() -> dict[str, str]:
    """Of this program and of what its results depend on."""
    packages = ("reconstudy", "numpy", "numba", "opencv-python-headless")
    return {"python": platform.python_version(), **{package: version(package) for package in packages}}

"""A run on disk: where each file of a reconstruction lies, and what ``run.json`` says about them.

How a run knows what is finished and what is in it: every stage leaves a note in ``.finished/`` for each file that it
finished, with the digests of what the file was made from and of the file itself, and makes only what has no such note
(`Artefacts`). When all stages are done, ``run.json`` is written last, and lists approaches, frames, parameters,
warnings and the meshes' digests: a folder without it is no run yet.

A run is ``run.json``, ``log.jsonl`` (each file when it was made), ``capture.json`` (the rig and bounds),
``matched/<method>/<sensor>/<frame>.tiff`` and ``depth/<method>/<sensor>/<frame>.tiff`` (disparities before and after
filtering in time),
``programs/<method>/<sensor>/<frame>/log.txt`` and ``programs/<approach>/<frame>/log.txt`` (what programs of others
printed), ``clouds/<method>/<sensor>/<frame>.ply``, ``meshes/<approach>/<frame>.ply`` (``.glb`` with a texture,
``.parquet`` if it is packed), and ``previews/<frame>.png`` to look at.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from recon.capture.format import Capture, CaptureError, read_draft, write_capture
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import holds_points, read_cloud
from recon.geometry.packed import PACKED
from recon.methods.approaches import VERTICES, parse_approach
from recon.runtime.artefacts import NOTES, Artefacts
from recon.runtime.files import read_json, write_json
from recon.runtime.remote import address_of, fetched, is_copy, is_there, place, stored

SCHEMA_VERSION = 1
RUN_FILE = "run.json"
LOG_FILE = "log.jsonl"
ROWS_NAME = "rows/{sensor}.json"  # how far the rows of a sensor's rectified pictures are apart
COLOURS_NAME = "colours.json"  # gains and offsets of the sensors' colours
EXPOSURES_NAME = "exposures.json"  # gains of the cameras' photographs
OWN = (LOG_FILE, "programs")  # what may lie in a run of which nothing is finished yet


def check_is_run(folder: Path) -> None:
    """Raise a ValueError if a folder holds what no reconstruction wrote, which a run would mix its files with."""
    entries = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    if {RUN_FILE, NOTES}.isdisjoint(entries):
        for name in entries:
            if name not in OWN and not name.startswith("."):
                raise ValueError(
                    f"{folder}: holds {name}, which no reconstruction wrote; choose another folder for the run"
                )


_NO_POINTS = np.empty((0, 3), np.float32)
NO_CLOUD = Cloud(_NO_POINTS, _NO_POINTS, _NO_POINTS.astype(np.uint8), _NO_POINTS[:, 0])  # where a sensor saw nothing


def mesh_name(approach: str, frame: int, *, packed: bool = False) -> str:
    """Name the mesh of a frame by an approach; a plain one is GLB if it has a texture, else PLY.

    Parameters
    ----------
    approach, frame : such as "pm_fb", and the recording's number
    packed : whether it is stored as Parquet
    """
    plain = ".ply" if parse_approach(approach).colour == VERTICES else ".glb"
    return f"meshes/{approach}/{frame:04d}{PACKED if packed else plain}"


def fusion_folder(approach: str, frame: int) -> str:
    """Name the folder where a program of somebody else's makes a mesh, with its log."""
    return f"programs/{approach}/{frame:04d}"


class View(NamedTuple):
    """A frame of a sensor by a depth method, and where its files lie in a run."""

    method: str
    sensor_id: str
    frame: int

    @property
    def matched(self) -> str:
        """The disparity map of the frame by itself."""
        return f"matched/{self.method}/{self.sensor_id}/{self.frame:04d}.tiff"

    @property
    def program(self) -> str:
        """The folder where a program of somebody else's matches the frame, with its log."""
        return f"programs/{self.method}/{self.sensor_id}/{self.frame:04d}"

    @property
    def depth(self) -> str:
        """The disparity map, filtered in time."""
        return f"depth/{self.method}/{self.sensor_id}/{self.frame:04d}.tiff"

    @property
    def cloud(self) -> str:
        """The sensor's cloud."""
        return f"clouds/{self.method}/{self.sensor_id}/{self.frame:04d}.ply"


def read_clouds(artefacts: Artefacts, names: Iterable[str]) -> list[Cloud]:
    """Read clouds of a run, in their order; one without points where a sensor saw nothing."""
    return [read_cloud(path) if holds_points(path) else NO_CLOUD for path in map(artefacts.path, names)]


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
    recording : where the recording was, a URL or a path from the run; None if the run does not say
    static : approaches that have a model of the first frame alone
    packed : frames whose meshes are packed
    """

    folder: Path
    capture: Capture
    approaches: tuple[str, ...]
    frames: tuple[int, ...]
    versions: dict[str, str]
    recording: str | None
    static: tuple[str, ...] = ()
    packed: tuple[int, ...] = ()

    def frames_of(self, approach: str) -> tuple[int, ...]:
        """Return the frames that an approach has models of."""
        return self.frames[:1] if approach in self.static else self.frames

    def shown_in(self, approach: str, frame: int) -> int:
        """Return the frame whose model an approach shows in a frame."""
        return frame if frame in self.frames_of(approach) else self.frames[0]

    def mesh_name(self, approach: str, frame: int) -> str:
        """Name the mesh that an approach shows in a frame."""
        shown = self.shown_in(approach, frame)
        return mesh_name(approach, shown, packed=shown in self.packed)

    @property
    def dataset(self) -> str:
        """The scene's name."""
        return self.capture.name

    @property
    def artefacts(self) -> Artefacts:
        """The run's finished files."""
        return Artefacts(self.folder)


def approaches_before(folder: Path) -> list[str]:
    """Return the approaches that an earlier, finished start of a run names; none where there was none."""
    path = folder / RUN_FILE
    return list(read_json(fetched(path)).get("approaches", ())) if is_there(path) else []


def read_run(folder: Path) -> Run:
    """Read a run, or raise a ValueError if the folder is not a finished one."""
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
    recording = content.get("recording")
    try:
        return Run(
            folder,
            draft.capture,
            tuple(map(str, content["approaches"])),
            tuple(map(int, content["frames"])),
            dict(content["versions"]),
            recording if isinstance(recording, str) else None,
            tuple(map(str, content.get("static", ()))),
            tuple(map(int, content.get("packed", ()))),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error!r} is missing or wrong; reconstruct again to write it anew") from error


def recorded_fps(meshes: Path) -> float | None:
    """Return the frame rate of the run that a folder of meshes belongs to, as RUN/meshes/APPROACH; None for none."""
    run = meshes.resolve().parent.parent
    return read_run(run).capture.fps if is_there(run / RUN_FILE) else None


def address_from(folder: Path, recording: Path) -> str:
    """Return how a run's folder refers to its recording: by URL, or by the path from the folder."""
    return address_of(recording) if is_copy(recording) else Path(os.path.relpath(recording, folder)).as_posix()


def recorded_in(run: Run) -> Path:
    """Return the folder of the recording of a run, if neither was moved; a ValueError if the run does not say."""
    if run.recording is None:
        raise ValueError(f"{run.folder / RUN_FILE}: does not say where its recording is; reconstruct again")
    return run.folder / place(run.recording)


def write_run(
    run: Run, *, options: Mapping[str, Any], timings: Mapping[str, float], warnings: Sequence[str]
) -> dict[str, Any]:
    """Write ``run.json``, which makes a folder a run, with the capture's description beside it, and return its content.

    Parameters
    ----------
    run : whose meshes are finished
    options : of the reconstruction, for JSON
    timings : seconds that each stage took at this start
    warnings : what the stages warned of, a sentence each
    """
    write_capture(replace(run.capture, folder=run.folder))
    names = [run.mesh_name(approach, frame) for approach in run.approaches for frame in run.frames_of(approach)]
    content = {
        "schema_version": SCHEMA_VERSION,
        "dataset": run.dataset,
        "recording": run.recording,
        "approaches": list(run.approaches),
        "frames": list(run.frames),
        "static": list(run.static),
        "packed": list(run.packed),
        "options": dict(options),
        "versions": run.versions,
        "warnings": list(warnings),
        "seconds": {stage: round(seconds, 3) for stage, seconds in timings.items()},
        "meshes": dict(zip(names, run.artefacts.digests(names), strict=True)),
    }
    write_json(run.folder / RUN_FILE, content)
    stored(run.folder / RUN_FILE)
    return content


def fetch_log(folder: Path) -> None:
    """Bring the log of an earlier start here, if the run is behind a URL."""
    if is_there(folder / LOG_FILE):
        fetched(folder / LOG_FILE)


def store_log(folder: Path) -> None:
    """Put the log where the run is: nothing can be appended to a file behind a URL."""
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
    """Return the versions of this program and of what its results depend on."""
    packages = ("reconstudy", "numpy", "numba", "opencv-python-headless")
    return {"python": platform.python_version(), **{package: version(package) for package in packages}}

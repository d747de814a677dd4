"""What is filmed: the approaches of runs and of models folders, each a sequence of models, in the setting of its scene.

All films of a scene have one setting: the same bounds, and with them the same floor and light, and the same cameras.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Model
from recon.geometry.mesh_files import read_mesh
from recon.geometry.rig import Camera, Rig
from recon.methods.approaches import levels_of
from recon.models.folder import find_models
from recon.models.inspection import Facts, inspect_model
from recon.models.read import Placement, read_model
from recon.models.scene_file import SCENE_FILE, Orbit, orbit_rig, read_scene_file
from recon.pipeline.run import RUN_FILE, Run, read_run
from recon.render.camera_path import camera_path
from recon.render.path_file import read_path
from recon.runtime.artefacts import file_digest
from recon.runtime.remote import address_of, fetched, is_copy, is_there

MOST_PROBLEMS = 10  # to print


@dataclass(frozen=True, eq=False)
class ModelSequence:
    """An approach's models of a scene, in the order of the recording.

    Parameters
    ----------
    dataset, approach : names of the scene and of the approach
    levels : its level of each factor that it has one of
    fps : models a second
    files, digests : of each model; of a models folder's, the digest is known once it was inspected
    placement : how models from outside come into the world; None for a run's meshes, which stand there
    is_still : whether it shows one model throughout, as nothing else is known of it
    sizes : bytes of each model with what belongs to it, once it was inspected; 0 where that is not known
    """

    dataset: str
    approach: str
    levels: Mapping[str, str]
    fps: float
    files: tuple[Path, ...]
    digests: tuple[str, ...]
    placement: Placement | None = None
    is_still: bool = False
    sizes: tuple[int, ...] = ()

    def first(self) -> ModelSequence:
        """Return the sequence of its first model alone."""
        return replace(self, files=self.files[:1], digests=self.digests[:1])

    def read(self, index: int) -> Model:
        """Read a model; the same one again is the same object.

        Raises
        ------
        ValueError
            If it is not the file whose digest is known.
        """
        return _read_once(self.files[index], self.digests[index], self.placement)


@dataclass(frozen=True, eq=False)
class SceneSetting:
    """What the films of a scene have in common.

    Parameters
    ----------
    source : the folder that says so, for messages
    bounds : float64 (2, 3), mm; None as long as they follow from models that were not read
    rig : sensors that the camera passes; None for an orbit or a file
    orbit, file : what it follows instead of sensors
    floor_y : height of the floor, mm; None for the bottom of the bounds
    """

    source: str
    bounds: NDArray[np.float64] | None
    rig: Rig | None = None
    orbit: Orbit | None = None
    file: Path | None = None
    floor_y: float | None = None

    def cameras(self, path: str | Path, n_frames: int, size: tuple[int, int]) -> tuple[Camera, ...]:
        """Place a camera for each frame.

        Parameters
        ----------
        path : kind of a path or file of one, as chosen for all scenes; "auto" leaves it to the setting
        n_frames : of the film
        size : (width, height), pixels

        Raises
        ------
        ValueError
            If the path does not fit the film or the setting.
        """
        file = path if isinstance(path, Path) else self.file if path == "auto" else None
        if file is not None:
            return read_path(file, n_frames, size)
        if self.rig is None and self.orbit is None:
            raise ValueError(
                f"{self.source}: has the cameras of a file, so the path cannot be {path}; leave out --path"
            )
        assert self.bounds is not None, "they are known once the models were read"
        rig = orbit_rig(self.orbit, self.bounds) if self.orbit is not None else self.rig
        assert rig is not None
        kind = "orbit" if path == "auto" and self.orbit is not None else str(path)
        return camera_path(rig, self.bounds, n_frames, size, kind=kind)


@dataclass(frozen=True, eq=False)
class Source:
    """A run or a models folder.

    Parameters
    ----------
    dataset : name of its scene
    sequences : its approaches
    setting : of its scene
    provenance : for the manifest
    is_run : which of the two it is
    recorded_as : name of the recording whose sensors its path follows; empty where there is none
    """

    dataset: str
    sequences: tuple[ModelSequence, ...]
    setting: SceneSetting
    provenance: dict[str, Any] = field(default_factory=dict)
    is_run: bool = True
    recorded_as: str = ""


def scenes_apart(sources: Sequence[Source], practice: str) -> list[str]:
    """Return a sentence for each models folder that is filmed as another scene than the run whose sensors it follows.

    Parameters
    ----------
    sources : all that is filmed
    practice : name of the scene for practice, which is another one on purpose
    """
    runs = {source.dataset for source in sources if source.is_run}
    return [
        f"{source.setting.source}: {source.dataset} is filmed by the sensors of {source.recorded_as}, but is another "
        f"scene, so nobody compares the two; to compare them, write {source.recorded_as} as the dataset in {SCENE_FILE}"
        for source in sources
        if source.recorded_as in runs - {source.dataset} and source.dataset != practice
    ]


def read_sources(folders: Sequence[Path]) -> list[Source]:
    """Read runs and models folders, without their models.

    Raises
    ------
    ValueError
        If a folder is neither, something is wrong in one, or two have an approach of a scene in common; every fault is
        a line of the message.
    """
    sources, problems = [], []
    for folder in folders:
        if is_there(folder / RUN_FILE):
            sources.append(run_source(read_run(folder)))
            continue
        if not is_copy(folder) and not folder.is_dir():
            problems.append(f"{folder}: there is no such folder")
            continue
        if not is_there(folder / SCENE_FILE):
            problems.append(
                f"{address_of(folder)}: is not a finished run, it has no {RUN_FILE} (make one with `reconstudy "
                f"reconstruct`), and no models folder, it has no {SCENE_FILE}"
            )
            continue
        source, faults = _read_models_folder(folder)
        problems += faults
        sources += [source] if source is not None else []
    levels = levels_of(item.approach for source in sources if source.is_run for item in source.sequences)
    sources = [
        replace(source, sequences=tuple(replace(item, levels=levels[item.approach]) for item in source.sequences))
        if source.is_run
        else source
        for source in sources
    ]
    names = Counter((item.dataset, item.approach) for source in sources for item in source.sequences)
    problems += [
        f"{dataset}: {n} of the folders have models by {approach}; give each approach of a scene a name of its own"
        for (dataset, approach), n in names.items()
        if n > 1
    ]
    raise_problems(problems)
    return sources


def run_source(run: Run) -> Source:
    """Return a run as what is filmed."""
    sequences = []
    levels = levels_of(run.approaches)
    for approach in run.approaches:
        names = [run.mesh_name(approach, frame) for frame in run.frames_of(approach)]
        sequences.append(
            ModelSequence(
                run.dataset,
                approach,
                levels[approach],
                run.capture.fps,
                tuple(run.folder / name for name in names),
                tuple(run.artefacts.digests(names)),
                is_still=approach in run.static,
            )
        )
    setting = SceneSetting(address_of(run.folder), run.capture.bounds, run.capture.rig)
    return Source(run.dataset, tuple(sequences), setting, {"dataset": run.dataset, "versions": run.versions})


def inspect_file(file: Path, digest: str, placement: Placement | None) -> tuple[Path, Facts]:
    """Return a model's file and what is known of it; one of a run behind a URL is checked when it is read.

    Parameters
    ----------
    file, digest, placement : of the model, as in `ModelSequence`
    """
    if placement is not None:
        return file, inspect_model(file, placement)
    try:
        if not is_copy(file):
            _check_unchanged(file, digest)
    except ValueError as error:
        return file, Facts(problem=str(error))
    return file, Facts(digest, n_bytes=0 if is_copy(file) else file.stat().st_size)


def raise_problems(problems: Sequence[str]) -> None:
    """Raise a ValueError of all problems, a line each, if there are any."""
    if problems:
        more = [f"and {len(problems) - MOST_PROBLEMS} more"] if len(problems) > MOST_PROBLEMS else []
        raise ValueError("\n".join([*problems[:MOST_PROBLEMS], *more]))


def _read_models_folder(folder: Path) -> tuple[Source | None, list[str]]:
    """Return a models folder as what is filmed if nothing is wrong, and a sentence for each fault."""
    if is_copy(folder):
        return None, [f"{address_of(folder)}: a models folder cannot be behind a URL; copy it to a folder"]
    scene, problems = read_scene_file(folder)
    models, faults = find_models(folder)
    problems += faults
    if scene is None:
        return None, problems
    for key, names in (("levels", scene.levels), ("static", scene.static), ("placements", scene.placements)):
        problems += [
            f"{scene.file}: {key} names {name!r}, which has no model here; there are {', '.join(models) or 'none'}"
            for name in names
            if name not in models
        ]
    sequences = []
    for approach, files in models.items():
        is_still = approach in scene.static or files[0].parent == folder
        levels = scene.levels.get(approach, {})
        empty = ("",) * len(files)
        placement = scene.placement_of(approach, files[0], problems)
        item = ModelSequence(scene.dataset, approach, levels, scene.fps, files, empty, placement, is_still)
        sequences.append(item)
    capture = scene.path.capture
    setting = SceneSetting(
        str(folder),
        scene.bounds,
        None if capture is None else capture.rig,
        scene.path.orbit,
        scene.path.file,
    )
    provenance = {"dataset": scene.dataset, "scene": scene.content, "scene_sha256": scene.digest}
    recorded_as = "" if capture is None else capture.name
    return Source(scene.dataset, tuple(sequences), setting, provenance, is_run=False, recorded_as=recorded_as), problems


@lru_cache(maxsize=1)
def _read_once(file: Path, digest: str, placement: Placement | None) -> Model:
    """Read a model once for all frames in a row that show it, so that the renderer gets the same object."""
    if placement is None:
        path = fetched(file)
        _check_unchanged(path, digest)
        return read_mesh(path)
    model = read_model(file, placement)
    if model.digest != digest:
        raise ValueError(f"{file}: was changed while it was filmed; render again")
    return model.model


def _check_unchanged(path: Path, digest: str) -> None:
    """Raise a ValueError if a mesh of a run is not the one that was reconstructed."""
    if not path.is_file():
        raise ValueError(f"{path}: this mesh of the run is missing; reconstruct again to make it anew")
    if file_digest(path) != digest:
        raise ValueError(
            f"{path}: is not the mesh that was reconstructed here; reconstruct again to make it anew, and put models "
            f"of other programs into a models folder with a {SCENE_FILE}"
        )

"""Merge stimulus sets into one: ours, other programs', or somebody else's videos that were imported."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from app.errors import StimuliError
from app.ffmpeg import Progress, in_parallel, no_progress
from app.files import file_digest, read_json, whole_folder, write_json
from app.intake.stimuli import MANIFEST, Stimulus, StimulusSet, check_videos, level_notes, read_manifest
from ground.file_models import SCHEMA_KEY, first_fault, schema_name


@dataclass(frozen=True)
class NewSet:
    """A stimulus set that was made, and sentences on what its maker should know."""

    stimulus_set: StimulusSet
    notes: tuple[str, ...]


class _PathFile(BaseModel):
    """The camera path of a dataset, as a manifest's provenance names it."""

    file: Annotated[str, Field(min_length=1)]
    sha256: str


class _Provenance(BaseModel):
    """The part of a manifest's provenance that is compared."""

    paths: dict[str, _PathFile] = {}


@dataclass(frozen=True)
class _Source:
    """A set to merge.

    Parameters
    ----------
    manifest : as it was written, with the keys that a study does not need
    paths : the camera path of each dataset that has one
    """

    stimulus_set: StimulusSet
    manifest: Mapping[str, Any]
    paths: Mapping[str, _PathFile]

    @property
    def folder(self) -> Path:
        return self.stimulus_set.folder

    @property
    def origin(self) -> dict[str, Any]:
        """Where its videos come from, for the provenance of what is made of them."""
        provenance = self.manifest.get("provenance", {})
        return {
            "name": self.stimulus_set.name,
            "manifest_sha256": self.stimulus_set.sha256,
            "provenance": provenance,
        }

    def entries(self, kind: str) -> Iterator[tuple[Stimulus, dict[str, Any]]]:
        """Yield the stimuli, or those for practice, with their entries in the manifest."""
        stimuli = self.stimulus_set.stimuli if kind == "stimuli" else self.stimulus_set.practice
        yield from zip(stimuli, self.manifest.get(kind, ()), strict=True)


def merge_sets(folders: Sequence[Path], out: Path, *, progress: Progress = no_progress) -> NewSet:
    """Copy the videos, masters, masks and camera paths of several stimulus sets into one, after checking all of them.

    Parameters
    ----------
    folders : the sets, or their manifests; the first comes first in every order
    out : the new set's folder, missing or empty
    progress : called after each video

    Raises
    ------
    StimuliError
        If a set cannot be used, two sets hold different films of the same dataset and approach or show a dataset by
        different camera paths, or the films of a dataset differ in size, frame rate, length or codec. No file is left
        behind.
    """
    refuse_used(out)
    sources = [_read(folder) for folder in folders]
    chosen = _chosen(sources)
    _check_codecs(chosen)
    paths = _camera_paths(sources)
    practice = next((source for source in sources if source.stimulus_set.practice), None)
    copies = _Copies()
    with whole_folder(out) as temporary:
        manifest = {
            SCHEMA_KEY: schema_name("manifest"),
            "schema_version": 1,
            "name": out.resolve().name,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "stimuli": [copies.entry(source, stimulus, entry) for source, stimulus, entry in chosen],
            "factors": _factors(sources),
            "practice": [copies.entry(practice, *entry) for entry in practice.entries("practice")] if practice else [],
            "provenance": {
                "merged": [source.origin for source in sources],
                "paths": {dataset: copies.path(source, path) for dataset, (source, path) in paths.items()},
            },
        }
        write_json(temporary / MANIFEST, manifest)
        made = read_manifest(temporary, Path(" + ".join(str(source.folder) for source in sources)))
        for source in sources:
            check_videos(source.stimulus_set, progress)
        copies.write(temporary, progress)
    made = replace(made, folder=out)
    return NewSet(made, (*_repeated(sources), *_practice_notes(sources), *set_notes(made)))


def files_of_set(folder: Path) -> list[str]:
    """Return the names of all files of a stimulus set: its manifest, films, masters, masks and camera paths.

    Raises
    ------
    StimuliError
        If the manifest or a camera path cannot be used.
    """
    source = _read(folder)
    stimuli = (*source.stimulus_set.stimuli, *source.stimulus_set.practice)
    films = [file for stimulus in stimuli for file in (stimulus.video, stimulus.master, stimulus.mask) if file]
    return list(dict.fromkeys([MANIFEST, *films, *(path.file for path in source.paths.values())]))


def refuse_used(out: Path) -> None:
    """Raise if the folder of a new set is not missing or empty."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise StimuliError(f"{out}: is not empty; choose a new folder for the stimulus set")


def set_notes(made: StimulusSet) -> list[str]:
    """Return what the maker of a set should know: missing masters, levels and films."""
    notes = level_notes(made)
    for dataset in made.datasets:
        stimuli = made.of_dataset(dataset)
        without = [stimulus.approach for stimulus in stimuli if stimulus.master is None]
        if 0 < len(without) < len(stimuli):
            notes.append(
                f"{dataset}: no master of {', '.join(without)}, which the others have; a study encodes these once more"
            )
        if absent := [name for name in made.conditions if name not in {stimulus.approach for stimulus in stimuli}]:
            notes.append(f"{dataset}: no film of {', '.join(absent)}, which other datasets have")
    return notes


class _Copies:
    """The files to copy, by their path in the new set."""

    def __init__(self) -> None:
        self.targets: dict[str, Path] = {}

    def entry(self, source: _Source, stimulus: Stimulus, entry: Mapping[str, Any]) -> dict[str, Any]:
        """Plan the copies of a stimulus's files, and return its entry in the new manifest."""
        files = {"video": stimulus.video, "master": stimulus.master, "mask": stimulus.mask}
        places = {key: self._place(source.folder, file) for key, file in files.items() if file is not None}
        return {**entry, **places}

    def path(self, source: _Source, path: _PathFile) -> dict[str, str]:
        """Plan the copy of a camera path, and return what the new provenance says of it."""
        return {"file": self._place(source.folder, path.file), "sha256": path.sha256}

    def write(self, folder: Path, progress: Progress) -> None:
        steps = [(f"copying {target}", partial(_copy, path, folder / target)) for target, path in self.targets.items()]
        in_parallel(steps, progress)

    def _place(self, folder: Path, file: str) -> str:
        """Choose where a file comes to lie: where it lay, unless another set has a file there."""
        path = (folder / file).resolve()
        lay = target = path.relative_to(folder.resolve()).as_posix()
        number = 1
        while self.targets.setdefault(target, path) != path:
            number += 1
            target = f"{number}/{lay}"
        return target


def _copy(path: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)


def _read(folder: Path) -> _Source:
    stimulus_set = read_manifest(folder)
    manifest_path = folder / MANIFEST if folder.is_dir() else folder
    manifest = read_json(manifest_path)
    try:
        provenance = _Provenance.model_validate(manifest.get("provenance") or {})
    except ValidationError as error:
        raise StimuliError(f"{manifest_path}: provenance.{first_fault(error, _Provenance)}") from error
    paths = {dataset: path for dataset, path in provenance.paths.items() if dataset in stimulus_set.datasets}
    for dataset, path in paths.items():
        _check_path(stimulus_set.folder, dataset, path)
    return _Source(stimulus_set, manifest, paths)


def _check_path(folder: Path, dataset: str, path: _PathFile) -> None:
    file = folder / path.file
    if not file.resolve().is_relative_to(folder.resolve()):
        raise StimuliError(f"{file}: the camera path of {dataset} lies outside the stimulus set's folder")
    if not file.is_file():
        raise StimuliError(f"{file}: the camera path of {dataset} is missing; copy the whole folder of the set")
    if (sha256 := file_digest(file)) != path.sha256:
        raise StimuliError(f"{file}: its SHA-256 is {sha256}, the manifest says {path.sha256}; it was changed")


def _chosen(sources: Sequence[_Source]) -> list[tuple[_Source, Stimulus, dict[str, Any]]]:
    """Return every stimulus once; those of a dataset together, in the order of the sets."""
    first: dict[tuple[str, str], tuple[_Source, Stimulus, dict[str, Any]]] = {}
    for source in sources:
        for stimulus, entry in source.entries("stimuli"):
            other, same, _ = first.setdefault((stimulus.dataset, stimulus.approach), (source, stimulus, entry))
            if same.sha256 != stimulus.sha256 or same.levels != stimulus.levels:
                differs = "films" if same.sha256 != stimulus.sha256 else "levels"
                raise StimuliError(
                    f"{other.folder} and {source.folder} both hold {stimulus.name}, with different {differs}; import "
                    "or render one of them under another name, or leave it out"
                )
    datasets = list(dict.fromkeys(dataset for dataset, _ in first))
    return sorted(first.values(), key=lambda place: datasets.index(place[1].dataset))


def _check_codecs(chosen: Sequence[tuple[_Source, Stimulus, dict[str, Any]]]) -> None:
    first: dict[str, tuple[_Source, Stimulus]] = {}
    for source, stimulus, _ in chosen:
        if stimulus.codec:
            other, usual = first.setdefault(stimulus.dataset, (source, stimulus))
            if usual.codec != stimulus.codec:
                raise StimuliError(
                    f"{source.folder}: {stimulus.name} is encoded as {stimulus.codec}, {usual.name} in {other.folder} "
                    f"as {usual.codec}; the stimuli of a dataset must be alike: encode both in the same way"
                )


def _camera_paths(sources: Sequence[_Source]) -> dict[str, tuple[_Source, _PathFile]]:
    """Return the camera path of each dataset that has one, with the set that it lies in."""
    paths: dict[str, tuple[_Source, _PathFile]] = {}
    for source in sources:
        for dataset, path in source.paths.items():
            other, same = paths.setdefault(dataset, (source, path))
            if same.sha256 != path.sha256:
                raise StimuliError(
                    f"{other.folder / same.file} and {source.folder / path.file} are different camera paths of "
                    f"{dataset}; render one of the sets again with --path and a copy of the other's file"
                )
    return paths


def _factors(sources: Sequence[_Source]) -> dict[str, list[str]]:
    """Unite the levels of each factor, in the order of the sets."""
    factors: dict[str, dict[str, None]] = {}
    for source in sources:
        for factor, levels in source.stimulus_set.factors.items():
            factors.setdefault(factor, {}).update(dict.fromkeys(levels))
    return {factor: list(levels) for factor, levels in factors.items()}


def _repeated(sources: Sequence[_Source]) -> Iterator[str]:
    names = [stimulus.name for source in sources for stimulus in source.stimulus_set.stimuli]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        yield f"{name} is the same film in {names.count(name)} sets: taken once"


def _practice_notes(sources: Sequence[_Source]) -> Iterator[str]:
    with_practice = [source for source in sources if source.stimulus_set.practice]
    for other in with_practice[1:]:
        yield f"the films for practice are those of {with_practice[0].folder}, not those of {other.folder}"

"""Which files are compared: clouds by approach and frame, and the reference by frame."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from recon.models.read import READERS
from recon.pipeline.run import RUN_FILE, Run, read_run
from recon.runtime.files import check_exists
from recon.validation.clouds import TEXT_SUFFIXES
from recon.validation.measures import EVERY_DATASET, Subject

MOST_TOLD = 10  # frames, in a sentence
SUFFIXES = (*READERS, *TEXT_SUFFIXES)
REFERENCE_FOLDERS = (".", "mesh", "truth/mesh")  # where a synthetic capture has its true meshes

Files = Mapping[int | None, Path]  # by number of the frame; None for a single cloud without number


@dataclass(frozen=True)
class Compared:
    """What is compared with what.

    Parameters
    ----------
    dataset : the scene's name
    approaches : files of each approach, the same frames of all
    reference : files by frame; one for None stands for every frame
    left_out : a sentence for each approach that has frames which are not compared
    """

    dataset: str
    approaches: Mapping[str, Files]
    reference: Files
    left_out: tuple[str, ...]

    @property
    def frames(self) -> tuple[int | None, ...]:
        """The frames, in order."""
        return tuple(next(iter(self.approaches.values())))

    def reference_of(self, frame: int | None) -> Path:
        """Return the file that a frame is compared with."""
        return self.reference[frame if frame in self.reference else None]


def find_compared(
    clouds: Sequence[Path],
    reference: Path,
    *,
    names: Sequence[str] = (),
    dataset: str | None = None,
    frames: range | None = None,
) -> Compared:
    """Find the frames that all clouds and the reference share.

    Parameters
    ----------
    clouds : files, folders with a file for each frame, or runs, which are all their approaches
    reference : a file, or a folder with a file for each frame, such as CAPTURE/truth
    names : of the approaches that the clouds belong to, in order, runs left out; else those of files and folders
    dataset : scene; None for that of the runs, or all
    frames : to compare; None for all

    Raises
    ------
    ValueError
        If a file or folder is missing or has no frames, names are empty or do not fit, or no frame is shared.
    """
    subject = Subject(EVERY_DATASET if dataset is None else dataset, tuple(names))
    approaches, datasets = _approaches(clouds, subject.approaches)
    references = _frames_of(_reference_folder(reference))
    numbered = [None not in files for files in approaches.values()]
    if any(numbered) and not all(numbered):
        raise ValueError("some of the clouds are files, others folders of frames; expected all of one kind")
    if not numbered[0] and None not in references:
        raise ValueError(
            f"{reference}: is a folder of frames, but {next(iter(approaches.values()))[None]} is a single cloud; give "
            "the file of its frame as the reference, or the cloud's folder"
        )
    shared = {
        frame
        for frame in next(iter(approaches.values()))
        if all(frame in files for files in approaches.values())
        and (frame in references or None in references)
        and (frames is None or frame is None or frame in frames)
    }
    if not shared:
        told = "; ".join(f"{name}: {_told(files)}" for name, files in approaches.items())
        end = "the last" if frames is None or frames.stop == sys.maxsize else frames.stop - 1
        asked = "" if frames is None else f", asked for {frames.start} to {end}"
        raise ValueError(f"there is no frame that all have ({told}; {reference}: {_told(references)}{asked})")
    ordered = sorted(shared, key=lambda frame: -1 if frame is None else frame)
    return Compared(
        datasets[0] if dataset is None and len(set(datasets)) == 1 else subject.dataset,
        {name: {frame: files[frame] for frame in ordered} for name, files in approaches.items()},
        references,
        _left_out(approaches, shared, frames),
    )


def _approaches(clouds: Sequence[Path], names: Sequence[str]) -> tuple[dict[str, Files], list[str]]:
    """Return the files of each approach, and the datasets of the runs among the clouds."""
    if not clouds:
        raise ValueError("there is no cloud to measure")
    runs = [cloud for cloud in clouds if (cloud / RUN_FILE).is_file()]
    n_named = len(clouds) - len(runs)
    if names and len(names) != n_named:
        raise ValueError(
            f"{len(names)} names of approaches for {n_named} clouds"
            + (" beside a run, whose approaches have names" if runs else "")
            + f": {', '.join(names)}; expected one for each, in order"
        )
    remaining = iter(names)
    approaches: dict[str, Files] = {}
    datasets = []
    for cloud in clouds:
        if cloud in runs:
            run = read_run(cloud)
            datasets.append(run.dataset)
            files = {name: _run_frames(run, name) for name in run.approaches}
        else:
            files = {next(remaining, cloud.stem if cloud.is_file() else cloud.resolve().name): _frames_of(cloud)}
        if twice := next((name for name in files if name in approaches), None):
            meshes = next(iter(files[twice].values())).parent
            instead = f"give {meshes} instead of the run" if cloud in runs else "tell them apart"
            raise ValueError(f"{cloud}: there is a cloud of {twice} already; {instead}, with --approach NAME")
        approaches |= files
    return approaches, datasets


def _run_frames(run: Run, approach: str) -> Files:
    return {frame: run.folder / run.mesh_name(approach, frame) for frame in run.frames_of(approach)}


def _reference_folder(reference: Path) -> Path:
    """Return the file, or the folder that has the frames."""
    if not reference.is_dir():
        return reference
    folders = [reference / name for name in REFERENCE_FOLDERS]
    return next((folder for folder in folders if _cloud_files(folder)), reference)


def _frames_of(path: Path) -> Files:
    """Return a file, or those of a folder by the numbers that their names end with."""
    if path.is_file():
        return {None: path}
    check_exists(path)
    files: dict[int | None, Path] = {}
    for file in _cloud_files(path):
        number = re.search(r"\d+$", file.stem)
        if number is None:
            raise ValueError(f"{file}: its name has no number of a frame at its end, such as 0001{file.suffix}")
        if (frame := int(number[0])) in files:
            raise ValueError(f"{path}: {files[frame].name} and {file.name} are both frame {frame}")
        files[frame] = file
    if not files:
        raise ValueError(f"{path}: holds no cloud; expected FRAME.ply for every frame, or give the file of one cloud")
    return files


def _cloud_files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(
        file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
    )


def _left_out(approaches: Mapping[str, Files], shared: set[int | None], asked: range | None) -> tuple[str, ...]:
    sentences = []
    for name, files in approaches.items():
        rest = sorted(f for f in files if f not in shared and f is not None and (asked is None or f in asked))
        if rest:
            told = ", ".join(map(str, rest[:MOST_TOLD])) + (" and more" if len(rest) > MOST_TOLD else "")
            frames = f"frame {told} is" if len(rest) == 1 else f"frames {told} are"
            sentences.append(f"{name}: {frames} left out, because another approach or the reference lacks them")
    return tuple(sentences)


def _told(files: Files) -> str:
    numbers = sorted(frame for frame in files if frame is not None)
    return f"{len(numbers)} frames from {numbers[0]} to {numbers[-1]}" if numbers else "one cloud"

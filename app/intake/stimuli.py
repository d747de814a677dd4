"""Read a stimulus set from the reconstruction, and check every video in it; nothing else enters a study."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, ValidationError

from app.errors import StimuliError
from app.ffmpeg import Progress, VideoFacts, decode, in_parallel, no_progress
from app.files import file_digest, read_json_bytes
from app.intake.treatment import refuse_unready
from app.study.languages.text import check_text
from ground.fields import Expected
from ground.file_models import READS, FilePart, WholeFile, faults_of

MANIFEST = "manifest.json"
TOGETHER = "all"  # name of all datasets, or of all items, in results
FPS_TOLERANCE = 5e-4  # relative: 29.97 is 30000/1001, but 30 is not

Name = Annotated[str, Field(min_length=1, max_length=200), Expected("a text of 1 to 200 characters")]


class Stimulus(FilePart):
    """A video of an approach (or any other condition) on a dataset; keys that a study does not need are ignored."""

    model_config = ConfigDict(extra="ignore")

    dataset: Annotated[Name, Field(description="the scene; its stimuli are compared with one another")]
    approach: Annotated[Name, Field(description="the condition: an approach, or anything else that made the video")]
    levels: Annotated[
        dict[str, str],
        Field(description="level of each factor, for the comparison by factor; empty: none"),
        Expected("{FACTOR: LEVEL}"),
    ] = Field(default_factory=dict)
    video: Annotated[Name, Field(description="H.264 in MP4, its path from the manifest's folder")]
    master: Annotated[
        Name | None, Field(description="the same frames without loss; films of pairs are made of it where it is there")
    ] = None
    mask: Annotated[
        Name | None, Field(description="video of the model's silhouette, white on black, for the measures of films")
    ] = None
    sha256: Annotated[
        str,
        Field(pattern=r"^[0-9a-f]{64}$", description="of the file `video`"),
        Expected("64 hexadecimal digits in small letters"),
    ]
    width: Annotated[int, Field(ge=2, le=16384, description="pixels, even; alike in all stimuli of a dataset")]
    height: Annotated[int, Field(ge=2, le=16384, description="pixels, even; alike in all stimuli of a dataset")]
    fps: Annotated[float, Field(gt=0, le=1000, description="frames a second; alike in all stimuli of a dataset")]
    n_frames: Annotated[int, Field(ge=1, le=1_000_000, description="of the video; alike in all stimuli of a dataset")]
    codec: Annotated[str, Field(description="of the video, for the record")] = ""
    model_bytes: Annotated[
        int | None, Field(gt=0, description="size of the model's files, for the figure of score against size")
    ] = None
    renderer: Annotated[str, Field(description="what drew the frames, for the record")] = ""

    @property
    def name(self) -> str:
        return f"{self.dataset}/{self.approach}"


class Manifest(WholeFile):
    """The keys of `manifest.json`; others, such as `created`, `provenance` and a stimulus' `quality`, are ignored."""

    model_config = ConfigDict(extra="ignore")

    schema_version: Annotated[Literal[1], Field(description="of this file"), READS]
    name: Annotated[Name, Field(description="of the stimulus set")]
    stimuli: Annotated[list[Stimulus], Field(min_length=1, description="the videos, in the order of the results")]
    factors: Annotated[
        dict[str, list[str]],
        Field(description="levels of each factor, in the order of the results"),
        Expected("{FACTOR: [LEVEL, ...]}"),
    ] = Field(default_factory=dict)
    practice: Annotated[
        list[Stimulus],
        Field(description="two videos of a scene that is not compared, one clearly better; or none"),
    ] = Field(default_factory=list)


@dataclass(frozen=True)
class StimulusSet:
    """A checked stimulus set.

    Parameters
    ----------
    folder : the base of the manifest's paths
    name : the set's
    sha256 : of the manifest
    factors : levels by factor
    stimuli : in the manifest's order
    practice : two stimuli of a scene outside the study, one clearly better; or none
    """

    folder: Path
    name: str
    sha256: str
    factors: dict[str, list[str]]
    stimuli: tuple[Stimulus, ...]
    practice: tuple[Stimulus, ...] = ()

    @property
    def datasets(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(stimulus.dataset for stimulus in self.stimuli))

    @property
    def conditions(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(stimulus.approach for stimulus in self.stimuli))

    def without(self, *conditions: str) -> StimulusSet:
        """Return the set without some conditions."""
        return replace(
            self, stimuli=tuple(stimulus for stimulus in self.stimuli if stimulus.approach not in conditions)
        )

    def without_dataset(self, dataset: str) -> StimulusSet:
        """Return the set without a dataset, and without the levels that only it has."""
        stimuli = tuple(stimulus for stimulus in self.stimuli if stimulus.dataset != dataset)
        levels = {(factor, level) for stimulus in stimuli for factor, level in stimulus.levels.items()}
        left = {
            factor: [level for level in known if (factor, level) in levels] for factor, known in self.factors.items()
        }
        return replace(self, stimuli=stimuli, factors={factor: known for factor, known in left.items() if known})

    def of_dataset(self, dataset: str) -> tuple[Stimulus, ...]:
        return tuple(stimulus for stimulus in self.stimuli if stimulus.dataset == dataset)

    def source(self, stimulus: Stimulus) -> Path:
        """Return the file to make pair videos from: the lossless master where there is one, else the video."""
        return self.folder / (stimulus.master or stimulus.video)


def read_stimulus_set(path: Path, progress: Progress = no_progress) -> StimulusSet:
    """Read a stimulus set to make a study of, and check every video in it by decoding it.

    Parameters
    ----------
    path : the manifest, or its folder
    progress : called after each video

    Raises
    ------
    StimuliError
        If the manifest is not as described, a file is missing, has another digest, cannot be decoded or contradicts the
        manifest, the stimuli of a dataset differ in size, frame rate or length, or a dataset has only one.
    """
    stimulus_set = read_manifest(path, are_compared=True)
    check_videos(stimulus_set, progress)
    return stimulus_set


def read_manifest(path: Path, named: Path | None = None, *, are_compared: bool = False) -> StimulusSet:
    """Read a stimulus set's manifest, and check it without its files.

    Parameters
    ----------
    path : the manifest, or its folder
    named : what errors call it; None: by its path
    are_compared : expect two stimuli of each dataset

    Raises
    ------
    StimuliError
        If it is not as described, or the stimuli of a dataset differ in size, frame rate or length.
    """
    manifest_path = path / MANIFEST if path.is_dir() else path
    manifest, sha256 = _read_manifest(manifest_path)
    named = named or manifest_path
    stimulus_set = StimulusSet(
        manifest_path.parent,
        manifest.name,
        sha256,
        manifest.factors,
        tuple(manifest.stimuli),
        tuple(manifest.practice),
    )
    _check_names(stimulus_set, named)
    for dataset in stimulus_set.datasets if are_compared else ():
        if len(stimulus_set.of_dataset(dataset)) < 2:
            raise StimuliError(
                f"{named}: dataset {dataset} has one stimulus, expected at least two to compare",
                by_command="`reconstudy stimuli merge` joins it with other sets",
                on_page="add the other films, and send all of them together",
            )
    for dataset in stimulus_set.datasets:
        _check_alike(stimulus_set.of_dataset(dataset), named)
    _check_practice(stimulus_set, named)
    return stimulus_set


def level_notes(stimulus_set: StimulusSet) -> list[str]:
    """Return sentences on the conditions that a comparison by factor leaves out, as they have no level of one."""
    without: dict[str, list[str]] = {}
    levels = {stimulus.approach: stimulus.levels for stimulus in stimulus_set.stimuli}
    for condition, by_factor in levels.items():
        if missing := ", ".join(factor for factor in stimulus_set.factors if factor not in by_factor):
            without.setdefault(missing, []).append(condition)
    notes = [
        f"no level of {factors}: {', '.join(conditions)}; compared with all others, and left out where factors are "
        "compared"
        for factors, conditions in without.items()
    ]
    if sum(map(len, without.values())) == len(levels):
        names = ", ".join(stimulus_set.factors)
        notes.append(f"no condition has a level of every factor ({names}): this set cannot compare factors")
    return notes


def check_videos(stimulus_set: StimulusSet, progress: Progress = no_progress) -> None:
    """Check every video of a set by its digest and by decoding it.

    Raises
    ------
    StimuliError
        If a file is missing, has another digest, cannot be decoded or contradicts the manifest.
    """
    every = (*stimulus_set.stimuli, *stimulus_set.practice)
    in_parallel([(f"checking {s.name}", partial(_check_files, stimulus_set.folder, s)) for s in every], progress)


def _read_manifest(path: Path) -> tuple[Manifest, str]:
    try:
        content = read_json_bytes(path)
        facts = json.loads(content)
        check_text(facts)
        manifest = Manifest.model_validate(facts)
    except FileNotFoundError as error:
        raise StimuliError(f"{path}: there is no such file; a stimulus set is a folder with a {MANIFEST}") from error
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise StimuliError(f"{path}: is not readable as JSON: {error}") from error
    except ValidationError as error:
        raise StimuliError(f"{path}: {faults_of(error, Manifest)[0]}") from error
    except RecursionError as error:
        raise StimuliError(f"{path}: holds too many lists within one another") from error
    except ValueError as error:
        raise StimuliError(f"{path}: {error}") from error
    return manifest, hashlib.sha256(content).hexdigest()


def _check_names(stimulus_set: StimulusSet, manifest: Path) -> None:
    for kind, kind_names in (("dataset", stimulus_set.datasets), ("factor", stimulus_set.factors)):
        if TOGETHER in kind_names:
            raise StimuliError(f"{manifest}: a {kind} is called {TOGETHER!r}, as results call all of them together")
    names = [stimulus.name for stimulus in stimulus_set.stimuli]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise StimuliError(f"{manifest}: {twice[0]} is there twice, expected every approach once for a dataset")
    for stimulus in stimulus_set.stimuli:
        for factor, level in stimulus.levels.items():
            if level not in stimulus_set.factors.get(factor, []):
                raise StimuliError(f"{manifest}: {stimulus.name} has {factor} = {level}, which factors does not list")


def _check_practice(stimulus_set: StimulusSet, manifest: Path) -> None:
    if not stimulus_set.practice:
        return
    if len(stimulus_set.practice) != 2:
        raise StimuliError(f"{manifest}: practice has {len(stimulus_set.practice)} stimuli, expected two or none")
    _check_alike(stimulus_set.practice, manifest)


def _check_alike(stimuli: Sequence[Stimulus], manifest: Path) -> None:
    """Check that stimuli shown in turn differ in nothing but the reconstruction."""
    first, usual = stimuli[0], Counter(map(_shape, stimuli)).most_common(1)[0][0]
    for stimulus in stimuli:
        if (shape := _shape(stimulus)) != usual:
            raise StimuliError(
                f"{manifest}: {stimulus.name} has {shape}, the others of {stimulus.dataset} have {usual}; the stimuli "
                f"of a dataset must be alike: make {stimulus.name} with {usual}, or leave it out",
                by_command="`reconstudy stimuli import --conform` makes them so",
                on_page="or send the films without manifest.json, with “make films of a scene alike”",
            )
    if first.width % 2 or first.height % 2:
        raise StimuliError(f"{manifest}: {first.name} is {first.width}x{first.height}, expected even numbers")


def _shape(stimulus: Stimulus) -> str:
    """Describe the size, length and frame rate, which are the same for all stimuli of a dataset."""
    return str(VideoFacts(stimulus.width, stimulus.height, stimulus.fps, stimulus.n_frames))


def _check_files(folder: Path, stimulus: Stimulus) -> None:
    for file in filter(None, (stimulus.video, stimulus.master, stimulus.mask)):
        path = folder / file
        if not path.resolve().is_relative_to(folder.resolve()):
            raise StimuliError(f"{path}: {stimulus.name} lies outside the stimulus set's folder")
        if not path.is_file():
            raise StimuliError(f"{path}: the video of {stimulus.name} is missing")
    path = folder / stimulus.video
    if (sha256 := file_digest(path)) != stimulus.sha256:
        raise StimuliError(f"{path}: its SHA-256 is {sha256}, the manifest says {stimulus.sha256}")
    for file in filter(None, (stimulus.video, stimulus.master)):
        _check_facts(folder / file, decode(folder / file), stimulus)


def _check_facts(path: Path, facts: VideoFacts, stimulus: Stimulus) -> None:
    if facts.look is not None:
        refuse_unready(path, stimulus.name, facts)
    for fact in ("width", "height", "n_frames"):
        if getattr(facts, fact) != getattr(stimulus, fact):
            raise StimuliError(f"{path}: {fact} is {getattr(facts, fact)}, the manifest says {getattr(stimulus, fact)}")
    if abs(facts.fps - stimulus.fps) > FPS_TOLERANCE * stimulus.fps:
        raise StimuliError(f"{path}: fps is {facts.fps:g}, the manifest says {stimulus.fps:g}")

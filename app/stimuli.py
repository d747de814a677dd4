"""The only door from reconstruction: checks a stimulus set and prepares the videos that the player shows.

A pair video holds the one stimulus above the other, so that both are decoded together and never differ by a frame; a
reference lies below them. At a seam both edges are repeated over a guard band, so that neither bleeds into the other
where the player crops.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

import imageio_ffmpeg
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.errors import StimuliError
from app.files import whole_file

MANIFEST = "manifest.json"
GUARD_ROWS = 16  # two macroblock halves: what a deblocking filter or a scaler can reach
WORKERS = 2  # encoders at once, each on one thread, so that files are reproducible
GOP = 25
FPS_TOLERANCE = 5e-4  # relative: 29.97 is 30000/1001, but 30 is not
CRF = 18
PRACTICE_S = 2  # of the videos made for practice; they are played over and over
PRACTICE_SIZE = "480x270"  # drawn, then enlarged: a fractal in full size takes minutes
PRACTICE_BLUR = "gblur=sigma=6"  # pixels of that size: nobody overlooks it
PRACTICE_ENCODING = ["-c:v", "libx264", "-preset", "ultrafast", "-qp", "0"]  # without loss
PAIR_RECIPE = "stacked-1"  # part of every pair's key: change it when a pair would be encoded otherwise

ENCODING = (
    f"-c:v libx264 -preset medium -crf {CRF} -g {GOP} -keyint_min {GOP} -sc_threshold 0 -threads 1"
    " -color_range tv -colorspace bt709 -color_primaries bt709 -color_trc bt709"
    # No name of a source may travel along in the metadata.
    " -an -map_metadata -1 -map_chapters -1 -fflags +bitexact -flags:v +bitexact -movflags +faststart"
).split()

Progress = Callable[[int, int, str], None]  # done, total, what
Name = Annotated[str, Field(min_length=1, max_length=200)]


def no_progress(done: int, total: int, what: str) -> None:
    """Say nothing."""


class Stimulus(BaseModel):
    """A video of one approach (or any other condition) for one dataset; what a study does not need is ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    dataset: Name
    approach: Name
    levels: dict[str, str] = {}
    video: Name
    master: Name | None = None
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    width: Annotated[int, Field(ge=2, le=16384)]
    height: Annotated[int, Field(ge=2, le=16384)]
    fps: Annotated[float, Field(gt=0, le=1000)]
    n_frames: Annotated[int, Field(ge=1, le=1_000_000)]
    codec: str = ""
    renderer: str = ""

    @property
    def name(self) -> str:
        return f"{self.dataset}/{self.approach}"


class _Manifest(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    schema_version: Literal[1]
    name: Name
    stimuli: Annotated[list[Stimulus], Field(min_length=2)]
    factors: dict[str, list[str]] = {}
    practice: list[Stimulus] = []


@dataclass(frozen=True)
class StimulusSet:
    """A checked stimulus set.

    Parameters
    ----------
    folder : what the manifest's paths are relative to
    name : the set's
    sha256 : of the manifest
    factors : levels by factor
    stimuli : in the manifest's order
    practice : two stimuli of a scene that is not in the study, the one clearly better; or none
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

    def without(self, condition: str) -> StimulusSet:
        """The set without one condition."""
        return replace(self, stimuli=tuple(one for one in self.stimuli if one.approach != condition))

    def of_dataset(self, dataset: str) -> tuple[Stimulus, ...]:
        return tuple(stimulus for stimulus in self.stimuli if stimulus.dataset == dataset)

    def source(self, stimulus: Stimulus) -> Path:
        """What a pair video is made from: the master, which has not lost anything yet, where there is one."""
        return self.folder / (stimulus.master or stimulus.video)


@dataclass(frozen=True)
class VideoFacts:
    """What a whole video was found to hold when it was decoded."""

    width: int
    height: int
    fps: float
    n_frames: int


@dataclass(frozen=True)
class PairVideo:
    """A pair's video: the stimulus with the smaller digest on top, which says nothing about its condition.

    Parameters
    ----------
    file : name in the media folder, by content
    sha256 : of the file
    width, height : of one half, pixels
    guard_rows : rows between the halves
    """

    top: Stimulus
    bottom: Stimulus
    file: str
    sha256: str
    width: int
    height: int
    guard_rows: int
    fps: float
    n_frames: int


References = Mapping[str, Stimulus]  # by dataset
NO_REFERENCES: References = {}


def read_stimulus_set(path: Path, progress: Progress = no_progress) -> StimulusSet:
    """Read a stimulus set and check every video in it by decoding it.

    Parameters
    ----------
    path : the manifest, or the folder that holds it
    progress : told after each video

    Raises
    ------
    StimuliError
        If the manifest is not as described, a file is missing, has another digest, cannot be decoded or is not what the
        manifest says, or the stimuli of a dataset differ in size, frame rate or length.
    """
    manifest_path = path / MANIFEST if path.is_dir() else path
    manifest, sha256 = _read_manifest(manifest_path)
    stimulus_set = StimulusSet(
        manifest_path.parent,
        manifest.name,
        sha256,
        manifest.factors,
        tuple(manifest.stimuli),
        tuple(manifest.practice),
    )
    _check_names(stimulus_set, manifest_path)
    for dataset in stimulus_set.datasets:
        _check_alike(stimulus_set.of_dataset(dataset), manifest_path)
    _check_practice(stimulus_set, manifest_path)
    every = (*stimulus_set.stimuli, *stimulus_set.practice)
    _in_parallel([(f"checking {s.name}", partial(_check_files, stimulus_set.folder, s)) for s in every], progress)
    return stimulus_set


def prepare_pairs(
    stimulus_set: StimulusSet, media_dir: Path, progress: Progress = no_progress, references: References = NO_REFERENCES
) -> list[PairVideo]:
    """Make the video of every unordered pair of stimuli of the same dataset, unless it is already there.

    Parameters
    ----------
    media_dir : where the files go, named by what they are made of
    progress : told after each pair
    references : what lies below the pairs of a dataset

    Raises
    ------
    StimuliError
        If a pair cannot be encoded, or what was encoded does not decode to the frames it should hold.
    """
    pairs = [pair for name in stimulus_set.datasets for pair in combinations(stimulus_set.of_dataset(name), 2)]
    return _prepare(stimulus_set, pairs, media_dir, progress, references)


def prepare_identical(
    stimulus_set: StimulusSet, media_dir: Path, progress: Progress = no_progress, references: References = NO_REFERENCES
) -> list[PairVideo]:
    """Make the video of every stimulus beside itself, for pairs that check attention; otherwise as `prepare_pairs`."""
    return _prepare(stimulus_set, [(one, one) for one in stimulus_set.stimuli], media_dir, progress, references)


def split_reference(stimulus_set: StimulusSet, reference: str) -> tuple[StimulusSet, References]:
    """What is compared, and by dataset what is shown beside it as the reference.

    Raises
    ------
    StimuliError
        If a dataset lacks the reference, or has too little to compare besides it.
    """
    compared = stimulus_set.without(reference)
    references = {one.dataset: one for one in stimulus_set.stimuli if one.approach == reference}
    for dataset in stimulus_set.datasets:
        if dataset not in references:
            found = ", ".join(one.approach for one in stimulus_set.of_dataset(dataset))
            raise StimuliError(f"dataset {dataset} has {found}; the reference {reference!r} is not among them")
        if len(compared.of_dataset(dataset)) < 2:
            raise StimuliError(f"dataset {dataset} has one stimulus beside the reference, expected two to compare")
    return compared, references


def prepare_practice(stimulus_set: StimulusSet, media_dir: Path) -> list[PairVideo]:
    """Make the videos to practise with: an obvious pair, then an identical one.

    The set's practice stimuli are taken where it has them. Else a picture that is not of the study is made: a zoom into
    a grey fractal, sharp and blurred, in the size of the study's videos.

    Raises
    ------
    StimuliError
        If a pair cannot be encoded.
    """
    with TemporaryDirectory() as folder:
        practising = stimulus_set if stimulus_set.practice else _made_for_practice(stimulus_set, Path(folder))
        sharp, other = practising.practice
        digests = {stimulus.name: file_digest(practising.source(stimulus)) for stimulus in practising.practice}
        pairs = []
        for top, bottom in ((sharp, other), (sharp, sharp)):
            path = media_dir / f"{_pair_key([digests[top.name], digests[bottom.name]])}.mp4"
            if not path.is_file():
                _encode_pair(practising, (top, bottom), path)
            pairs.append(_pair_video(top, bottom, path))
    return pairs


def _prepare(
    stimulus_set: StimulusSet,
    pairs: Sequence[tuple[Stimulus, Stimulus]],
    media_dir: Path,
    progress: Progress,
    references: References,
) -> list[PairVideo]:
    shown = (*stimulus_set.stimuli, *references.values())
    digests = {s.name: file_digest(stimulus_set.source(s)) for s in shown}
    videos: list[tuple[tuple[Stimulus, ...], Path]] = []
    for pair in pairs:
        below = filter(None, [references.get(pair[0].dataset)])
        strips = (*sorted(pair, key=lambda s: (digests[s.name], s.name)), *below)
        videos.append((strips, media_dir / f"{_pair_key([digests[s.name] for s in strips])}.mp4"))
    missing = {path: strips for strips, path in videos if not path.is_file()}  # each content once
    _in_parallel(
        [
            (f"pairing {strips[0].name} with {strips[1].name}", partial(_encode_pair, stimulus_set, strips, path))
            for path, strips in missing.items()
        ],
        progress,
    )
    return [_pair_video(strips[0], strips[1], path) for strips, path in videos]


def _made_for_practice(stimulus_set: StimulusSet, folder: Path) -> StimulusSet:
    like = stimulus_set.stimuli[0]
    n_frames = min(like.n_frames, max(1, round(PRACTICE_S * like.fps)))
    drawn = f"mandelbrot=size={PRACTICE_SIZE}:rate={like.fps:g}:maxiter=400,hue=s=0"
    enlarged = f"scale={like.width}:{like.height},format=yuv420p"
    stimuli = []
    for name, graph in (("sharp", f"{drawn},{enlarged}"), ("blurred", f"{drawn},{PRACTICE_BLUR},{enlarged}")):
        path = folder / f"{name}.mkv"
        command = ["-f", "lavfi", "-i", graph, "-frames:v", str(n_frames), *PRACTICE_ENCODING, str(path)]
        _ffmpeg(command, f"the practice video {name} cannot be made")
        changes = {"approach": name, "video": path.name, "master": None, "n_frames": n_frames}
        stimuli.append(like.model_copy(update=changes))
    return replace(stimulus_set, folder=folder, practice=tuple(stimuli))


def decode(path: Path) -> VideoFacts:
    """Decode a whole video and say what was in it.

    Raises
    ------
    StimuliError
        If there is no such file, it does not decode from beginning to end, or its frames are not equally far apart.
    """
    if not path.is_file():
        raise StimuliError(f"{path}: there is no such file")
    command = ["-xerror", "-i", str(path), "-map", "0:v:0", "-fps_mode", "passthrough", "-f", "framecrc", "-"]
    text = _ffmpeg(command, f"{path}: cannot be decoded as a video")
    size = re.search(r"^#dimensions 0: (\d+)x(\d+)$", text, re.MULTILINE)
    base = re.search(r"^#tb 0: (\d+)/(\d+)$", text, re.MULTILINE)
    times = [int(line.split(",")[2]) for line in text.splitlines() if line and not line.startswith("#")]
    if not size or not base or not times:
        raise StimuliError(f"{path}: holds no picture")
    steps = {later - earlier for earlier, later in pairwise(times)} or {1}
    if len(steps) > 1:
        raise StimuliError(f"{path}: its frames are {sorted(steps)} ticks apart, expected one constant frame rate")
    fps = int(base[2]) / int(base[1]) / steps.pop()
    return VideoFacts(int(size[1]), int(size[2]), fps, len(times))


def file_digest(path: Path) -> str:
    """The SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read_manifest(path: Path) -> tuple[_Manifest, str]:
    try:
        content = path.read_bytes()
        manifest = _Manifest.model_validate(json.loads(content))
    except FileNotFoundError as error:
        raise StimuliError(f"{path}: there is no such file; a stimulus set is a folder with a {MANIFEST}") from error
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise StimuliError(f"{path}: is not readable as JSON: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the whole file"
        raise StimuliError(f"{path}: {where}: {first['msg']}, found {first['input']!r:.120}") from error
    return manifest, hashlib.sha256(content).hexdigest()


def _check_names(stimulus_set: StimulusSet, manifest: Path) -> None:
    names = [stimulus.name for stimulus in stimulus_set.stimuli]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise StimuliError(f"{manifest}: {twice[0]} is there twice, expected every approach once for a dataset")
    for dataset in stimulus_set.datasets:
        if len(stimulus_set.of_dataset(dataset)) < 2:
            raise StimuliError(f"{manifest}: dataset {dataset} has one stimulus, expected at least two to compare")
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
    """What is shown in turn must differ in nothing but the reconstruction."""
    first, *others = stimuli
    for other in others:
        for fact in ("width", "height", "fps", "n_frames"):
            if getattr(other, fact) != getattr(first, fact):
                raise StimuliError(
                    f"{manifest}: {other.name} has {fact} {getattr(other, fact)}, {first.name} has"
                    f" {getattr(first, fact)}; the stimuli of a dataset must be alike"
                )
    if first.width % 2 or first.height % 2:
        raise StimuliError(f"{manifest}: {first.name} is {first.width}x{first.height}, expected even numbers")


def _check_files(folder: Path, stimulus: Stimulus) -> None:
    for file in filter(None, (stimulus.video, stimulus.master)):
        path = folder / file
        if not path.resolve().is_relative_to(folder.resolve()):
            raise StimuliError(f"{path}: {stimulus.name} lies outside the stimulus set's folder")
        if not path.is_file():
            raise StimuliError(f"{path}: the video of {stimulus.name} is missing")
    path = folder / stimulus.video
    if (found := file_digest(path)) != stimulus.sha256:
        raise StimuliError(f"{path}: its SHA-256 is {found}, the manifest says {stimulus.sha256}")
    for file in filter(None, (stimulus.video, stimulus.master)):
        _check_facts(folder / file, decode(folder / file), stimulus)


def _check_facts(path: Path, found: VideoFacts, stimulus: Stimulus) -> None:
    for fact in ("width", "height", "n_frames"):
        if getattr(found, fact) != getattr(stimulus, fact):
            raise StimuliError(f"{path}: {fact} is {getattr(found, fact)}, the manifest says {getattr(stimulus, fact)}")
    if abs(found.fps - stimulus.fps) > FPS_TOLERANCE * stimulus.fps:
        raise StimuliError(f"{path}: fps is {found.fps:g}, the manifest says {stimulus.fps:g}")


def _encode_pair(stimulus_set: StimulusSet, strips: Sequence[Stimulus], path: Path) -> None:
    first = strips[0]
    n_rows = len(strips) * first.height + (len(strips) - 1) * GUARD_ROWS
    expected = VideoFacts(first.width, n_rows, first.fps, first.n_frames)
    with whole_file(path) as temporary:
        _stack([stimulus_set.source(strip) for strip in strips], temporary)
        _check_pair(decode(temporary), expected, " above ".join(strip.name for strip in strips))


def _pair_video(top: Stimulus, bottom: Stimulus, path: Path) -> PairVideo:
    digest = file_digest(path)
    return PairVideo(top, bottom, path.name, digest, top.width, top.height, GUARD_ROWS, top.fps, top.n_frames)


def _pair_key(sha256s: Sequence[str]) -> str:
    recipe = [PAIR_RECIPE, GUARD_ROWS, GOP, CRF, *sha256s]
    return hashlib.sha256(json.dumps(recipe).encode()).hexdigest()


def _stack(sources: Sequence[Path], out: Path) -> None:
    n, half = len(sources), GUARD_ROWS // 2
    strips = [_padded(number, half * (number > 0), half * (number < n - 1)) for number in range(n)]
    names = "".join(f"[strip{number}]" for number in range(n))
    graph = "".join(strips) + f"{names}vstack=inputs={n}:shortest=1,format=yuv420p[pair]"
    inputs = [part for source in sources for part in ("-i", str(source))]
    _ffmpeg(
        [
            "-xerror",
            *inputs,
            "-filter_complex",
            graph,
            "-map",
            "[pair]",
            "-fps_mode",
            "passthrough",
            *ENCODING,
            "-y",
            str(out),
        ],
        f"{sources[0]} above {sources[1]}: cannot be encoded",
    )


def _padded(number: int, above: int, below: int) -> str:
    """A strip padded in full colour resolution; `smear` repeats the outermost row over the padding."""
    pad = f"pad=iw:ih+{above + below}:0:{above}"
    smear = f"fillborders=top={above}:bottom={below}:mode=smear"
    return f"[{number}:v]format=yuv444p,{pad},{smear}[strip{number}];"


def _check_pair(found: VideoFacts, expected: VideoFacts, name: str) -> None:
    same_fps = abs(found.fps - expected.fps) <= FPS_TOLERANCE * expected.fps
    if not same_fps or replace(found, fps=expected.fps) != expected:
        raise StimuliError(f"{name}: was encoded as {found}, expected {expected}")


def _ffmpeg(arguments: Iterable[str], complaint: str) -> str:
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-nostdin", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode != 0 or done.stderr.strip():
        reason = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[0]
        raise StimuliError(f"{complaint}: {reason}")
    return done.stdout


def _in_parallel(jobs: Sequence[tuple[str, Callable[[], None]]], progress: Progress) -> None:
    """Run jobs that wait for a process each; the first error stops those that have not begun."""
    progress(0, len(jobs), "")
    with ThreadPoolExecutor(WORKERS) as pool:
        names = {pool.submit(job): name for name, job in jobs}
        try:
            for done, future in enumerate(as_completed(names), start=1):
                future.result()
                progress(done, len(jobs), names[future])
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise

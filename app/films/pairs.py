"""The films that the player shows, made of a checked stimulus set.

A pair video holds the one stimulus above the other, so that both are decoded together and never differ by a frame; a
reference lies below them. Each is H.264, and in a second codec for browsers without it where a study asks for one. For
browsers that play no such film, every stimulus can be a film of its own too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

from app.errors import StimuliError
from app.ffmpeg import Progress, in_parallel, no_progress, run_ffmpeg
from app.files import file_digest
from app.films.strips import GUARD_ROWS, H264, SINGLE, Strips, film_key, make_film
from app.intake.stimuli import Stimulus, StimulusSet

PRACTICE_S = 2  # of the videos made for practice; they are played over and over
PRACTICE_SIZE = "480x270"  # drawn, then enlarged: a fractal in full size takes minutes
PRACTICE_BLUR = "gblur=sigma=6"  # pixels of that size: nobody overlooks it
PRACTICE_ENCODING = ["-c:v", "libx264", "-preset", "ultrafast", "-qp", "0"]  # without loss

References = Mapping[str, Stimulus]  # by dataset
NO_REFERENCES: References = {}


@dataclass(frozen=True)
class FilmFile:
    """A film's file in the media folder.

    Parameters
    ----------
    codec : key of ENCODERS
    file : its name, by content
    sha256 : of its bytes
    """

    codec: str
    file: str
    sha256: str


@dataclass(frozen=True)
class PairVideo:
    """A pair's video: the stimulus with the smaller digest on top, which says nothing about its condition.

    Parameters
    ----------
    file : name in the media folder, by content
    sha256 : of the file
    width, height : of one strip, pixels
    guard_rows : rows between the strips
    second : the same in another codec, for browsers that do not play the first
    singles : its strips from the top, a film each, for browsers that play neither; empty: none were asked for
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
    second: FilmFile | None = None
    singles: tuple[FilmFile, ...] = ()

    @property
    def files(self) -> list[str]:
        """Names of all files."""
        return [self.file, *(film.file for film in (self.second, *self.singles) if film)]


@dataclass(frozen=True)
class FilmMaker:
    """Where films go and how they are made.

    Parameters
    ----------
    media_dir : where the files go, named by what they are made of; what is there is not made again
    second_codec : for browsers that do not play H.264; empty: none
    has_singles : make a film of every stimulus, too
    progress : told after each film
    """

    media_dir: Path
    second_codec: str = ""
    has_singles: bool = False
    progress: Progress = no_progress

    @property
    def codecs(self) -> tuple[str, ...]:
        return (H264, self.second_codec) if self.second_codec else (H264,)


def prepare_pairs(
    stimulus_set: StimulusSet, maker: FilmMaker, references: References = NO_REFERENCES
) -> list[PairVideo]:
    """Make the video of every unordered pair of stimuli of the same dataset, unless it is already there.

    Parameters
    ----------
    references : what lies below the pairs of a dataset

    Raises
    ------
    StimuliError
        If a pair cannot be encoded, or what was encoded does not decode to the frames it should hold.
    """
    pairs = [pair for name in stimulus_set.datasets for pair in combinations(stimulus_set.of_dataset(name), 2)]
    return _prepare(stimulus_set, pairs, maker, references)


def prepare_identical(
    stimulus_set: StimulusSet, maker: FilmMaker, references: References = NO_REFERENCES
) -> list[PairVideo]:
    """Make the video of every stimulus beside itself, for pairs that check attention; otherwise as `prepare_pairs`."""
    return _prepare(stimulus_set, [(one, one) for one in stimulus_set.stimuli], maker, references)


def prepare_practice(stimulus_set: StimulusSet, maker: FilmMaker) -> list[PairVideo]:
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
        scene = replace(practising, stimuli=practising.practice)
        return [
            _prepare(scene, [pair], replace(maker, progress=no_progress), NO_REFERENCES, is_sorted=False)[0]
            for pair in ((sharp, other), (sharp, sharp))
        ]


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


def _prepare(
    stimulus_set: StimulusSet,
    pairs: Sequence[tuple[Stimulus, Stimulus]],
    maker: FilmMaker,
    references: References,
    *,
    is_sorted: bool = True,
) -> list[PairVideo]:
    shown = (*stimulus_set.stimuli, *references.values())
    digests = {s.name: file_digest(stimulus_set.source(s)) for s in shown}
    planned: list[_PlannedPair] = []
    for pair in pairs:
        below = filter(None, [references.get(pair[0].dataset)])
        two = sorted(pair, key=lambda s: (digests[s.name], s.name)) if is_sorted else pair
        planned.append(_planned(stimulus_set, (*two, *below), digests, maker))
    every = {path: film for pair in planned for path, film in (*pair.stacked, *pair.singles)}  # each content once
    missing = [(path, film) for path, film in every.items() if not path.is_file()]
    in_parallel([(f"encoding {film.name}", partial(make_film, film, path)) for path, film in missing], maker.progress)
    files = {path: FilmFile(film.codec, path.name, file_digest(path)) for path, film in every.items()}
    return [_pair_video(pair, files) for pair in planned]


@dataclass(frozen=True)
class _PlannedPair:
    """The films of a pair: both in one, in each codec; and each strip alone, from the top."""

    stacked: list[tuple[Path, Strips]]
    singles: list[tuple[Path, Strips]]


def _planned(
    stimulus_set: StimulusSet, stimuli: tuple[Stimulus, ...], digests: Mapping[str, str], maker: FilmMaker
) -> _PlannedPair:
    def film(of: tuple[Stimulus, ...], codec: str) -> tuple[Path, Strips]:
        key = film_key(codec, [digests[s.name] for s in of])
        return maker.media_dir / f"{key}.mp4", Strips(of, tuple(stimulus_set.source(s) for s in of), codec)

    singles = [film((one,), SINGLE) for one in stimuli] if maker.has_singles else []
    return _PlannedPair([film(stimuli, codec) for codec in maker.codecs], singles)


def _made_for_practice(stimulus_set: StimulusSet, folder: Path) -> StimulusSet:
    like = stimulus_set.stimuli[0]
    n_frames = min(like.n_frames, max(1, round(PRACTICE_S * like.fps)))
    drawn = f"mandelbrot=size={PRACTICE_SIZE}:rate={like.fps:g}:maxiter=400,hue=s=0"
    enlarged = f"scale={like.width}:{like.height},format=yuv420p"
    stimuli = []
    for name, graph in (("sharp", f"{drawn},{enlarged}"), ("blurred", f"{drawn},{PRACTICE_BLUR},{enlarged}")):
        path = folder / f"{name}.mkv"
        command = ["-f", "lavfi", "-i", graph, "-frames:v", str(n_frames), *PRACTICE_ENCODING, str(path)]
        run_ffmpeg(command, f"the practice video {name} cannot be made")
        changes = {"approach": name, "video": path.name, "master": None, "n_frames": n_frames}
        stimuli.append(like.model_copy(update=changes))
    return replace(stimulus_set, folder=folder, practice=tuple(stimuli))


def _pair_video(planned: _PlannedPair, files: Mapping[Path, FilmFile]) -> PairVideo:
    top, bottom = planned.stacked[0][1].stimuli[:2]
    first, *others = [files[path] for path, _ in planned.stacked]
    size = (top.width, top.height, GUARD_ROWS, top.fps, top.n_frames)
    singles = tuple(files[path] for path, _ in planned.singles)
    return PairVideo(
        top, bottom, first.file, first.sha256, *size, second=others[0] if others else None, singles=singles
    )

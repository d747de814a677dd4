"""The films that the player shows, made of a checked stimulus set.

A pair video holds the one stimulus above the other, so that both are decoded together and never differ by a frame; a
reference lies below them. At a seam both edges are repeated over a guard band, so that neither bleeds into the other
where the player crops. Each film is H.264, and in a second codec for browsers without it where a study asks for one.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

from app.errors import StimuliError
from app.files import whole_file
from app.stimuli import (
    FPS_TOLERANCE,
    Progress,
    Stimulus,
    StimulusSet,
    VideoFacts,
    decode,
    file_digest,
    in_parallel,
    no_progress,
    run_ffmpeg,
)

GUARD_ROWS = 16  # two macroblock halves: what a deblocking filter or a scaler can reach
GOP = 25
LEAST_PSNR_DB = 25.0  # of any frame beside its source; these encoders leave above 35, a wrong half or a black frame 15
BY_NUMBER = "settb=1/1000,setpts=1000*N"  # one second a frame, whatever a file's own clock is
PRACTICE_S = 2  # of the videos made for practice; they are played over and over
PRACTICE_SIZE = "480x270"  # drawn, then enlarged: a fractal in full size takes minutes
PRACTICE_BLUR = "gblur=sigma=6"  # pixels of that size: nobody overlooks it
PRACTICE_ENCODING = ["-c:v", "libx264", "-preset", "ultrafast", "-qp", "0"]  # without loss
STILL_WIDTH = 480  # pixels of a thumbnail
PAIR_RECIPE = "stacked-1"  # part of every pair's key: change it when a pair would be encoded otherwise

H264 = "h264"
ENCODERS = {
    H264: f"-c:v libx264 -preset medium -crf 18 -g {GOP} -keyint_min {GOP} -sc_threshold 0 -threads 1",
    "vp9": f"-c:v libvpx-vp9 -crf 24 -b:v 0 -deadline good -cpu-used 4 -row-mt 0 -g {GOP} -threads 1",
    "av1": f"-c:v libsvtav1 -preset 8 -crf 24 -g {GOP} -svtav1-params lp=1",
}
CONTAINER = (
    "-color_range tv -colorspace bt709 -color_primaries bt709 -color_trc bt709"
    # No name of a source may travel along in the metadata.
    " -an -map_metadata -1 -map_chapters -1 -fflags +bitexact -flags:v +bitexact -movflags +faststart"
)

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


@dataclass(frozen=True)
class FilmMaker:
    """Where films go and how they are made.

    Parameters
    ----------
    media_dir : where the files go, named by what they are made of; what is there is not made again
    second_codec : for browsers that do not play H.264; empty: none
    progress : told after each film
    """

    media_dir: Path
    second_codec: str = ""
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
    films: list[tuple[tuple[Stimulus, ...], tuple[Path, ...]]] = []
    for pair in pairs:
        below = filter(None, [references.get(pair[0].dataset)])
        two = sorted(pair, key=lambda s: (digests[s.name], s.name)) if is_sorted else pair
        strips = (*two, *below)
        keys = [_film_key(codec, [digests[s.name] for s in strips]) for codec in maker.codecs]
        films.append((strips, tuple(maker.media_dir / f"{key}.mp4" for key in keys)))
    missing = {  # each content once
        path: (strips, codec)
        for strips, paths in films
        for path, codec in zip(paths, maker.codecs, strict=True)
        if not path.is_file()
    }
    in_parallel(
        [
            (f"pairing {strips[0].name} with {strips[1].name}", partial(_make_film, stimulus_set, strips, codec, path))
            for path, (strips, codec) in missing.items()
        ],
        maker.progress,
    )
    return [_pair_video(strips, paths, maker) for strips, paths in films]


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


def _make_film(stimulus_set: StimulusSet, strips: Sequence[Stimulus], codec: str, path: Path) -> None:
    first, name = strips[0], " above ".join(strip.name for strip in strips)
    sources = [stimulus_set.source(strip) for strip in strips]
    n_rows = len(strips) * first.height + (len(strips) - 1) * GUARD_ROWS
    with whole_file(path) as temporary:
        _stack(sources, codec, temporary)
        _check_facts(decode(temporary), VideoFacts(first.width, n_rows, first.fps, first.n_frames), name)
        for number, (strip, source) in enumerate(zip(strips, sources, strict=True)):
            check_strip(temporary, number, strip, source, name)


def _pair_video(strips: Sequence[Stimulus], paths: Sequence[Path], maker: FilmMaker) -> PairVideo:
    top, bottom = strips[:2]
    first, *others = [
        FilmFile(codec, path.name, file_digest(path)) for codec, path in zip(maker.codecs, paths, strict=True)
    ]
    size = (top.width, top.height, GUARD_ROWS, top.fps, top.n_frames)
    return PairVideo(top, bottom, first.file, first.sha256, *size, second=others[0] if others else None)


def _film_key(codec: str, sha256s: Sequence[str]) -> str:
    recipe = [PAIR_RECIPE, GUARD_ROWS, ENCODERS[codec], CONTAINER, *sha256s]
    return hashlib.sha256(json.dumps(recipe).encode()).hexdigest()


def _stack(sources: Sequence[Path], codec: str, out: Path) -> None:
    n, half = len(sources), GUARD_ROWS // 2
    strips = [_padded(number, half * (number > 0), half * (number < n - 1)) for number in range(n)]
    names = "".join(f"[strip{number}]" for number in range(n))
    graph = "".join(strips) + f"{names}vstack=inputs={n}:shortest=1,format=yuv420p[pair]"
    inputs = [part for source in sources for part in ("-i", str(source))]
    filtering = ["-filter_complex", graph, "-map", "[pair]", "-fps_mode", "passthrough"]
    encoding = [*ENCODERS[codec].split(), *CONTAINER.split(), "-f", "mp4"]
    run_ffmpeg(
        ["-xerror", *inputs, *filtering, *encoding, "-y", str(out)],
        f"{sources[0]} above {sources[1]}: cannot be encoded as {codec}",
    )


def _padded(number: int, above: int, below: int) -> str:
    """A strip padded in full colour resolution; `smear` repeats the outermost row over the padding."""
    pad = f"pad=iw:ih+{above + below}:0:{above}"
    smear = f"fillborders=top={above}:bottom={below}:mode=smear"
    return f"[{number}:v]format=yuv444p,{pad},{smear}[strip{number}];"


def _check_facts(found: VideoFacts, expected: VideoFacts, name: str) -> None:
    same_fps = abs(found.fps - expected.fps) <= FPS_TOLERANCE * expected.fps
    if not same_fps or replace(found, fps=expected.fps) != expected:
        raise StimuliError(f"{name}: was encoded as {found}, expected {expected}")


def check_strip(film: Path, number: int, strip: Stimulus, source: Path, name: str) -> None:
    """Compare a film's strip, counted from the top, with its source, frame by frame.

    Raises
    ------
    StimuliError
        If a frame differs by more than encoding does.
    """
    row = number * (strip.height + GUARD_ROWS)
    graph = (
        f"[0:v]crop={strip.width}:{strip.height}:0:{row},{BY_NUMBER},format=yuv420p[strip];"
        f"[1:v]{BY_NUMBER},format=yuv420p[source];[strip][source]psnr=stats_file=-"
    )
    command = ["-i", str(film), "-i", str(source), "-filter_complex", graph, "-f", "null", "-"]
    text = run_ffmpeg(command, f"{name}: cannot be compared with {source}")
    found = [float(value) for value in re.findall(r"psnr_avg:(\S+)", text)]
    if len(found) != strip.n_frames:
        raise StimuliError(f"{name}: {len(found)} frames were compared with {source}, expected {strip.n_frames}")
    if min(found) < LEAST_PSNR_DB:
        raise StimuliError(
            f"{name}: frame {found.index(min(found))} differs from {source} (PSNR {min(found):.1f} dB, expected at"
            f" least {LEAST_PSNR_DB:g})"
        )


def write_still(film: Path, out: Path, *, row: int, width: int, height: int) -> None:
    """Write one picture of a pair's half, the first, as JPEG.

    Parameters
    ----------
    row : where the half begins in the film
    width, height : of the half, pixels
    """
    crop = f"crop={width}:{height}:0:{row},scale='min({STILL_WIDTH},iw)':-2"
    with whole_file(out) as temporary:
        arguments = ["-i", str(film), "-vf", crop, "-frames:v", "1", "-q:v", "4", "-y", str(temporary)]
        run_ffmpeg(arguments, f"{film}: has no picture")

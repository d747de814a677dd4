"""The measures of each frame of a film, read once from its first frame to its last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.video import read_luma
from recon.validation.films.flicker import excess_change
from recon.validation.films.kinds import ACTOR, KINDS, Kind
from recon.validation.films.likeness import Likeness, likenesses
from recon.validation.films.perceptual import Perceptual
from recon.validation.films.pictures import comparison_picture
from recon.validation.films.programs import FilmPrograms
from recon.validation.films.stimuli import Pair
from recon.validation.films.vmaf import has_vmaf, vmaf_scores

NOTHING_MORE = Perceptual()
NO_PROGRAMS = FilmPrograms()
WHITE = 126  # luma from which a mask's pixel is of the model: half way from 16 to 235

Images = tuple[NDArray[np.uint8], NDArray[np.uint8]]  # a frame of the film, and the reference's
Tell = Callable[[int], None]  # told how many frames are done since the last time


@dataclass(frozen=True, eq=False)
class WorstFrame:
    """The frame of a film that is least like the reference's by SSIM, inside the silhouettes where there are any.

    Parameters
    ----------
    number, ssim : which frame, and how alike it is
    picture : as `comparison_picture` draws it
    """

    number: int
    ssim: float
    picture: NDArray[np.uint8]


@dataclass(eq=False)
class MeasuredFilm:
    """A film with its measures of each frame.

    Parameters
    ----------
    pair : the film and its reference
    frames : numbers of the measured frames
    values : by measure, one for each frame; NaN where the frame has none
    worst : the frame that is least alike
    others : what the measures by programs are
    """

    pair: Pair
    frames: list[int]
    values: dict[str, list[float]]
    worst: WorstFrame
    others: Mapping[str, Kind] = field(default_factory=dict)

    def kind(self, measure: str) -> Kind:
        """Say what a measure of the film is, of the actor or of the whole frame."""
        return {**KINDS, **self.others}[measure.removesuffix(ACTOR)]

    def is_of_actor(self, measure: str) -> bool:
        """Return whether a measure was taken inside the silhouettes, or over the whole frame."""
        return measure.endswith(ACTOR) or (measure == "flicker" and self.pair.has_masks)


def measure_film(
    pair: Pair,
    *,
    every: int,
    threads: int,
    perceptual: Perceptual = NOTHING_MORE,
    programs: FilmPrograms = NO_PROGRAMS,
    tell: Tell | None = None,
) -> MeasuredFilm:
    """Measure a film; ffmpeg computes VMAF beside the other measures.

    Parameters
    ----------
    pair : the film and its reference
    every : measure only each such frame, from the first on
    threads : of libvmaf
    perceptual, programs : measures by other packages, and by programs; default: none
    tell : told after each measured frame

    Raises
    ------
    VideoError
        If a film or a mask cannot be decoded from its first frame to its last.
    ValueError
        If a file of weights holds others.
    ProgramError
        If a program fails in any way.
    """
    frames: list[int] = []
    values: dict[str, list[float]] = {}
    with ThreadPoolExecutor(1) as beside:
        scores = partial(vmaf_scores, pair.film.video, pair.reference.video, every=every, threads=threads)
        waiting = beside.submit(scores) if has_vmaf() else None
        watch = _Worst()
        for number, measured in _measured_frames(pair, every, watch):
            frames.append(number)
            for measure, value in measured.items():
                values.setdefault(measure, []).append(value)
            if tell:
                tell(1)
        if waiting:
            values["vmaf"] = waiting.result()
    for name in perceptual.names:
        values[name] = perceptual.values(pair, name, every=every)
    for name in programs.programs:
        values[name] = [programs.value(pair, name), *[np.nan] * (len(frames) - 1)]
    in_order = {name: values[name] for name in sorted(values, key=_rank)}
    return MeasuredFilm(pair, frames, in_order, watch.shown(), programs.kinds)


@dataclass(eq=False)
class _Worst:
    """Keeps the least alike of the frames that it is shown."""

    number: int = 0
    ssim: float = np.inf
    images: Images | None = None
    silhouette: NDArray[np.bool_] | None = None

    def see(self, number: int, ssim: float, images: Images, silhouette: NDArray[np.bool_] | None) -> None:
        if ssim < self.ssim:
            self.number, self.ssim, self.images, self.silhouette = number, ssim, images, silhouette

    def shown(self) -> WorstFrame:
        assert self.images is not None  # a film has a frame
        return WorstFrame(self.number, self.ssim, comparison_picture(*self.images, self.silhouette))


def _measured_frames(pair: Pair, every: int, watch: _Worst) -> Iterator[tuple[int, dict[str, float]]]:
    """Yield each measured frame's number and measures; two frames are held at a time."""
    before: Images | None = None
    last_silhouette: NDArray[np.bool_] | None = None
    for number, (images, silhouette) in enumerate(_decoded(pair)):
        if number % every == 0:
            regions = [silhouette] if silhouette is not None and silhouette.any() else []
            likeness = likenesses(*images, regions)
            watch.see(number, likeness[-1].ssim, images, silhouette)
            values = _named(likeness[0])
            if silhouette is not None:  # a frame that shows nothing of the actor has no measure of it
                inside = _named(likeness[1]) if regions else dict.fromkeys(values, np.nan)
                values |= {f"{name}{ACTOR}": value for name, value in inside.items()}
            yield number, values | {"flicker": _flicker(before, images, _either(last_silhouette, silhouette))}
        before, last_silhouette = images, silhouette


def _decoded(pair: Pair) -> Iterator[tuple[Images, NDArray[np.bool_] | None]]:
    """Decode film and reference, with the union of their silhouettes, bool (H, W), where there are masks."""
    masks = [film.mask for film in (pair.film, pair.reference) if film.mask is not None and pair.has_masks]
    streams = [read_luma(path) for path in (pair.film.video, pair.reference.video, *masks)]
    for image, reference, *silhouettes in zip(*streams, strict=True):
        yield (image, reference), (np.maximum(*silhouettes) > WHITE if silhouettes else None)


def _named(likeness: Likeness) -> dict[str, float]:
    """Return the measures that there are, by name."""
    return {name: value for name, value in asdict(likeness).items() if value is not None}


def _flicker(before: Images | None, now: Images, silhouette: NDArray[np.bool_] | None) -> float:
    if before is None or (silhouette is not None and not silhouette.any()):
        return np.nan
    excess = excess_change(before, now)
    return float((excess if silhouette is None else excess[silhouette]).mean(dtype=np.float64))


def _either(a: NDArray[np.bool_] | None, b: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
    return b if a is None or b is None else a | b


def _rank(measure: str) -> tuple[bool, int]:
    """Order measures: the whole frame's first, then the actor's."""
    name = measure.removesuffix(ACTOR)
    return measure.endswith(ACTOR), list(KINDS).index(name) if name in KINDS else len(KINDS)

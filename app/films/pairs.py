"""Make the films that the player shows from a checked stimulus set.

A pair video holds one stimulus above the other; both are decoded together and never differ by a frame. A reference lies
below them. Each film is H.264, and also in a second codec for other browsers where a study asks for it. For browsers
that play neither, every stimulus can also be a film of its own. For slow lines each pair can have a lighter film.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

from app.errors import StimuliError
from app.ffmpeg import Progress, in_parallel, no_progress
from app.files import file_digest
from app.films.padding import HEADER, padded, restore
from app.films.strips import GUARD_ROWS, H264, LIGHTER, SINGLE, Strips, film_key, make_film
from app.intake.stimuli import Stimulus, StimulusSet

References = Mapping[str, Stimulus]  # by dataset
NO_REFERENCES: References = {}
PlannedFilms = list[tuple[Path, Strips]]  # of a pair


@dataclass(frozen=True)
class FilmFile:
    """A film's file in the media folder.

    Parameters
    ----------
    codec : key of ENCODERS
    file : name, by content
    sha256 : of its bytes
    """

    codec: str
    file: str
    sha256: str


@dataclass(frozen=True)
class PairVideo:
    """A pair's video; which stimulus is on top follows from the digests of both, and tells nothing about either.

    Parameters
    ----------
    file : name in the media folder, by content; that of the top strip alone where there is no film of both
    sha256 : of the file
    width, height : of a strip, pixels
    guard_rows : rows between the strips
    second : the same in another codec, for browsers that do not play the first
    singles : its strips from the top, a film each, for browsers that play neither; empty: not wanted
    lighter : the same with fewer bytes, for slow lines; both stimuli are encoded alike
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
    lighter: FilmFile | None = None

    @property
    def films(self) -> list[FilmFile]:
        """All its films."""
        both = [] if self.singles and self.file == self.singles[0].file else [FilmFile(H264, self.file, self.sha256)]
        return [*both, *(film for film in (self.second, *self.singles, self.lighter) if film)]


@dataclass(frozen=True)
class FilmMaker:
    """Where films go and how they are made.

    Parameters
    ----------
    media_dir : folder of the films, which are named by their content; existing ones are not made again
    second_codec : for browsers that do not play H.264; empty: none
    has_singles : also make a film of every stimulus
    has_lighter : also make a film of every pair with fewer bytes
    has_both : make a film of every pair at all
    progress : called after each film
    """

    media_dir: Path
    second_codec: str = ""
    has_singles: bool = False
    has_lighter: bool = False
    progress: Progress = no_progress
    has_both: bool = True

    @property
    def codecs(self) -> tuple[str, ...]:
        both = (H264, *filter(None, [self.second_codec]), *([LIGHTER] if self.has_lighter else []))
        return both if self.has_both else ()


def prepare_pairs(
    stimulus_set: StimulusSet, maker: FilmMaker, references: References = NO_REFERENCES
) -> list[PairVideo]:
    """Make the video of every unordered pair of stimuli of the same dataset, unless it is already there.

    Parameters
    ----------
    references : by dataset, the stimulus below its pairs

    Raises
    ------
    StimuliError
        If a pair cannot be encoded, or the film does not decode to the expected frames.
    """
    pairs = [pair for name in stimulus_set.datasets for pair in combinations(stimulus_set.of_dataset(name), 2)]
    return _prepare(stimulus_set, pairs, maker, references)


def prepare_identical(
    stimulus_set: StimulusSet, maker: FilmMaker, references: References = NO_REFERENCES
) -> list[PairVideo]:
    """Make the video of every stimulus with itself, for pairs that check attention; otherwise as `prepare_pairs`."""
    return _prepare(stimulus_set, [(stimulus, stimulus) for stimulus in stimulus_set.stimuli], maker, references)


def prepare_alone(stimulus_set: StimulusSet, maker: FilmMaker) -> list[PairVideo]:
    """Make a film of every stimulus by itself, whose halves are both the stimulus; otherwise as `prepare_pairs`."""
    return _prepare(stimulus_set, [(stimulus,) for stimulus in stimulus_set.stimuli], maker, NO_REFERENCES)


def prepare_against(
    stimulus_set: StimulusSet, maker: FilmMaker, references: References, *, has_identical: bool
) -> list[PairVideo]:
    """Make the film of every stimulus below its dataset's reference; otherwise as `prepare_pairs`.

    Parameters
    ----------
    stimulus_set : without the references
    maker : FilmMaker
    references : by dataset
    has_identical : also make the film of each reference below itself
    """
    pairs = [(references[stimulus.dataset], stimulus) for stimulus in stimulus_set.stimuli]
    pairs += [(reference, reference) for reference in references.values() if has_identical]
    return _prepare(stimulus_set, pairs, maker, NO_REFERENCES, is_sorted=False)


def prepare_practice(
    stimulus_set: StimulusSet,
    pairs: Sequence[tuple[Stimulus, Stimulus]],
    maker: FilmMaker,
    *,
    is_alone: bool = False,
) -> list[PairVideo]:
    """Make the practice videos: the pairs, then the first one's first film with itself; or each film by itself.

    Raises
    ------
    StimuliError
        If a pair cannot be encoded.
    """
    shown = {stimulus.name: stimulus for pair in pairs for stimulus in pair}
    scene = replace(stimulus_set, stimuli=tuple(shown.values()))
    every: list[tuple[Stimulus, ...]] = [*pairs, (pairs[0][0], pairs[0][0])]
    if is_alone:
        every = [(stimulus,) for pair in pairs for stimulus in reversed(pair)]
    return _prepare(scene, every, replace(maker, progress=no_progress), NO_REFERENCES, is_sorted=False)


def equally_large(media_dir: Path, videos: Sequence[PairVideo]) -> list[PairVideo]:
    """Pad films so that those of a dataset in the same codec have the same size, lest it names a pair or a stimulus.

    Parameters
    ----------
    media_dir : folder of the films, where the unpadded ones are removed
    videos : all that are shown, from `prepare_pairs` and the like
    """
    groups: dict[tuple[str, str], set[Path]] = {}
    for video in videos:
        for film in video.films:
            groups.setdefault((video.top.dataset, film.codec), set()).add(media_dir / film.file)
    made: dict[tuple[str, str, str], FilmFile] = {}
    for (dataset, codec), paths in groups.items():
        size = max(path.stat().st_size for path in paths) + HEADER
        for path in paths:
            copy = padded(path, size)
            made[dataset, codec, path.name] = FilmFile(codec, copy.name, file_digest(copy))
    for path in set().union(*groups.values()):
        path.unlink(missing_ok=True)
    return [_padded_pair(video, made) for video in videos]


def split_reference(stimulus_set: StimulusSet, reference: str, fewest: int = 2) -> tuple[StimulusSet, References]:
    """Split a set into what is compared, and by dataset the reference shown beside it.

    Parameters
    ----------
    stimulus_set : with the reference
    reference : its approach
    fewest : stimuli that a dataset needs besides

    Raises
    ------
    StimuliError
        If a dataset lacks the reference, or has too few other stimuli to compare.
    """
    compared = stimulus_set.without(reference)
    references = {stimulus.dataset: stimulus for stimulus in stimulus_set.stimuli if stimulus.approach == reference}
    for dataset in stimulus_set.datasets:
        if dataset not in references:
            approaches = ", ".join(stimulus.approach for stimulus in stimulus_set.of_dataset(dataset))
            raise StimuliError(f"dataset {dataset} has {approaches}; the reference {reference!r} is not among them")
        if (n := len(compared.of_dataset(dataset))) < fewest:
            raise StimuliError(f"dataset {dataset} has {n} stimuli beside the reference, expected {fewest} or more")
    return compared, references


def _prepare(
    stimulus_set: StimulusSet,
    pairs: Sequence[tuple[Stimulus, ...]],
    maker: FilmMaker,
    references: References,
    *,
    is_sorted: bool = True,
) -> list[PairVideo]:
    shown = {s.name: s for s in (*(s for pair in pairs for s in pair), *references.values())}
    digests = {name: file_digest(stimulus_set.source(s)) for name, s in shown.items()}
    planned: list[PlannedFilms] = []
    for pair in pairs:
        below = filter(None, [references.get(pair[0].dataset)])
        two = _in_blind_order(pair, digests) if is_sorted else pair
        planned.append(_planned(stimulus_set, (*two, *below), digests, maker))
    every = {path: film for films in planned for path, film in films}  # each content once
    missing = [(path, film) for path, film in every.items() if not path.is_file() and not restore(path)]
    in_parallel([(f"encoding {film.name}", partial(make_film, film, path)) for path, film in missing], maker.progress)
    files = {path: FilmFile(film.codec, path.name, file_digest(path)) for path, film in every.items()}
    return [_pair_video(films, files) for films in planned]


def _in_blind_order(pair: Sequence[Stimulus], digests: Mapping[str, str]) -> list[Stimulus]:
    """Order the stimuli of a pair as if by lot: by one order of all stimuli, some would be on top in every pair."""
    both = "".join(sorted(digests[stimulus.name] for stimulus in pair))
    lots = {s.name: hashlib.sha256(f"{both}{digests[s.name]}".encode()).hexdigest() for s in pair}
    return sorted(pair, key=lambda stimulus: (lots[stimulus.name], stimulus.name))


def _planned(
    stimulus_set: StimulusSet, stimuli: tuple[Stimulus, ...], digests: Mapping[str, str], maker: FilmMaker
) -> PlannedFilms:
    """Return the films of a pair: all its strips in one, in each codec, H.264 first; then each strip alone."""

    def film(strips: tuple[Stimulus, ...], codec: str) -> tuple[Path, Strips]:
        key = film_key(codec, [digests[s.name] for s in strips])
        return maker.media_dir / f"{key}.mp4", Strips(strips, tuple(stimulus_set.source(s) for s in strips), codec)

    singles = [film((stimulus,), SINGLE) for stimulus in stimuli] if maker.has_singles else []
    return [*(film(stimuli, codec) for codec in maker.codecs), *singles]


def _pair_video(planned: PlannedFilms, files: Mapping[Path, FilmFile]) -> PairVideo:
    first = planned[0][1]
    stimuli = first.stimuli if first.codec != SINGLE else tuple(strips.stimuli[0] for _, strips in planned)
    top, bottom = stimuli[0], stimuli[min(1, len(stimuli) - 1)]
    return PairVideo(
        top,
        bottom,
        width=top.width,
        height=top.height,
        guard_rows=GUARD_ROWS,
        fps=top.fps,
        n_frames=top.n_frames,
        **_by_use([files[path] for path, _ in planned]),
    )


def _padded_pair(video: PairVideo, made: Mapping[tuple[str, str, str], FilmFile]) -> PairVideo:
    """Return a pair with the padded copies of its films, by dataset, codec and file."""
    return replace(video, **_by_use([made[video.top.dataset, film.codec, film.file] for film in video.films]))


def _by_use(films: Sequence[FilmFile]) -> dict[str, Any]:
    """Return a pair's films, that of both in H.264 first where there is one, as the fields of `PairVideo`."""
    first, *others = films
    return {
        "file": first.file,
        "sha256": first.sha256,
        "second": next((film for film in others if film.codec not in (SINGLE, LIGHTER)), None),
        "singles": tuple(film for film in films if film.codec == SINGLE),
        "lighter": next((film for film in others if film.codec == LIGHTER), None),
    }

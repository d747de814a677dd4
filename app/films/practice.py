"""Choose the films that participants practise with: of the study's own kind, and plainly different.

Recommendations ask for training with other contents than those of the test, of the same kind and range (ITU-R BT.500,
"training sequences"; ITU-T P.910, the training session). So a scene that is for practice alone comes first; a pair of
the trials is only the last resort, and a note says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from app.errors import StimuliError
from app.ffmpeg import in_parallel, no_progress, reading, run_ffmpeg
from app.intake.stimuli import Stimulus, StimulusSet
from app.study.options.practice import MOST_PRACTICE, PracticeFilms

LOOK_WIDTH = 160  # pixels to which films are reduced to be compared: what is plain is plain in small
LOOKS = 5  # pictures of each film that are compared, evenly over its length

Pair = tuple[Stimulus, Stimulus]


@dataclass(frozen=True)
class Practice:
    """What participants practise with.

    Parameters
    ----------
    pairs : that differ plainly
    compared : the stimuli of the trials: all but those of a dataset that is for practice only
    notes : sentences for the experimenter
    """

    pairs: tuple[Pair, ...]
    compared: StimulusSet
    notes: tuple[str, ...] = ()

    @property
    def films(self) -> tuple[PracticeFilms, ...]:
        """The pairs by their names, as a study's options keep them."""
        return tuple(PracticeFilms(dataset=a.dataset, a=a.approach, b=b.approach) for a, b in self.pairs)


def choose_practice(
    stimulus_set: StimulusSet,
    dataset: str,
    wanted: Sequence[PracticeFilms],
    reference: str = "",
    *,
    is_rated_against: bool = False,
) -> Practice:
    """Choose the films to practise with: those wanted, else the dataset's, else the set's, else two of the trials.

    Parameters
    ----------
    stimulus_set : of the study
    dataset : that is for practice only; empty: none
    wanted : films to practise with; empty: the two that differ most
    reference : the condition that is the study's reference; empty: none
    is_rated_against : is every film rated against the reference, as in DCR? Then the practice shows it first, where the
        dataset has it; else the reference is shown beside the pairs, and left out here unless it is wanted

    Raises
    ------
    StimuliError
        If the set lacks the dataset or a film, nothing is left to compare, or the films are too many.
    """
    compared = without_dataset(stimulus_set, dataset) if dataset else stimulus_set
    choosable = stimulus_set if is_rated_against else stimulus_set.without(reference)
    if wanted:
        pairs = tuple(_found(stimulus_set, films) for films in wanted)
    elif dataset:
        pairs = (most_different(stimulus_set, choosable.of_dataset(dataset)),)
    elif stimulus_set.practice:
        first, second = stimulus_set.practice
        pairs = ((first, second),)
    else:
        pairs = (most_different(stimulus_set, choosable.of_dataset(compared.datasets[0])),)
    if is_rated_against:
        pairs = tuple(_against_reference(stimulus_set, pairs, reference))
        if len(pairs) > MOST_PRACTICE:
            raise StimuliError(
                f"practice has {len(pairs)} films to rate against {reference}, expected {MOST_PRACTICE} at most"
            )
    return Practice(pairs, compared, tuple(_note(pair) for pair in pairs if pair[0] in compared.stimuli))


def _against_reference(stimulus_set: StimulusSet, pairs: Sequence[Pair], reference: str) -> Iterator[Pair]:
    """Yield every film of the pairs after the reference of its dataset; a dataset without one keeps its pair."""
    films = _films_by_name(stimulus_set)
    for pair in pairs:
        first = films.get((pair[0].dataset, reference))
        yield from [pair] if first is None else ((first, film) for film in pair if film != first)


def without_dataset(stimulus_set: StimulusSet, dataset: str) -> StimulusSet:
    """Return the set without a dataset that is for practice only.

    Raises
    ------
    StimuliError
        If there is no such dataset, or no other.
    """
    if dataset not in stimulus_set.datasets:
        raise StimuliError(
            f"the dataset for practice is {dataset!r}, expected one of {', '.join(stimulus_set.datasets)}"
        )
    if len(stimulus_set.datasets) == 1:
        raise StimuliError(
            f"{dataset} is the only dataset: if it is for practice only, nothing is left to compare; add another scene"
        )
    return stimulus_set.without_dataset(dataset)


def most_different(stimulus_set: StimulusSet, stimuli: Sequence[Stimulus]) -> Pair:
    """Return the two stimuli whose films differ most: by the mean square of a few small pictures.

    Raises
    ------
    StimuliError
        If there are fewer than two, or a film cannot be decoded.
    """
    if len(stimuli) < 2:
        names = ", ".join(stimulus.name for stimulus in stimuli) or "none"
        raise StimuliError(f"practice needs two films to compare, found {names}")
    with TemporaryDirectory() as folder:
        files = [Path(folder) / f"{number}.rgb" for number in range(len(stimuli))]
        jobs = [
            (stimulus.name, partial(_write_looks, stimulus_set.source(stimulus), stimulus.n_frames, file))
            for stimulus, file in zip(stimuli, files, strict=True)
        ]
        in_parallel(jobs, no_progress)
        looks = [np.fromfile(file, np.uint8).astype(np.float32) for file in files]
    first, second = max(combinations(range(len(stimuli)), 2), key=lambda two: _difference(looks[two[0]], looks[two[1]]))
    return stimuli[first], stimuli[second]


def _difference(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    return float(np.mean((a - b) ** 2))


def _write_looks(film: Path, n_frames: int, out: Path) -> None:
    """Write a few pictures of a film, small, as bytes of red, green and blue."""
    step = max(1, n_frames // LOOKS)
    look = f"select=not(mod(n\\,{step})),scale={LOOK_WIDTH}:-2"
    command = [*reading(film), "-vf", look, "-fps_mode", "passthrough", "-pix_fmt", "rgb24", "-f", "rawvideo"]
    run_ffmpeg([*command, str(out)], f"{film}: cannot be decoded as a video")


def _found(stimulus_set: StimulusSet, films: PracticeFilms) -> Pair:
    known = _films_by_name(stimulus_set)
    of_dataset = [approach for dataset, approach in known if dataset == films.dataset]
    for approach in (films.a, films.b):
        if approach not in of_dataset:
            raise StimuliError(
                f"{films.dataset}/{approach} is to be practised with, and the stimulus set has no such film; "
                f"of {films.dataset} it has {', '.join(of_dataset) or 'none'}"
            )
    return known[films.dataset, films.a], known[films.dataset, films.b]


def _films_by_name(stimulus_set: StimulusSet) -> Mapping[tuple[str, str], Stimulus]:
    """Return dataset and condition -> stimulus, of the trials and of the practice."""
    every = (*stimulus_set.stimuli, *stimulus_set.practice)
    return {(stimulus.dataset, stimulus.approach): stimulus for stimulus in every}


def _note(pair: Pair) -> str:
    a, b = pair
    return (
        f"The practice shows {a.name} and {b.name}, and the trials compare these two films, too: participants know "
        "them before they vote. ITU-R BT.500 and ITU-T P.910 ask for other contents in training, such as a "
        "dataset for practice alone"
    )

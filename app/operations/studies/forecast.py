"""Say beforehand what a study will be: its pairs and trials, the films to make, their time and size, minutes a person.

How long an encoder takes here, and what it makes of such films, is measured in the middle of films of some scenes.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from app.errors import StimuliError
from app.ffmpeg import WORKERS
from app.films.pairs import split_reference
from app.films.practice import without_dataset
from app.films.strips import GUARD_ROWS, H264, LIGHTER, SINGLE, Strips, encode
from app.intake.stimuli import Stimulus, StimulusSet, read_manifest
from app.operations.studies.prepare import chosen_exposure, left_out
from app.settings import Settings
from app.study.design.adaptive import adaptive_pairs, check_adaptive
from app.study.design.balance import OrderPlan
from app.study.design.groups import check_groups
from app.study.options.duration import stage_minutes, whole_minutes
from app.study.options.options import StudyOptions, check_minimum_viewing
from app.study.protocols import DCR, WITH_REFERENCE
from app.study.stages import PRACTICE
from app.study.trial.trial import PlannedPair

SAMPLED_FRAMES, FEWEST_SAMPLED = 25, 8  # of a film: enough for an encoder to predict from
SAMPLED_SCENES = 3  # scenes differ more than films of one do
SAMPLED_PIXELS = 25e6 / SAMPLED_SCENES  # which take some seconds together
MOST_PAIR_FILMS = 1000  # pairs; of full-HD films of 10 s their films take two cores half a day
SINGLE_FILMS: Mapping[str, Any] = {"pair_films": "decoded", "lighter_films": False, "second_codec": ""}  # far fewer
PAIR_FILMS: Mapping[str, Any] = {"pair_films": "made"}  # which every browser plays
CHECKING = 1.45  # time of a film with its check, by that of encoding it alone: 1.38 to 1.52 from 320x180 to 1920x1080


@dataclass(frozen=True)
class Forecast:
    """What a study will be.

    Parameters
    ----------
    n_pairs : to compare; 0: films are shown one by one
    n_trials : of a participant, without practice
    n_films : files to make
    n_bytes, seconds : of these files, about; NaN where no film could be encoded to measure it
    minutes : of a session, by stage, as participants are told them
    free_bytes : that the disk has
    """

    n_pairs: int
    n_trials: int
    n_films: int
    n_bytes: float
    seconds: float
    minutes: dict[str, int]
    free_bytes: int

    @property
    def is_too_large(self) -> bool:
        """Do the films need more than the disk has?"""
        return self.n_bytes > 0.9 * self.free_bytes


def forecast(
    settings: Settings, stimulus_set: StimulusSet, options: StudyOptions, exposure_s: float | None
) -> Forecast:
    """Say what a study of a stimulus set will be, without making it.

    Raises
    ------
    ValueError
        If an option does not fit the set.
    """
    kept = left_out(stimulus_set, options.without)
    compared = without_dataset(kept, options.practice_dataset) if options.practice_dataset else kept
    exposure = chosen_exposure(compared, exposure_s)
    _check(compared, options, exposure)
    films = list(_films(compared, options))
    pairs = _planned(compared, films)
    plan = _order_plan(compared, pairs, options)
    shown = adaptive_pairs(pairs, {}, options.adaptive_pairs, 0, 0) if options.adaptive_pairs else pairs
    n_trials = plan.most_trials(shown)
    sampled = [compared.of_dataset(dataset)[:2] for dataset in _spread(compared.datasets)]
    practised = sampled[0]
    n_practised = options.n_practice if PRACTICE in options.way else 0
    codecs = (H264, *filter(None, [options.second_codec]), *([LIGHTER] if options.lighter_films else []))
    codecs = codecs if options.has_pair_films else ()
    files = [(film, codec) for film in (*films, *[practised] * n_practised) for codec in codecs]
    if options.has_single_films:
        files += [((stimulus,), SINGLE) for stimulus in compared.stimuli]
    costs = {codec: _cost(compared, sampled, codec) for codec in {codec for _, codec in files}}
    return Forecast(
        n_pairs=sum(not pair.is_identical for pair in pairs),
        n_trials=n_trials,
        n_films=len(files),
        n_bytes=sum(_pixels(film) * costs[codec][0] for film, codec in files),
        seconds=sum(_pixels(film) * costs[codec][1] for film, codec in files) * CHECKING / WORKERS,
        minutes=whole_minutes(stage_minutes(options, n_trials, exposure)),
        free_bytes=shutil.disk_usage(settings.data_dir).free,
    )


def _check(compared: StimulusSet, options: StudyOptions, exposure_s: float) -> None:
    """Refuse what the making of the study would refuse, minutes later."""
    check_minimum_viewing(options, exposure_s)
    check_groups(options.groups, compared.datasets)
    if options.reference:
        compared, _ = split_reference(compared, options.reference, 1 if options.protocol in WITH_REFERENCE else 2)
    if options.adaptive_pairs:
        check_adaptive(options.adaptive_pairs, len(compared.conditions))


def has_many_pairs(stimulus_set: StimulusSet) -> bool:
    """Are there too many pairs to make a film of each, which takes hours?"""
    counted = (len(stimulus_set.of_dataset(dataset)) for dataset in stimulus_set.datasets)
    return sum(n * (n - 1) // 2 for n in counted) > MOST_PAIR_FILMS


def _films(compared: StimulusSet, options: StudyOptions) -> Iterator[Sequence[Stimulus]]:
    """Yield what each film of the trials holds, from the top."""
    for dataset in compared.datasets:
        stimuli = compared.of_dataset(dataset)
        reference = [stimulus for stimulus in stimuli if options.reference and stimulus.approach == options.reference]
        others = [stimulus for stimulus in stimuli if stimulus not in reference]
        if options.is_shown_alone:
            yield from ((stimulus,) for stimulus in stimuli)
        elif options.protocol == DCR:
            yield from ((*reference, stimulus) for stimulus in others)
            yield from ((film, film) for film in reference if options.identical_pairs)
        else:
            below = [] if options.protocol in WITH_REFERENCE else reference
            yield from ((*two, *below) for two in combinations(others, 2))
            yield from ((film, film, *below) for film in others if options.identical_pairs)


def _planned(compared: StimulusSet, films: Sequence[Sequence[Stimulus]]) -> list[PlannedPair]:
    keys = {stimulus.name: key for key, stimulus in enumerate(compared.stimuli)}
    datasets = {name: key for key, name in enumerate(compared.datasets)}
    return [
        PlannedPair(key, datasets[film[0].dataset], keys[film[0].name], keys[film[min(1, len(film) - 1)].name])
        for key, film in enumerate(films)
    ]


def _order_plan(compared: StimulusSet, pairs: Sequence[PlannedPair], options: StudyOptions) -> OrderPlan:
    names = {number: (stimulus.dataset, stimulus.approach) for number, stimulus in enumerate(compared.stimuli)}
    plan = OrderPlan(pairs, 0, options.repetition, names, protocol=options.protocol)
    return replace(plan, is_adaptive=options.adaptive_pairs > 0, groups=options.groups)


def _pixels(film: Sequence[Stimulus]) -> int:
    first, n = film[0], len(film)
    return first.width * (n * first.height + (n - 1) * GUARD_ROWS) * first.n_frames


def _spread(datasets: Sequence[str]) -> list[str]:
    """Return some datasets: the first, the last and between them."""
    places = np.linspace(0, len(datasets) - 1, min(len(datasets), SAMPLED_SCENES))
    return [datasets[round(place)] for place in places]


def _cost(compared: StimulusSet, sampled: Sequence[Sequence[Stimulus]], codec: str) -> tuple[float, float]:
    """Return the bytes and the seconds that a pixel takes in a codec, on average of films with these stimuli."""
    n_shown = 1 if codec == SINGLE else None
    names = [tuple(stimulus.name for stimulus in shown[:n_shown]) for shown in sampled]
    costs = [_measured(compared.folder, compared.sha256, shown, codec) for shown in names]
    n_bytes, seconds = np.mean(costs, axis=0)
    return float(n_bytes), float(seconds)


@lru_cache(maxsize=256)
def _measured(folder: Path, _sha256: str, names: Sequence[str], codec: str) -> tuple[float, float]:
    """Measure it once for each set, which its manifest's digest tells apart from what the folder held before."""
    known = read_manifest(folder)
    shown = tuple(stimulus for stimulus in known.stimuli if stimulus.name in names)
    strips = Strips(shown, tuple(known.source(stimulus) for stimulus in shown), codec)
    n_frames = shown[0].n_frames
    affordable = int(SAMPLED_PIXELS * n_frames / _pixels(shown))
    n_sampled = min(n_frames, SAMPLED_FRAMES, max(FEWEST_SAMPLED, affordable))
    with TemporaryDirectory() as work:
        out, begun_s = Path(work) / "sample.mp4", perf_counter()
        try:
            encode(strips, out, part=((n_frames - n_sampled) / 2 / shown[0].fps, n_sampled))
        except StimuliError:  # every film is checked when it is made, and refused then in words
            return float("nan"), float("nan")
        n_pixels = _pixels(shown) * n_sampled / n_frames
        return out.stat().st_size / n_pixels, (perf_counter() - begun_s) / n_pixels

"""Prepare what a study shows: from a stimulus set and options to conditions, films and how long they are shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.errors import StimuliError
from app.ffmpeg import Progress
from app.files import one_by_one_in
from app.films.object_store import MediaStore
from app.films.pairs import (
    NO_REFERENCES,
    FilmMaker,
    PairVideo,
    equally_large,
    prepare_against,
    prepare_alone,
    prepare_identical,
    prepare_pairs,
    prepare_practice,
    split_reference,
)
from app.films.practice import Practice, choose_practice, without_dataset
from app.intake.stimuli import StimulusSet, read_stimulus_set
from app.settings import Settings
from app.study.design.adaptive import check_adaptive
from app.study.design.groups import check_groups
from app.study.option_fields import SettingError
from app.study.options.options import StudyOptions, check_minimum_viewing, parse_options, without_effect
from app.study.protocols import DCR, EXPOSURE_BOUNDS_S, WITH_REFERENCE
from app.study.stages import PRACTICE


@dataclass(frozen=True)
class PreparedStudy:
    """What a study shows, with its films.

    Parameters
    ----------
    shown : stimuli that are compared, and hidden references
    pairs : films of the trials
    practice : films to practise with
    options : with the films of the practice named
    exposure_s : how long a pair is shown
    factors : levels by factor
    manifest_sha256 : of the stimulus set
    set_folder : where the stimulus set lies
    set_name : the stimulus set's
    notes : sentences for the experimenter
    """

    shown: StimulusSet
    pairs: Sequence[PairVideo]
    practice: Sequence[PairVideo]
    options: StudyOptions
    exposure_s: float
    factors: dict[str, list[str]]
    manifest_sha256: str
    set_folder: Path
    set_name: str
    notes: tuple[str, ...]


def prepare_study(
    settings: Settings, manifest_path: Path, options: StudyOptions, exposure_s: float | None, progress: Progress
) -> PreparedStudy:
    """Check a stimulus set and options, and make the films that are missing.

    Parameters
    ----------
    settings : where films go
    manifest_path : the stimulus set's folder or manifest
    options : the study's
    exposure_s : how long a pair is shown; None: as long as the shortest video
    progress : called after each video

    Raises
    ------
    ValueError
        If an option does not fit the set, or a number is out of bounds; StimuliError if the set cannot be used.
    """
    useless = without_effect(options)
    options = parse_options({**options.as_json(), **dict.fromkeys(useless, 0)})
    stimulus_set = left_out(read_stimulus_set(manifest_path, progress), options.without)
    practice = _practice(stimulus_set, options)
    exposure = chosen_exposure(practice.compared, exposure_s)
    check_minimum_viewing(options, exposure)
    check_groups(options.groups, practice.compared.datasets)
    with one_by_one_in(settings.media_dir):  # studies of one set share films, which are removed once padded
        shown, pairs, practised = _prepare_films(settings, stimulus_set, practice, options, progress)
    return PreparedStudy(
        shown=shown,
        pairs=pairs,
        practice=practised,
        options=options.but(practice_pairs=practice.films),
        exposure_s=exposure,
        factors=practice.compared.factors,
        manifest_sha256=stimulus_set.sha256,
        set_folder=stimulus_set.folder.resolve(),
        set_name=stimulus_set.name,
        notes=(*practice.notes, *(f"{reason}; it was left out" for reason in useless.values())),
    )


def prepared_columns(made: PreparedStudy) -> dict[str, Any]:
    """Return the columns of a study's row that follow from what it shows."""
    return {
        "exposure_s": made.exposure_s,
        "factors": made.factors,
        "options": made.options.as_json(),
        "manifest_sha256": made.manifest_sha256,
        "set_folder": str(made.set_folder),
    }


def left_out(stimulus_set: StimulusSet, conditions: Sequence[str]) -> StimulusSet:
    """Return the set without conditions that a study neither shows nor compares.

    Raises
    ------
    StimuliError
        If the set has no such condition, or a dataset has one other stimulus, or none.
    """
    if unknown := [condition for condition in conditions if condition not in stimulus_set.conditions]:
        raise StimuliError(
            f"{unknown[0]!r} cannot be left out: it is none of the set's conditions, "
            f"{', '.join(stimulus_set.conditions)}"
        )
    kept = stimulus_set.without(*conditions)
    for dataset in stimulus_set.datasets:
        if (n := len(kept.of_dataset(dataset))) < 2:
            raise StimuliError(
                f"dataset {dataset} has {n} stimuli without {', '.join(conditions)}, expected at least two to compare"
            )
    return kept


def _practice(stimulus_set: StimulusSet, options: StudyOptions) -> Practice:
    """Choose what the study's participants practise with, and what is left to compare."""
    if PRACTICE in options.way:
        is_rated_against = options.protocol == DCR
        reference = options.reference if is_rated_against else options.reference_beside
        return choose_practice(
            stimulus_set,
            options.practice_dataset,
            options.practice_pairs,
            reference,
            is_rated_against=is_rated_against,
        )
    if options.practice_dataset:
        return Practice((), without_dataset(stimulus_set, options.practice_dataset))
    return Practice((), stimulus_set)


def _prepare_films(
    settings: Settings, stimulus_set: StimulusSet, practice: Practice, options: StudyOptions, progress: Progress
) -> tuple[StimulusSet, list[PairVideo], list[PairVideo]]:
    """Make the missing films and upload them to the object store, if there is one.

    Returns
    -------
    The stimuli that the study shows, the films of its pairs, and those of the practice.
    """
    compared, references = practice.compared, NO_REFERENCES
    if options.reference:
        fewest = 1 if options.protocol in WITH_REFERENCE else 2
        compared, references = split_reference(compared, options.reference, fewest)
    if options.adaptive_pairs:
        check_adaptive(options.adaptive_pairs, len(compared.conditions))
    maker = FilmMaker(
        settings.media_dir,
        options.second_codec,
        options.has_single_films,
        options.lighter_films,
        progress,
        options.has_pair_films,
    )
    if options.is_shown_alone:
        pairs = prepare_alone(practice.compared, maker)
    elif options.protocol == DCR:
        pairs = prepare_against(compared, maker, references, has_identical=options.identical_pairs > 0)
    else:
        pairs = prepare_pairs(compared, maker, references)
        if options.identical_pairs:
            pairs += prepare_identical(compared, maker, references)
    practised = []
    if practice.pairs:
        practised = prepare_practice(stimulus_set, practice.pairs, maker, is_alone=options.is_shown_alone)
    films = equally_large(settings.media_dir, [*pairs, *practised])
    pairs, practised = films[: len(pairs)], films[len(pairs) :]
    if settings.media_url:
        files = [film.file for video in films for film in video.films]
        MediaStore(settings.media_url).upload(settings.media_dir / file for file in files)
    shown = practice.compared if options.protocol in WITH_REFERENCE else compared
    return shown, pairs, practised


def chosen_exposure(stimulus_set: StimulusSet, wanted_s: float | None) -> float:
    """Return how long a pair is shown, s: the wanted time, or the length of the shortest video."""
    shortest_s = min(round(stimulus.n_frames / stimulus.fps, 3) for stimulus in stimulus_set.stimuli)
    exposure_s = float(shortest_s if wanted_s is None else wanted_s)
    low_s, high_s = EXPOSURE_BOUNDS_S
    if not low_s <= exposure_s <= high_s:
        raise SettingError("exposure_s", f"{exposure_s} s: expected between {low_s} and {high_s}", "exposure")
    return exposure_s

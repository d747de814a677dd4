"""From runs and models folders to films: all that is wrong with the models is found here, before the first frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median_low

import numpy as np
from numpy.typing import NDArray

from recon.capture.recording import evenly_chosen
from recon.models.inspection import Facts, check_sizes, is_seen, standing_height, union
from recon.pipeline.film import Film, RenderOptions, path_name
from recon.pipeline.keys import camera_key
from recon.pipeline.sources import ModelSequence, SceneSetting, Source, inspect_file, raise_problems
from recon.runtime.remote import address_of
from recon.runtime.workers import Pool, Progress

MOST_STANDING = 3  # models of an approach that say where it stands


def check_loops(sources: Sequence[Source], options: RenderOptions) -> None:
    """Make sure that moving approaches of a scene show the same moment at the same time.

    Parameters
    ----------
    sources : all that is filmed
    options : how; an approach whose loop is chosen by name may be of another length

    Raises
    ------
    ValueError
        If an approach with a loop of its own does not exist, or lengths or frame rates differ.
    """
    sequences = [item for source in sources for item in source.sequences]
    names = {item.approach for item in sequences}
    problems = [
        f"a loop is chosen for {name!r}, but there is no such approach; there are {', '.join(sorted(names))}"
        for name in options.loops
        if name not in names
    ]
    for dataset in dict.fromkeys(source.dataset for source in sources):
        moving = [
            item
            for item in sequences
            if item.dataset == dataset and item.approach not in options.loops and not item.is_still
        ]
        if options.loop != "static":
            problems += _unlike(moving)
    raise_problems(problems)


def check_path_is_read_only(sources: Sequence[Source], options: RenderOptions, out: Path) -> None:
    """Raise a ValueError if cameras would be read from the file that they are written to.

    Parameters
    ----------
    sources, options : what is filmed, and how
    out : folder of the stimulus set
    """
    for source in sources:
        written = out / path_name(source.dataset)
        if written in (options.path, source.setting.file):
            raise ValueError(
                f"{address_of(written)}: is written by this command; copy it and name the copy as the path"
            )


def planned_films(
    sources: Sequence[Source], options: RenderOptions, pool: Pool, progress: Progress
) -> tuple[list[Film], list[str]]:
    """Read every model once, and return the films of all approaches and a sentence for each warning.

    Parameters
    ----------
    sources : all that is filmed
    options : how
    pool : where the models are read
    progress : told after each model

    Raises
    ------
    ValueError
        If a model cannot be filmed, or the folders of a scene differ in bounds or path; a line for each fault.
    """
    for source in sources:
        if source.setting.bounds is not None or source.setting.orbit is None or isinstance(options.path, Path):
            source.setting.cameras(options.path, options.n_frames, options.size)  # a wrong path is told at once
    sequences = [
        item.first() if options.loop_of(item) == "static" else item for source in sources for item in source.sequences
    ]
    facts = _inspect(sequences, pool, progress)
    raise_problems([fact.problem for fact in facts.values() if fact.problem is not None])
    films: list[Film] = []
    problems = list(_without_faces(sequences, facts))
    warnings = list(_warnings(sequences, facts))
    for dataset in dict.fromkeys(source.dataset for source in sources):
        of_scene = [item for item in sequences if item.dataset == dataset]
        settings = [source.setting for source in sources if source.dataset == dataset]
        bounds = next((setting.bounds for setting in settings if setting.bounds is not None), None)
        units = {file: item.placement.unit for item in of_scene if item.placement is not None for file in item.files}
        faults, remarks = check_sizes(_foreign(of_scene, facts), units, bounds)
        problems, warnings = problems + faults, warnings + remarks
        if not faults:
            bounds = union(list(_foreign(of_scene, facts).values())) if bounds is None else bounds
            floor_y = _floor([_with_digests(item, facts) for item in of_scene], bounds, options, pool)
            setting, *others = (
                replace(each, bounds=bounds if each.bounds is None else each.bounds, floor_y=floor_y)
                for each in settings
            )
            films += [Film(_with_digests(item, facts), setting, options) for item in of_scene]
            problems += [fault for other in others for fault in _differing(dataset, setting, other, options)]
            problems += _unseen(films[-1], _foreign(of_scene, facts))
    raise_problems(problems)
    return films, warnings


def _floor(
    sequences: Sequence[ModelSequence], bounds: NDArray[np.float64], options: RenderOptions, pool: Pool
) -> float | None:
    """Return the height of a scene's floor, mm, one for all approaches; None for the bottom of the bounds.

    Each approach stands where the lowest of some of its models does, and the floor lies in the middle of these.
    """
    if options.floor != "model":
        return None if options.floor == "bounds" else float(options.floor)
    tasks = [
        partial(_standing, item, index, bounds)
        for item in sequences
        for index in evenly_chosen(len(item.files), MOST_STANDING)
    ]
    heights: dict[str, list[float]] = {}
    for approach, height in pool.run(tasks):
        if height is not None:
            heights.setdefault(approach, []).append(height)
    return round(median_low(map(min, heights.values())), 1) if heights else None


def _standing(item: ModelSequence, index: int, bounds: NDArray[np.float64]) -> tuple[str, float | None]:
    return item.approach, standing_height(item.read(index), bounds)


def _inspect(sequences: Sequence[ModelSequence], pool: Pool, progress: Progress) -> dict[Path, Facts]:
    tasks = [
        partial(inspect_file, file, digest, item.placement)
        for item in sequences
        for file, digest in zip(item.files, item.digests, strict=True)
    ]
    facts: dict[Path, Facts] = {}
    progress("models checked", 0, len(tasks))
    for file, fact in pool.run(tasks):
        facts[file] = fact
        progress("models checked", len(facts), len(tasks))
    return {file: facts[file] for item in sequences for file in item.files}


def _foreign(sequences: Sequence[ModelSequence], facts: Mapping[Path, Facts]) -> dict[Path, Facts]:
    """Return what is known of the models of models folders."""
    return {file: facts[file] for item in sequences if item.placement is not None for file in item.files}


def _with_digests(sequence: ModelSequence, facts: Mapping[Path, Facts]) -> ModelSequence:
    known = [facts[file] for file in sequence.files]
    return replace(sequence, digests=tuple(fact.digest for fact in known), sizes=tuple(fact.n_bytes for fact in known))


def _without_faces(sequences: Sequence[ModelSequence], facts: Mapping[Path, Facts]) -> Iterator[str]:
    """Yield a sentence for each cloud in a sequence of meshes: it would be drawn in another way than they."""
    for item in sequences:
        clouds = [file for file in item.files if facts[file].is_cloud]
        if len(clouds) < len(item.files):
            for file in clouds:
                yield f"{file}: has points and no faces, but other models of {item.approach} have faces; add the faces"


def _unlike(sequences: Sequence[ModelSequence]) -> Iterator[str]:
    """Yield a sentence for each sequence whose length differs from that of the first."""
    for item in sequences[1:]:
        first = sequences[0]
        if len(item.files) != len(first.files):
            yield (
                f"{item.dataset}: {item.approach} has {_counted(len(item.files))}, {first.approach} has "
                f"{len(first.files)}, so they would show different moments at the same time; add what is missing, or "
                f"choose how one of them fills the film, for example --loop {item.approach}=repeat or "
                f"--static {item.approach}"
            )
        elif item.fps != first.fps and len(item.files) > 1:
            yield (
                f"{item.dataset}: {item.approach} has {item.fps:g} models a second, {first.approach} {first.fps:g}, so "
                "they would show different moments at the same time; correct fps in scene.json"
            )


def _counted(n_models: int) -> str:
    return "1 model" if n_models == 1 else f"{n_models} models"


def _warnings(sequences: Sequence[ModelSequence], facts: Mapping[Path, Facts]) -> Iterator[str]:
    """Yield each warning once for an approach, with how many of its models it holds for."""
    for item in sequences:
        warned: dict[str, list[Path]] = {}
        for file in item.files:
            for warning in facts[file].warnings:
                warned.setdefault(warning, []).append(file)
        for warning, files in warned.items():
            more = f", as {len(files) - 1} more of {item.approach}" if len(files) > 1 else ""
            yield f"{files[0]}: {warning}{more}"


def _differing(dataset: str, setting: SceneSetting, other: SceneSetting, options: RenderOptions) -> Iterator[str]:
    cameras, others = (each.cameras(options.path, options.n_frames, options.size) for each in (setting, other))
    assert setting.bounds is not None
    assert other.bounds is not None
    if list(map(camera_key, cameras)) != list(map(camera_key, others)):
        yield (
            f"{dataset}: {setting.source} and {other.source} would be filmed along different paths, as they differ in "
            "sensors, bounds or path; name the same capture, run or file as the path in scene.json"
        )
    elif not np.array_equal(setting.bounds, other.bounds):
        yield (
            f"{dataset}: {setting.source} and {other.source} differ in bounds, so their light would differ; "
            "give both the same bounds"
        )


def _unseen(film: Film, foreign: Mapping[Path, Facts]) -> Iterator[str]:
    cameras = film.cameras()
    for file, fact in foreign.items():
        if not is_seen(fact, cameras):
            yield f"{file}: no camera of the path sees it; look at up, units and world_from_model in scene.json"

"""Import a folder DATASET/CONDITION.mp4 of anybody's videos as a stimulus set, with factors from conditions.csv.

A folder that `reconstudy render` wrote keeps what it knows: masters, quality, camera paths, and with its manifest all.
"""

from __future__ import annotations

import shlex
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import StimuliError
from app.ffmpeg import VIDEO_SUFFIXES, Progress, VideoFacts, decode, in_parallel, no_progress
from app.files import file_digest, read_json, whole_folder, write_json
from app.intake.merge import NewSet, merge_sets, refuse_used, set_notes
from app.intake.stimuli import FPS_TOLERANCE, MANIFEST, read_manifest
from app.intake.treatment import (
    LOSSLESS,
    RANGES,
    SUFFIX,
    Target,
    Treatment,
    colours_told,
    common_target,
    conformed,
    look_notes,
    treatment_of,
    write_treated,
)
from ground.file_models import SCHEMA_KEY, schema_name

CONDITIONS = "conditions.csv"
MASTER = ".master"  # ends the name of a film's lossless master, before the suffix
MASK = ".mask"  # ends the name of the video of a model's silhouette
QUALITY = ".quality.json"
PATHS = "paths"  # folder of camera paths, DATASET.json

Levels = Mapping[str, Mapping[str, str]]  # condition -> factor -> level


@dataclass(frozen=True)
class SourceVideo:
    """A video in the folder that is imported, with its master and its mask if there are some."""

    dataset: str
    condition: str
    path: Path
    master: Path | None = None
    mask: Path | None = None

    @property
    def name(self) -> str:
        return f"{self.dataset}/{self.condition}"


@dataclass(frozen=True)
class Film:
    """A video that was looked at, and what is done to it."""

    video: SourceVideo
    facts: VideoFacts
    treatment: Treatment


def import_stimuli(
    folder: Path,
    out: Path,
    *,
    practice: str | None = None,
    is_conformed: bool = False,
    untagged_range: str = "",
    name: str = "",
    progress: Progress = no_progress,
) -> NewSet:
    """Make a stimulus set of the videos of a folder: look at each, make right what browsers would show wrong, check it.

    Parameters
    ----------
    folder : holds a folder per dataset with a video per condition, named by the condition; beside them `conditions.csv`
        (condition, <factor>, …) where conditions have factors. `NAME.master.mp4` beside `NAME.mp4` is its master,
        `NAME.mask.mp4` its mask. With a stimulus set's manifest, the folder is copied with all that the manifest says
    out : the stimulus set's folder, missing or empty
    practice : the dataset whose two videos are for practice, the clearly better one first in the alphabet
    is_conformed : make videos of a dataset alike that differ in size, frame rate or length, instead of refusing them
    untagged_range : limited or full, of videos that do not say theirs; empty: refuse those where it matters
    name : the set's; empty: the folder's
    progress : called after each video

    Raises
    ------
    StimuliError
        If there is nothing to import, datasets have different conditions, a video cannot be decoded or made right, or
        differs from the others of its dataset in size, frame rate or length, or the table of conditions does not fit.
        No file is left behind.
    """
    refuse_used(out)
    if _is_set(folder):
        return _copy_set(folder, out, practice, progress)
    videos, unknown = _find(folder)
    compared = [video for video in videos if video.dataset != practice]
    _check_complete(folder, videos, compared, practice)
    levels = _read_levels(folder / CONDITIONS, sorted({video.condition for video in compared}))
    films = _alike(_looked_at(videos, RANGES.get(untagged_range, ""), progress), is_conformed=is_conformed)
    with whole_folder(out) as temporary:
        entries = _copy(films, temporary, levels, progress)
        paths = _copy_paths(folder, temporary, {video.dataset for video in compared})
        manifest = _manifest(name or folder.resolve().name, entries, levels, practice, _provenance(folder, paths))
        write_json(temporary / MANIFEST, manifest)
        made = read_manifest(temporary, folder)
    made = replace(made, folder=out)
    left_out = [f"left out, as neither film nor master: {', '.join(unknown)}"] if unknown else []
    seen = [note for film in films for note in look_notes(film.video.name, film.facts, film.treatment)]
    return NewSet(made, (*left_out, *seen, *_guessed(films), *set_notes(made)))


def _is_set(folder: Path) -> bool:
    """Tell a stimulus set by its manifest; other programs write files of this name, too."""
    manifest = folder / MANIFEST
    return manifest.is_file() and "stimuli" in read_json(manifest)


def _copy_set(folder: Path, out: Path, practice: str | None, progress: Progress) -> NewSet:
    if practice is not None:
        raise StimuliError(
            f"{folder}: has a {MANIFEST}, which says what is for practice; leave `--practice` away, or remove the "
            "manifest to import the videos alone"
        )
    made = read_manifest(folder)
    stimuli = (*made.stimuli, *made.practice)
    listed = {(folder / file).resolve() for s in stimuli for file in (s.video, s.master, s.mask) if file}
    if added := [path for path in _videos(folder) if path.resolve() not in listed]:
        raise StimuliError(
            f"{added[0]}: the folder's {MANIFEST} does not name it; remove it if an earlier rendering left "
            "it there, else put it into DATASET/CONDITION.mp4 of a folder of its own",
            by_command="import that, and join both by `reconstudy stimuli merge`",
            on_page="and import that by itself",
        )
    copied = merge_sets([folder], out, progress=progress)
    kept = f"{folder} is a stimulus set: its factors, masters, camera paths and provenance are kept"
    ignored = [f"{CONDITIONS} is left out: the manifest says the levels"] if (folder / CONDITIONS).exists() else []
    return NewSet(copied.stimulus_set, (kept, *ignored, *copied.notes))


def _videos(folder: Path) -> list[Path]:
    paths = sorted(path for path in folder.glob("*/*") if not path.name.startswith("."))
    return [path for path in paths if path.suffix.lower() in VIDEO_SUFFIXES]


def _find(folder: Path) -> tuple[list[SourceVideo], list[str]]:
    """Return the videos with their masters, and the names of files that are neither."""
    if not folder.is_dir():
        raise StimuliError(f"{folder}: is no folder; expected one with DATASET/CONDITION.mp4")
    paths = _videos(folder)
    if not paths:
        kinds = ", ".join(VIDEO_SUFFIXES)
        raise StimuliError(f"{folder}: holds no video; expected a folder for each dataset with CONDITION.mp4 ({kinds})")
    by_stem = _by_stem(paths)
    masters, masks = (_beside(by_stem, ending) for ending in (MASTER, MASK))
    films = {stem: path for stem, path in by_stem.items() if not stem.name.endswith((MASTER, MASK))}
    if lone := [master for film, master in masters.items() if film not in films]:
        stem = lone[0].stem.removesuffix(MASTER)
        raise StimuliError(
            f"{lone[0]}: is the master of a film {stem}{lone[0].suffix} that is not there; put the film beside it, or "
            f"rename it to {stem}{lone[0].suffix} to show it itself"
        )
    videos = [
        SourceVideo(path.parent.name, path.stem, path, masters.get(stem), masks.get(stem))
        for stem, path in films.items()
    ]
    return videos, _unknown(folder, paths)


def _beside(by_stem: Mapping[Path, Path], ending: str) -> dict[Path, Path]:
    """Return the videos whose stem has an ending, by the stem of the film that they belong to."""
    return {
        stem.with_name(stem.name.removesuffix(ending)): path
        for stem, path in by_stem.items()
        if stem.name.endswith(ending)
    }


def _by_stem(paths: Sequence[Path]) -> dict[Path, Path]:
    """Return videos by their path without suffix."""
    by_stem: dict[Path, Path] = {}
    for path in paths:
        other = by_stem.setdefault(path.with_name(path.stem), path)
        if other != path:
            raise StimuliError(
                f"{path.parent}: {other.name} and {path.name} are both the condition {path.stem}; keep one"
            )
    return by_stem


def _unknown(folder: Path, videos: Sequence[Path]) -> list[str]:
    """Return the files that are not taken, by their place in the folder."""
    datasets = {path.parent for path in videos}
    taken = {*videos, folder / CONDITIONS, *(folder / PATHS / f"{dataset.name}.json" for dataset in datasets)}
    qualities = {path.with_name(path.stem + QUALITY) for path in videos}
    files = sorted(path for pattern in ("*", "*/*") for path in folder.glob(pattern) if path.is_file())
    left = [path for path in files if path not in taken | qualities and not path.name.startswith(".")]
    return [path.relative_to(folder).as_posix() for path in left]


def _check_complete(
    folder: Path, videos: Sequence[SourceVideo], compared: Sequence[SourceVideo], practice: str | None
) -> None:
    conditions = sorted({video.condition for video in compared})
    for dataset in sorted({video.dataset for video in compared}):
        present = {video.condition for video in compared if video.dataset == dataset}
        if missing := [name for name in conditions if name not in present]:
            raise StimuliError(
                f"{folder / dataset}: has no video of {', '.join(missing)}, which other datasets have; every dataset "
                "needs every condition",
                by_command="but for one of two videos to practise with (`--practice DATASET`)",
                on_page="add what lacks, or leave the scene out",
            )
    n_practice = len(videos) - len(compared)
    if practice is not None and n_practice != 2:
        raise StimuliError(
            f"{folder / practice}: has {n_practice} video{'s' * (n_practice != 1)}; practice needs two, one of them "
            "clearly better"
        )


def _read_levels(path: Path, conditions: Sequence[str]) -> Levels:
    if not path.exists():
        return {condition: {} for condition in conditions}
    from app.analysis.reading.files.tabular import read_csv  # pandas loads slowly

    try:
        table = read_csv(path)
    except ValueError as error:
        raise StimuliError(str(error)) from error
    if "condition" not in table.names or len(table.names) < 2:
        raise StimuliError(
            f"{path}: has the columns {', '.join(table.names)}; expected condition and a column per factor"
        )
    texts = [column.texts for column in table.columns.values()]
    rows = [dict(zip(table.names, row, strict=True)) for row in zip(*texts, strict=True)]
    levels = {row.pop("condition"): {factor: level for factor, level in row.items() if level} for row in rows}
    if len(levels) != len(rows):
        raise StimuliError(f"{path}: a condition appears twice")
    if missing := [name for name in conditions if name not in levels]:
        raise StimuliError(f"{path}: has no row for {', '.join(missing)}")
    if unknown := [name for name in levels if name not in conditions]:
        raise StimuliError(f"{path}: names {', '.join(unknown)}, of which there is no video")
    return levels


def _looked_at(videos: Sequence[SourceVideo], said_range: str, progress: Progress) -> list[Film]:
    """Decode every video to its end, and say what must be done to it."""
    films: dict[SourceVideo, Film] = {}

    def look(video: SourceVideo) -> None:
        facts = decode(video.path)
        for other in filter(None, (video.master, video.mask)):
            if (others := decode(other)) != facts:
                raise StimuliError(f"{other}: has {others}, its film {video.path.name} has {facts}; expected the same")
        if facts.look is not None and facts.look.lacks_range:
            facts = replace(facts, look=replace(facts.look, said_range=said_range))
        films[video] = Film(video, facts, treatment_of(video.path, facts))

    in_parallel([(f"looking at {video.name}", partial(look, video)) for video in videos], progress)
    return [films[video] for video in videos]


def _alike(films: Sequence[Film], *, is_conformed: bool) -> list[Film]:
    """Return the films so that those of a dataset are alike; refuse them unless they may be made so."""
    datasets: dict[str, list[Film]] = {}
    for film in films:
        datasets.setdefault(film.video.dataset, []).append(film)
    targets = {name: common_target([film.treatment.facts for film in same]) for name, same in datasets.items()}
    return [_like(film, targets[film.video.dataset], is_conformed=is_conformed) for film in films]


def _like(film: Film, target: Target, *, is_conformed: bool) -> Film:
    facts = film.treatment.facts
    same_rate = abs(facts.fps - target.fps) <= FPS_TOLERANCE * target.fps
    if same_rate and (facts.width, facts.height, facts.n_frames) == (target.width, target.height, target.n_frames):
        return film
    try:
        treatment = conformed(film.treatment, target)  # tried first: nobody is sent to an option that cannot help
    except ValueError as error:
        raise StimuliError(f"{film.video.path}: {error}") from error
    if is_conformed:
        return replace(film, treatment=treatment)
    name, dataset = shlex.quote(film.video.path.name), film.video.dataset
    usual = f"{target.n_frames} frames at {target.fps:.6g}/s of {target.width}x{target.height}"
    raise StimuliError(
        f"{film.video.path}: {film.video.name} has {facts}, expected {usual}, which all films of {dataset} can have: "
        "films of a scene must be alike",
        by_command=f"`--conform` makes them so, or `ffmpeg -i {name} -vf "
        f"fps={target.fps:.6g},scale={target.width}:{target.height} -frames:v {target.n_frames} -crf 10 NEW.mp4`",
        on_page="tick “make films of a scene alike” and send them again",
    )


def _guessed(films: Sequence[Film]) -> list[str]:
    """Return a sentence for each way in which the colours of films are read, with the films' number."""
    ways = Counter(colours_told(film.facts) for film in films)
    number = {len(films): f"all {len(films)} films" if len(films) > 1 else "the film"}
    guessed = [(way, n) for way, n in ways.items() if "guessed" in way]
    return [f"{number.get(n, f'{n} of {len(films)} films')}: colours read as {way}" for way, n in guessed]


def _copy(films: Sequence[Film], out: Path, levels: Levels, progress: Progress) -> list[dict[str, Any]]:
    entries: dict[SourceVideo, dict[str, Any]] = {}

    def copy(film: Film) -> None:
        entries[film.video] = _copied(film, out, dict(levels.get(film.video.condition, {})))

    in_parallel([(f"importing {film.video.name}", partial(copy, film)) for film in films], progress)
    return [entries[film.video] for film in films]


def _copied(film: Film, out: Path, levels: dict[str, str]) -> dict[str, Any]:
    """Copy a video, its master and its mask, or make them right; return its entry in the manifest."""
    video, treatment = film.video, film.treatment
    (out / video.dataset).mkdir(exist_ok=True)
    candidates = {"video": video.path, "master": video.master, "mask": video.mask}
    sources = {key: path for key, path in candidates.items() if path is not None}
    suffixes = {key: SUFFIX if treatment.filters else path.suffix.lower() for key, path in sources.items()}
    files = {key: f"{video.dataset}/{path.stem}{suffixes[key]}" for key, path in sources.items()}
    facts = treatment.facts
    for key, path in sources.items():
        if not treatment.filters:
            shutil.copyfile(path, out / files[key])
        elif key == "video":
            facts = write_treated(path, treatment, out / files[key])
        else:
            write_treated(path, treatment, out / files[key], crf=LOSSLESS)
    quality = video.path.with_name(video.path.stem + QUALITY)
    assert film.facts.look is not None, "decode looks at every film"
    return {
        "dataset": video.dataset,
        "approach": video.condition,
        "levels": levels,
        **files,
        "sha256": file_digest(out / files["video"]),
        "width": facts.width,
        "height": facts.height,
        "fps": facts.fps,
        "n_frames": facts.n_frames,
        **({"quality": read_json(quality)} if quality.is_file() else {}),
        "found": film.facts.look.told(film.facts.width, film.facts.height),
        "done": list(treatment.done),
    }


def _copy_paths(folder: Path, out: Path, datasets: set[str]) -> dict[str, dict[str, str]]:
    """Copy the camera paths of the datasets, where `reconstudy render` wrote them; return them for the provenance."""
    paths = {}
    for dataset in sorted(datasets):
        file = f"{PATHS}/{dataset}.json"
        if (folder / file).is_file():
            (out / PATHS).mkdir(exist_ok=True)
            shutil.copyfile(folder / file, out / file)
            paths[dataset] = {"file": file, "sha256": file_digest(out / file)}
    return paths


def _provenance(folder: Path, paths: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    return {"imported_from": folder.resolve().name, **({"paths": paths} if paths else {})}


def _manifest(
    name: str, entries: Sequence[dict[str, Any]], levels: Levels, practice: str | None, provenance: Mapping[str, Any]
) -> dict[str, Any]:
    factors: dict[str, list[str]] = {}
    for by_factor in levels.values():
        for factor, level in by_factor.items():
            if level not in factors.setdefault(factor, []):
                factors[factor].append(level)
    return {
        SCHEMA_KEY: schema_name("manifest"),
        "schema_version": 1,
        "name": name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "stimuli": [entry for entry in entries if entry["dataset"] != practice],
        "factors": factors,
        "practice": [entry for entry in entries if entry["dataset"] == practice],
        "provenance": provenance,
    }

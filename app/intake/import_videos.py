"""Import a folder DATASET/CONDITION.mp4 of other people's videos as a stimulus set, with factors from
conditions.csv.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import StimuliError
from app.ffmpeg import Progress, decode, in_parallel, no_progress
from app.files import file_digest, whole_file, write_json
from app.intake.stimuli import MANIFEST, StimulusSet, read_stimulus_set

VIDEO_SUFFIXES = (".mp4", ".mkv", ".webm", ".mov", ".avi")
CONDITIONS = "conditions.csv"

Levels = Mapping[str, Mapping[str, str]]  # condition -> factor -> level


@dataclass(frozen=True)
class SourceVideo:
    """A video in the folder that is imported."""

    dataset: str
    condition: str
    path: Path


def import_stimuli(
    folder: Path, out: Path, *, practice: str | None = None, progress: Progress = no_progress
) -> StimulusSet:
    """Copy the videos of a folder into a stimulus set, and check it.

    Parameters
    ----------
    folder : holds a folder per dataset with a video per condition, named by the condition; beside them `conditions.csv`
        (condition, <factor>, …) where conditions have factors
    out : the stimulus set's folder, missing or empty
    practice : the dataset whose two videos are for practice, the clearly better one first in the alphabet
    progress : called after each video

    Raises
    ------
    StimuliError
        If there is nothing to import, datasets have different conditions, a video cannot be decoded or differs from the
        others of its dataset in size, frame rate or length, or the table of conditions does not fit. No file is left
        behind.
    """
    if out.exists() and any(out.iterdir()):
        raise StimuliError(f"{out}: is not empty; choose a new folder for the stimulus set")
    videos = _find(folder)
    compared = [video for video in videos if video.dataset != practice]
    _check_complete(folder, videos, compared, practice)
    levels = _read_levels(folder / CONDITIONS, sorted({video.condition for video in compared}))
    is_new = not out.exists()
    try:
        entries = _copy(videos, out, levels, progress)
        write_json(out / MANIFEST, _manifest(folder, entries, levels, practice))
        return read_stimulus_set(out)
    except BaseException:
        _remove(out, videos, is_new=is_new)
        raise


def _find(folder: Path) -> list[SourceVideo]:
    if not folder.is_dir():
        raise StimuliError(f"{folder}: is no folder; expected one with DATASET/CONDITION.mp4")
    videos = [
        SourceVideo(path.parent.name, path.stem, path)
        for path in sorted(folder.glob("*/*"))
        if path.suffix.lower() in VIDEO_SUFFIXES and not path.name.startswith(".")
    ]
    if not videos:
        kinds = ", ".join(VIDEO_SUFFIXES)
        raise StimuliError(f"{folder}: holds no video; expected a folder for each dataset with CONDITION.mp4 ({kinds})")
    names = [(video.dataset, video.condition) for video in videos]
    twice = [video for video, name in zip(videos, names, strict=True) if names.count(name) > 1]
    if twice:
        files = " and ".join(video.path.name for video in twice[:2])
        raise StimuliError(f"{twice[0].path.parent}: {files} are both the condition {twice[0].condition}; keep one")
    return videos


def _check_complete(
    folder: Path, videos: Sequence[SourceVideo], compared: Sequence[SourceVideo], practice: str | None
) -> None:
    conditions = sorted({video.condition for video in compared})
    for dataset in sorted({video.dataset for video in compared}):
        present = {video.condition for video in compared if video.dataset == dataset}
        if missing := [name for name in conditions if name not in present]:
            raise StimuliError(
                f"{folder / dataset}: has no video of {', '.join(missing)}, which other datasets have; every dataset "
                "needs every condition"
            )
    n_practice = len(videos) - len(compared)
    if practice is not None and n_practice != 2:
        raise StimuliError(
            f"{folder / practice}: has {n_practice} videos; practice needs two, one of them clearly better"
        )


def _read_levels(path: Path, conditions: Sequence[str]) -> Levels:
    if not path.exists():
        return {condition: {} for condition in conditions}
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        columns = [column.strip() for column in reader.fieldnames or ()]
        if columns[:1] != ["condition"] or len(columns) < 2:
            raise StimuliError(
                f"{path}: has the columns {', '.join(columns) or 'none'}; expected condition and a column per factor"
            )
        rows = [{column: (row.get(column) or "").strip() for column in columns} for row in reader]
    levels = {row["condition"]: {factor: row[factor] for factor in columns[1:]} for row in rows}
    if len(levels) != len(rows):
        raise StimuliError(f"{path}: a condition appears twice")
    if missing := [name for name in conditions if name not in levels]:
        raise StimuliError(f"{path}: has no row for {', '.join(missing)}")
    if unknown := [name for name in levels if name not in conditions]:
        raise StimuliError(f"{path}: names {', '.join(unknown)}, of which there is no video")
    for name, by_factor in levels.items():
        if empty := [factor for factor, level in by_factor.items() if not level]:
            raise StimuliError(f"{path}: {name} has no level of {', '.join(empty)}")
    return levels


def _copy(videos: Sequence[SourceVideo], out: Path, levels: Levels, progress: Progress) -> list[dict[str, Any]]:
    entries: dict[SourceVideo, dict[str, Any]] = {}

    def copy(video: SourceVideo) -> None:
        facts = decode(video.path)
        target = _target(video)
        with whole_file(out / target) as temporary:
            shutil.copyfile(video.path, temporary)
        entries[video] = {
            "dataset": video.dataset,
            "approach": video.condition,
            "levels": dict(levels.get(video.condition, {})),
            "video": target.as_posix(),
            "sha256": file_digest(out / target),
            "width": facts.width,
            "height": facts.height,
            "fps": facts.fps,
            "n_frames": facts.n_frames,
        }

    in_parallel([(f"importing {_target(video)}", partial(copy, video)) for video in videos], progress)
    return [entries[video] for video in videos]


def _target(video: SourceVideo) -> Path:
    return Path(video.dataset) / f"{video.condition}{video.path.suffix.lower()}"


def _manifest(folder: Path, entries: Sequence[dict[str, Any]], levels: Levels, practice: str | None) -> dict[str, Any]:
    factors: dict[str, list[str]] = {}
    for by_factor in levels.values():
        for factor, level in by_factor.items():
            if level not in factors.setdefault(factor, []):
                factors[factor].append(level)
    return {
        "schema_version": 1,
        "name": folder.resolve().name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "stimuli": [entry for entry in entries if entry["dataset"] != practice],
        "factors": factors,
        "practice": [entry for entry in entries if entry["dataset"] == practice],
        "provenance": {"imported_from": folder.resolve().name},
    }


def _remove(out: Path, videos: Sequence[SourceVideo], *, is_new: bool) -> None:
    """Remove what was written."""
    (out / MANIFEST).unlink(missing_ok=True)
    for video in videos:
        (out / _target(video)).unlink(missing_ok=True)
    folders = [out / dataset for dataset in {video.dataset for video in videos}] + ([out] if is_new else [])
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()

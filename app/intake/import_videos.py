"""Somebody else's videos as a stimulus set: a folder DATASET/CONDITION.mp4, with the conditions' factors in a table."""

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
class Found:
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
    folder : a folder for each dataset with a video for each condition, whose name is the condition; beside them
        `conditions.csv` (condition, <factor>, …) where conditions have factors
    out : the stimulus set's folder, which must not be there, or be empty
    practice : the dataset whose two videos are for practice; by the alphabet the clearly better one first
    progress : told after each video

    Raises
    ------
    StimuliError
        If there is nothing to import, datasets have different conditions, a video cannot be decoded or differs from the
        others of its dataset in size, frame rate or length, or the table of conditions does not fit; nothing is left.
    """
    if out.exists() and any(out.iterdir()):
        raise StimuliError(f"{out}: is not empty; choose a new folder for the stimulus set")
    videos = _find(folder)
    compared = [one for one in videos if one.dataset != practice]
    _check_complete(folder, videos, compared, practice)
    levels = _read_levels(folder / CONDITIONS, sorted({one.condition for one in compared}))
    is_new = not out.exists()
    try:
        entries = _copy(videos, out, levels, progress)
        write_json(out / MANIFEST, _manifest(folder, entries, levels, practice))
        return read_stimulus_set(out)
    except BaseException:
        _remove(out, videos, is_new=is_new)
        raise


def _find(folder: Path) -> list[Found]:
    if not folder.is_dir():
        raise StimuliError(f"{folder}: is no folder; expected one with DATASET/CONDITION.mp4")
    found = [
        Found(path.parent.name, path.stem, path)
        for path in sorted(folder.glob("*/*"))
        if path.suffix.lower() in VIDEO_SUFFIXES and not path.name.startswith(".")
    ]
    if not found:
        kinds = ", ".join(VIDEO_SUFFIXES)
        raise StimuliError(f"{folder}: holds no video; expected a folder for each dataset with CONDITION.mp4 ({kinds})")
    names = [(one.dataset, one.condition) for one in found]
    twice = [one for one in found if names.count((one.dataset, one.condition)) > 1]
    if twice:
        files = " and ".join(one.path.name for one in twice[:2])
        raise StimuliError(f"{twice[0].path.parent}: {files} are both the condition {twice[0].condition}; keep one")
    return found


def _check_complete(folder: Path, videos: Sequence[Found], compared: Sequence[Found], practice: str | None) -> None:
    conditions = sorted({one.condition for one in compared})
    for dataset in sorted({one.dataset for one in compared}):
        own = {one.condition for one in compared if one.dataset == dataset}
        if missing := [name for name in conditions if name not in own]:
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
    for name, own in levels.items():
        if empty := [factor for factor, level in own.items() if not level]:
            raise StimuliError(f"{path}: {name} has no level of {', '.join(empty)}")
    return levels


def _copy(videos: Sequence[Found], out: Path, levels: Levels, progress: Progress) -> list[dict[str, Any]]:
    entries: dict[Found, dict[str, Any]] = {}

    def copy(one: Found) -> None:
        facts = decode(one.path)
        target = _target(one)
        with whole_file(out / target) as temporary:
            shutil.copyfile(one.path, temporary)
        entries[one] = {
            "dataset": one.dataset,
            "approach": one.condition,
            "levels": dict(levels.get(one.condition, {})),
            "video": target.as_posix(),
            "sha256": file_digest(out / target),
            "width": facts.width,
            "height": facts.height,
            "fps": facts.fps,
            "n_frames": facts.n_frames,
        }

    in_parallel([(f"importing {_target(one)}", partial(copy, one)) for one in videos], progress)
    return [entries[one] for one in videos]


def _target(one: Found) -> Path:
    return Path(one.dataset) / f"{one.condition}{one.path.suffix.lower()}"


def _manifest(folder: Path, entries: Sequence[dict[str, Any]], levels: Levels, practice: str | None) -> dict[str, Any]:
    factors: dict[str, list[str]] = {}
    for own in levels.values():
        for factor, level in own.items():
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


def _remove(out: Path, videos: Sequence[Found], *, is_new: bool) -> None:
    """Take back what was written."""
    (out / MANIFEST).unlink(missing_ok=True)
    for one in videos:
        (out / _target(one)).unlink(missing_ok=True)
    folders = [out / dataset for dataset in {one.dataset for one in videos}] + ([out] if is_new else [])
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()

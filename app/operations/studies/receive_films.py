"""Take in what somebody uploads to compare: a stimulus set, or plain films, of which a set is made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from app.errors import StimuliError
from app.ffmpeg import VIDEO_SUFFIXES, Progress
from app.files import read_json
from app.intake.bounds import in_bounds
from app.intake.import_videos import import_stimuli
from app.intake.stimuli import MANIFEST, StimulusSet, check_videos, read_manifest
from app.intake.zips import MB, unpack
from app.operations.studies.create import slugify
from app.settings import Settings

BELONGING = (*VIDEO_SUFFIXES, ".json", ".csv", ".txt", ".md")  # suffixes of files of a stimulus set, or of films
UNNAMED = "Films"


def install_set(
    server: Settings,
    packed: Path,
    unpacked: Path,
    progress: Progress,
    *,
    name: str = "",
    is_conformed: bool = False,
) -> str:
    """Unpack an upload, make a set of it where it is none, check it, move it to its place, and return its name.

    Parameters
    ----------
    packed : a zip file of a set's folder, or of DATASET/CONDITION.mp4
    unpacked : folder that is made for its content
    name : of a set that is made of plain films; empty: that of the folder in the zip file
    is_conformed : make films of a dataset alike that differ in size, frame rate or length

    Raises
    ------
    ValueError, TooLargeError
        If it is neither, its films cannot be shown, or its name is taken; without the server's paths.
    """
    folder = in_bounds(_unpacked, packed, unpacked, server.largest_upload_mb * MB)
    try:
        if _has_manifest(folder):
            stimulus_set = in_bounds(read_manifest, folder, are_compared=True)
            check_videos(stimulus_set, progress)
        else:
            stimulus_set = _made(folder, unpacked, name, progress, is_conformed=is_conformed)
    except StimuliError as error:
        raise StimuliError(str(error).replace(f"{folder}/", "").replace(str(folder), "the upload")) from error
    slug = slugify(stimulus_set.name)
    if (server.sets_dir / slug).exists():
        raise StimuliError(f"there are films called {slug!r} already; give these another name, then upload them again")
    stimulus_set.folder.rename(server.sets_dir / slug)
    return slug


def found_and_done(stimulus_set: StimulusSet) -> dict[str, dict[str, Any]]:
    """Return what the import found in each film and did to it, by its name; sets of earlier versions do not say."""
    manifest = read_json(stimulus_set.folder / MANIFEST)
    entries = [*manifest.get("stimuli", ()), *manifest.get("practice", ())]
    return {
        f"{entry.get('dataset')}/{entry.get('approach')}": {
            "found": entry.get("found") or {},
            "done": entry.get("done") or [],
        }
        for entry in entries
        if isinstance(entry, dict)
    }


def _unpacked(packed: Path, unpacked: Path, limit: int) -> Path:
    """Unpack an upload; return the folder that holds the manifest, or the datasets."""
    unpack(packed, unpacked, limit, BELONGING, "films to compare")
    inside = list(unpacked.iterdir())
    if len(inside) != 1 or not inside[0].is_dir():
        return unpacked
    only = inside[0]  # a zip file may hold one folder
    return only if _has_manifest(only) or any(path.is_dir() for path in only.iterdir()) else unpacked


def _has_manifest(folder: Path) -> bool:
    return (folder / MANIFEST).is_file()


def _made(folder: Path, unpacked: Path, name: str, progress: Progress, *, is_conformed: bool) -> StimulusSet:
    """Make a set of plain films."""
    flat = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in VIDEO_SUFFIXES)
    if flat:
        raise StimuliError(
            f"{flat[0]} lies in no folder; expected a folder for each scene with a film for each condition, such as "
            "street/method-a.mp4 and street/method-b.mp4: put the films into folders, then pack them again"
        )
    title = name.strip() or (folder.name if folder != unpacked else UNNAMED)
    out = unpacked.with_name("made") / slugify(title)
    made = import_stimuli(folder, out, is_conformed=is_conformed, name=title, progress=progress).stimulus_set
    if alone := [dataset for dataset in made.datasets if len(made.of_dataset(dataset)) < 2]:
        raise StimuliError(f"{alone[0]} has one film, expected two or more to compare; add the others to its folder")
    return made

"""The stimulus set's manifest: how the study server learns what was made here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ground.file_models import SCHEMA_KEY, schema_name
from recon.runtime.artefacts import file_digest
from recon.runtime.files import write_json
from recon.runtime.remote import fetched, stored

SCHEMA_VERSION = 1
MANIFEST = "manifest.json"


@dataclass(frozen=True)
class Stimulus:
    """The video of a scene by an approach.

    Parameters
    ----------
    dataset, approach, levels : the scene, and the approach with its level of each factor
    video, master : paths from the manifest
    width, height, fps, n_frames, codec, renderer : of the video
    model_frames, loop : how many models it shows, and how they fill its length
    quality : how near the encoded frames are to the rendered ones
    model_bytes : size of a model's files, the mean where it shows several; None where it is not known
    mask : path from the manifest of a video of the model's silhouette, white on black
    """

    dataset: str
    approach: str
    levels: dict[str, str]
    video: str
    master: str | None
    width: int
    height: int
    fps: float
    n_frames: int
    codec: str
    renderer: str
    model_frames: int
    loop: str
    quality: dict[str, Any]
    mask: str | None = None
    model_bytes: int | None = None


def write_manifest(
    folder: Path, name: str, stimuli: Sequence[Stimulus], provenance: dict[str, Any], *, practice: str = ""
) -> Path:
    """Write ``manifest.json`` with the digest of every video.

    Parameters
    ----------
    folder, name : of the stimulus set
    stimuli : its videos
    provenance : which runs, options and versions they come from
    practice : the dataset whose videos are for practice only; empty: none

    Raises
    ------
    ValueError
        If there is no stimulus, or two are of the same dataset and approach.
    """
    keys = [(stimulus.dataset, stimulus.approach) for stimulus in stimuli]
    if not keys:
        raise ValueError(f"{folder}: a stimulus set needs at least one video, found none")
    if len(set(keys)) != len(keys):
        twice = sorted({key for key in keys if keys.count(key) > 1})
        raise ValueError(f"{folder}: more than one video for {twice}; give every capture a name of its own")
    compared = [stimulus for stimulus in stimuli if stimulus.dataset != practice]
    path = folder / MANIFEST
    write_json(
        path,
        {
            SCHEMA_KEY: schema_name("manifest"),
            "schema_version": SCHEMA_VERSION,
            "name": name,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "stimuli": [_entry(folder, stimulus) for stimulus in compared],
            "factors": _factors(compared),
            "practice": [_entry(folder, stimulus) for stimulus in stimuli if stimulus.dataset == practice],
            "provenance": provenance,
        },
    )
    return stored(path)


def _entry(folder: Path, stimulus: Stimulus) -> dict[str, Any]:
    fields = {name: value for name, value in vars(stimulus).items() if value is not None}
    return {**fields, "sha256": file_digest(fetched(folder / stimulus.video))}


def _factors(stimuli: Sequence[Stimulus]) -> dict[str, list[str]]:
    factors: dict[str, list[str]] = {}
    for stimulus in stimuli:
        for factor, level in stimulus.levels.items():
            levels = factors.setdefault(factor, [])
            if level not in levels:
                levels.append(level)
    return factors

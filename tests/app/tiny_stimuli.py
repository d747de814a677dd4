"""Stimulus sets of tiny videos."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from app.ffmpeg import decode

WIDTH, HEIGHT, FPS, N_FRAMES = 64, 48, 25, 10
APPROACHES = ("id_fa", "id_fb", "pm_fb")
TITLE = "secret-title"  # in the sources' metadata, where it must stay


def encode(path: Path, source: str, *options: str) -> None:
    """Encode what ffmpeg's lavfi makes of `source`; the same again is a copy."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_encoded(source, options, path.suffix))


@cache
def _encoded(source: str, options: tuple[str, ...], suffix: str) -> bytes:
    command = ["-v", "error", "-y", "-f", "lavfi", "-i", source, "-frames:v", str(N_FRAMES)]
    tags = ["-metadata", f"title={TITLE}", "-pix_fmt", "yuv420p", "-qp", "0"]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"video{suffix}"
        subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), *command, *tags, *options, str(path)], check=True)
        return path.read_bytes()


def flat(colour: str) -> str:
    return f"color={colour}:size={WIDTH}x{HEIGHT}:rate={FPS}"


def write_set(folder: Path, datasets: Iterable[str], approaches: Iterable[str]) -> Path:
    """Write videos of one grey level each, and their manifest."""
    stimuli = []
    for row, dataset in enumerate(datasets):
        for column, approach in enumerate(approaches):
            video = folder / dataset / f"{approach}.mp4"
            level = 0x20 + 0x30 * column + 0x08 * row
            encode(video, flat(f"0x{level:02x}{level:02x}{level:02x}"))
            stimuli.append(stimulus(folder, dataset, approach))
    return write_manifest(folder, stimuli)


def stimulus(folder: Path, dataset: str, approach: str) -> dict[str, Any]:
    """A manifest's entry for `DATASET/APPROACH.mp4`."""
    depth, fusion = approach.split("_")[:2]
    return {
        "dataset": dataset,
        "approach": approach,
        "levels": {"depth": depth, "fusion": fusion},
        "video": f"{dataset}/{approach}.mp4",
        "sha256": hashlib.sha256((folder / dataset / f"{approach}.mp4").read_bytes()).hexdigest(),
        "width": WIDTH,
        "height": HEIGHT,
        "fps": float(FPS),
        "n_frames": N_FRAMES,
        "codec": "h264",
        "renderer": "lavfi",
    }


def write_manifest(folder: Path, stimuli: list[dict[str, Any]], **changes: Any) -> Path:
    content = {
        "schema_version": 1,
        "name": "tiny",
        "created": "2026-03-01T12:00:00+00:00",
        "stimuli": stimuli,
        "factors": {"depth": ["id", "pm"], "fusion": ["fa", "fb"]},
        "practice": [],
        "provenance": {},
    }
    path = folder / "manifest.json"
    path.write_text(json.dumps(content | changes), encoding="utf-8")
    return path


def frames(path: Path) -> NDArray[np.uint8]:
    """All frames of a video, decoded to grey: (n, H, W)."""
    facts = decode(path)
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    raw = subprocess.run([*command, "-pix_fmt", "gray", "-f", "rawvideo", "-"], capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(facts.n_frames, facts.height, facts.width)

"""Small films for tests: a textured disc that crosses a soft background, and copies of it that are worse."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.video import MASTER, SILHOUETTE, write_video

SIZE = (192, 176)  # (width, height), pixels: the smallest height with all scales of MS-SSIM
N_FRAMES = 6
RADIUS_PX = 45

Frames = list[NDArray[np.uint8]]


def disc(n_frames: int = N_FRAMES, *, step_px: float = 4.0) -> tuple[Frames, list[NDArray[np.bool_]]]:
    """Draw the frames, uint8 (H, W) grey, and where the disc is in each, bool (H, W); it moves by `step_px` a frame."""
    width, height = SIZE
    rows, columns = np.mgrid[0:height, 0:width]
    frames, masks = [], []
    for frame in range(n_frames):
        middle = width / 2 - 10 + step_px * frame
        inside = np.hypot(rows - height / 2, columns - middle) < RADIUS_PX
        texture = 120 + 50 * np.sin((columns - middle) / 2.5) * np.cos(rows / 3.5)
        frames.append(np.where(inside, texture, 150 + rows / 8).astype(np.uint8))
        masks.append(inside)
    return frames, masks


def noisy(frames: Sequence[NDArray[np.uint8]], sigma: float) -> Frames:
    """Add noise of a standard deviation in grey levels, other in each frame."""
    rng = np.random.default_rng(1)
    return [np.clip(np.rint(f + rng.normal(0, sigma, f.shape)), 0, 255).astype(np.uint8) for f in frames]


def blurred(frames: Sequence[NDArray[np.uint8]], sigma: float) -> Frames:
    """Blur by a standard deviation in pixels."""
    return [np.asarray(cv2.GaussianBlur(f, (0, 0), sigma), np.uint8) for f in frames]


def write_film(path: Path, frames: Sequence[NDArray[np.uint8]], fps: float = 25.0) -> Path:
    """Write grey frames uint8 (H, W) as a video of high quality."""
    size = (frames[0].shape[1], frames[0].shape[0])
    write_video(path, (np.repeat(f[..., None], 3, axis=2) for f in frames), size=size, fps=fps, encoding=MASTER)
    return path


def write_mask(path: Path, masks: Sequence[NDArray[np.bool_]]) -> Path:
    """Write masks bool (H, W) as a set has them."""
    size = (masks[0].shape[1], masks[0].shape[0])
    pictures = (np.repeat(255 * mask[..., None].astype(np.uint8), 3, axis=2) for mask in masks)
    write_video(path, pictures, size=size, fps=25.0, encoding=SILHOUETTE)
    return path


def write_set(folder: Path, films: Mapping[str, Frames], masks: Sequence[NDArray[np.bool_]] | None = None) -> Path:
    """Write a stimulus set of films by "dataset/approach", all with the same masks if there are some."""
    stimuli = []
    for name, frames in films.items():
        dataset, approach = name.split("/")
        entry = {"dataset": dataset, "approach": approach, "video": f"{name}.mp4"}
        write_film(folder / f"{name}.mp4", frames)
        if masks is not None:
            write_mask(folder / f"{name}.mask.mp4", masks)
            entry["mask"] = f"{name}.mask.mp4"
        stimuli.append(entry)
    (folder / "manifest.json").write_text(json.dumps({"schema_version": 1, "stimuli": stimuli}))
    return folder

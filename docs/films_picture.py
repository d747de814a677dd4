"""The picture and the table of films in docs/measures.md: `python docs/films_picture.py SET DATASET APPROACH`.

A film of a stimulus set is distorted in known ways, and each copy is measured against it as `reconstudy validate films`
does. The table is printed.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray
from pictures import keep

from recon.render.encoding.quality import MARGIN
from recon.render.encoding.video import MASTER, read_luma, read_video, write_video
from recon.validation.films.evaluation import FilmSettings, measure_films
from recon.validation.films.flicker import excess_change
from recon.validation.films.likeness import similarity_map

Picture = NDArray[np.uint8]

SHOWN = 40  # the frame in the picture
NOISE = 6  # grey levels
SHIFT_PX, DELAY, LIGHTER, BLUR_PX = 2, 2, 8, 1.5
MOST_FLICKER = 12  # grey levels that are black in the picture
COLUMNS = ("psnr_y", "ssim", "ms_ssim", "vmaf", "psnr_y_actor", "ssim_actor", "ms_ssim_actor", "flicker")


def distortions(frames: list[Picture]) -> dict[str, Callable[[int], Picture]]:
    """What a copy shows at each frame."""
    rng = np.random.default_rng(1)
    height, width = frames[0].shape[:2]
    still = rng.normal(0, NOISE, (height, width, 1))
    return {
        "8 grey levels lighter": lambda t: clipped(frames[t] + float(LIGHTER)),
        "noise of 6 grey levels": lambda t: clipped(frames[t] + rng.normal(0, NOISE, (height, width, 1))),
        "the same noise throughout": lambda t: clipped(frames[t] + still),
        "blur of 1.5 pixels": lambda t: np.asarray(cv2.GaussianBlur(frames[t], (0, 0), BLUR_PX), np.uint8),
        "2 pixels to the right": lambda t: np.roll(frames[t], SHIFT_PX, axis=1),
        "2 frames late": lambda t: frames[max(0, t - DELAY)],
    }


def clipped(picture: NDArray[np.floating]) -> Picture:
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def main(stimuli: Path, dataset: str, approach: str) -> None:
    """Distort, measure, print the table and write the picture."""
    entries = json.loads((stimuli / "manifest.json").read_text())["stimuli"]
    entry = next(e for e in entries if (e["dataset"], e["approach"]) == (dataset, approach))
    frames = list(read_video(stimuli / entry["video"]))
    mask = next(islice(read_luma(stimuli / entry["mask"]), SHOWN, None)) > 126
    with TemporaryDirectory() as folder:
        made = Path(folder)
        copies = {"reference": lambda t: frames[t]} | distortions(frames)
        listed = [write_copy(made, name, list(map(copy, range(len(frames))))) for name, copy in copies.items()]
        for copy in listed:
            shutil.copy(stimuli / entry["mask"], made / copy["mask"])
        (made / "manifest.json").write_text(json.dumps({"stimuli": listed}))
        report, _ = measure_films(made, FilmSettings("reference"))
        tiles = [drawn(made, copy["approach"], mask) for copy in listed[1:]]
    keep("films", np.concatenate(tiles, axis=1))
    means = {(row["approach"], row["measure"]): row["mean"] for row in report["films"]}
    for copy in listed[1:]:
        print(
            f"| {copy['approach']} | " + " | ".join(f"{means[copy['approach'], name]:.4g}" for name in COLUMNS) + " |"
        )


def write_copy(folder: Path, name: str, frames: list[Picture]) -> dict[str, str]:
    """Write a copy of the film; returns its entry in the manifest."""
    size = (frames[0].shape[1], frames[0].shape[0])
    write_video(folder / f"{name}.mp4", frames, size=size, fps=25.0, encoding=MASTER)
    return {"dataset": "copies", "approach": name, "video": f"{name}.mp4", "mask": f"{name}.mask.mp4"}


def drawn(folder: Path, name: str, mask: NDArray[np.bool_]) -> Picture:
    """Draw a copy above its maps of SSIM and of flicker, around the actor."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    window = np.s_[max(rows[0] - 12, 0) : rows[-1] + 12, max(columns[0] - 12, 0) : columns[-1] + 12]
    (before, image), (reference_before, reference) = (
        list(islice(read_luma(folder / f"{film}.mp4"), SHOWN - 1, SHOWN + 1)) for film in (name, "reference")
    )
    likeness = np.pad(similarity_map(image, reference), MARGIN, constant_values=1)
    excess = excess_change((before, reference_before), (image, reference))
    maps = (image, 255 * np.clip(likeness, 0, 1), 255 * (1 - np.clip(excess / MOST_FLICKER, 0, 1)))
    column = np.concatenate([np.pad(part[window], 4, constant_values=255) for part in maps]).astype(np.uint8)
    column = np.pad(column, ((24, 0), (0, max(0, 200 - column.shape[1]))), constant_values=255)
    cv2.putText(column, name, (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 0, 1, cv2.LINE_AA)
    return np.repeat(column[..., None], 3, axis=2)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], sys.argv[3])

"""Tiny films in which every frame says which condition and which frame it is, and a stimulus set of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

CONDITIONS = ("heron", "otter", "zebra")  # words that no page has for another reason
DATASET = "lagoon"
WIDTH, HEIGHT = 320, 180
N_CONDITION_BITS, N_FRAME_BITS = 2, 6
N_SQUARES = N_CONDITION_BITS + N_FRAME_BITS
DARK, LIGHT = 40, 216

Draw = Callable[[int, int], NDArray[np.uint8]]  # the picture of a condition and a frame


def write_films(
    folder: Path,
    fps: float,
    n_frames: int,
    draw: Draw,
    *,
    datasets: Sequence[str] = (DATASET,),
    conditions: Sequence[str] = CONDITIONS,
) -> Path:
    """A stimulus set; the same films in every dataset."""
    films = [_film(folder, name, index, fps, n_frames, draw) for index, name in enumerate(conditions)]
    stimuli = [{"dataset": dataset, **film} for dataset in datasets for film in films]
    manifest = {"schema_version": 1, "name": "squares", "created": "", "stimuli": stimuli, "factors": {}}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def squares(condition: int, frame: int) -> NDArray[np.uint8]:
    """A picture that says which it is.

    Returns
    -------
    uint8 (HEIGHT, WIDTH), a row of squares, the highest bit first
    """
    code = condition << N_FRAME_BITS | frame
    bits = np.array([code >> bit & 1 for bit in reversed(range(N_SQUARES))], dtype=bool)
    picture = np.full((HEIGHT, WIDTH), 128, np.uint8)
    row = np.where(bits, LIGHT, DARK).astype(np.uint8).repeat(WIDTH // N_SQUARES)
    picture[HEIGHT // 3 : 2 * HEIGHT // 3] = row
    return picture


def decode_squares(screen: NDArray[np.uint8]) -> tuple[str, int]:
    """What `squares` wrote, from a picture of any size that it fills."""
    height, width = screen.shape
    columns = ((np.arange(N_SQUARES) + 0.5) * width / N_SQUARES).astype(int)
    levels = screen[height // 2, columns].astype(int)
    assert np.all(np.minimum(abs(levels - DARK), abs(levels - LIGHT)) < 40), f"no squares on the screen: {levels}"
    code = int("".join("1" if level > 128 else "0" for level in levels), 2)
    return CONDITIONS[code >> N_FRAME_BITS], code & ((1 << N_FRAME_BITS) - 1)


def _film(folder: Path, name: str, index: int, fps: float, n_frames: int, draw: Draw) -> dict[str, Any]:
    content = _encoded(index, fps, n_frames, draw)
    (folder / f"{name}.mp4").write_bytes(content)
    return {
        "approach": name,
        "video": f"{name}.mp4",
        "sha256": hashlib.sha256(content).hexdigest(),
        "width": WIDTH,
        "height": HEIGHT,
        "fps": fps,
        "n_frames": n_frames,
    }


@cache
def _encoded(index: int, fps: float, n_frames: int, draw: Draw) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path), (WIDTH, HEIGHT), pix_fmt_in="gray", fps=fps, codec="libx264", quality=None, macro_block_size=2,
            output_params=["-crf", "12", "-preset", "ultrafast"],
        )  # fmt: skip
        writer.send(None)
        for frame in range(n_frames):
            writer.send(draw(index, frame))
        writer.close()
        return path.read_bytes()

"""Films whose every frame holds its condition and number as bars, and what pictures of the screen show of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from app.files import file_digest

SIZE, FPS, SECONDS = (1920, 1080), 25, 15
N_FRAMES = FPS * SECONDS
FRAME_BITS = 9
N_BARS = FRAME_BITS + 2  # an even parity bar and the condition before the frame's number
DARK, LIGHT, TOLERANCE = 40, 216, 45


@dataclass(frozen=True)
class Reading:
    """What one strip of a picture shows."""

    condition: int
    frame: int


def bars(condition: int, frame: int) -> NDArray[np.uint8]:
    """A picture of vertical bars, uint8 (H, W)."""
    code = condition << FRAME_BITS | frame
    code |= (code.bit_count() % 2) << (FRAME_BITS + 1)
    bits = np.array([code >> bit & 1 for bit in reversed(range(N_BARS))], dtype=bool)
    columns = np.arange(SIZE[0]) * N_BARS // SIZE[0]
    return np.broadcast_to(np.where(bits[columns], LIGHT, DARK).astype(np.uint8), SIZE[::-1])


def read_bars(row: NDArray[np.uint8]) -> Reading | None:
    """What `bars` wrote, from a row of pixels; None where there are no such bars."""
    centres = ((np.arange(N_BARS) + 0.5) * len(row) / N_BARS).astype(int)
    levels = row[centres].astype(int)
    if np.any(np.minimum(abs(levels - DARK), abs(levels - LIGHT)) > TOLERANCE):
        return None
    code = int("".join("1" if level > 128 else "0" for level in levels), 2)
    if code.bit_count() % 2:
        return None
    return Reading(code >> FRAME_BITS & 1, code & ((1 << FRAME_BITS) - 1))


def write_films(folder: Path) -> Path:
    """A stimulus set of two conditions, unless it is there."""
    if (folder / "manifest.json").is_file():
        return folder
    stimuli = []
    for condition, name in enumerate(("one", "other")):
        path = folder / f"{name}.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path), SIZE, pix_fmt_in="gray", fps=FPS, codec="libx264", quality=None, macro_block_size=2,
            output_params=["-crf", "12", "-preset", "ultrafast"],
        )  # fmt: skip
        writer.send(None)
        for frame in range(N_FRAMES):
            writer.send(np.ascontiguousarray(bars(condition, frame)))
        writer.close()
        facts = {"width": SIZE[0], "height": SIZE[1], "fps": float(FPS), "n_frames": N_FRAMES}
        stimuli.append({"dataset": "bars", "approach": name, "video": path.name, "sha256": file_digest(path), **facts})
    content = {"schema_version": 1, "name": "bars", "stimuli": stimuli}
    (folder / "manifest.json").write_text(json.dumps(content))
    return folder


def goes_back(before: int, after: int) -> bool:
    """Whether a film went back, other than to its beginning."""
    is_new_pass = before > 0.9 * N_FRAMES and after < 0.1 * N_FRAMES
    return after < before and not is_new_pass


def latencies(pictures: Sequence[tuple[float, Reading | None]], presses: Sequence[float]) -> NDArray[np.float64]:
    """From each press to the swap of the first picture of the other condition, ms; NaN where none came in time."""
    delays = []
    for number, pressed in enumerate(presses):
        until = presses[number + 1] if number + 1 < len(presses) else np.inf
        before = [reading.condition for at, reading in pictures if at < pressed and reading][-1:]
        changed = [
            at for at, reading in pictures if pressed <= at < until and reading and [reading.condition] != before
        ]
        delays.append(changed[0] - pressed if changed and before else np.nan)
    return np.array(delays)


def both_strips(picture: NDArray[np.uint8]) -> tuple[Reading | None, Reading | None]:
    """What is in the film's window, and what lies above or below it."""
    at = [read_bars(picture[int(share * len(picture))]) for share in (0.05, 0.5, 0.95)]
    return at[1], at[0] or at[2]


def difference(pairs: Sequence[tuple[Reading | None, Reading | None]]) -> dict[str, Any]:
    """In how many pictures the two strips show different frames."""
    read = [(one, other) for one, other in pairs if one and other and one.condition != other.condition]
    differing = sum(one.frame != other.frame for one, other in read)
    return {
        "pictures": len(pairs),
        "unreadable": len(pairs) - len(read),
        "differing": differing,
        "differing_percent": round(100 * differing / max(1, len(read)), 2),
    }

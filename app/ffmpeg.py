"""Run ffmpeg, as imageio-ffmpeg ships it."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import mode

import imageio_ffmpeg

from app.errors import StimuliError

Progress = Callable[[str, int, int], None]  # what is being done, how many are done, how many there are
WORKERS = 2  # processes at once, each on one thread, so that files are reproducible


def no_progress(*_told: str | int) -> None:
    """Ignore progress."""


@dataclass(frozen=True)
class VideoFacts:
    """Facts about a video, measured by decoding it."""

    width: int
    height: int
    fps: float
    n_frames: int


def decode(path: Path) -> VideoFacts:
    """Decode a whole video and return its facts.

    Raises
    ------
    StimuliError
        If there is no such file, it does not decode from beginning to end, or its frames are not equally far apart.
    """
    if not path.is_file():
        raise StimuliError(f"{path}: there is no such file")
    command = ["-xerror", "-i", str(path), "-map", "0:v:0", "-fps_mode", "passthrough", "-f", "framecrc", "-"]
    text = run_ffmpeg(command, f"{path}: cannot be decoded as a video")
    size = re.search(r"^#dimensions 0: (\d+)x(\d+)$", text, re.MULTILINE)
    base = re.search(r"^#tb 0: (\d+)/(\d+)$", text, re.MULTILINE)
    times = [int(line.split(",")[2]) for line in text.splitlines() if line and not line.startswith("#")]
    if not size or not base or not times:
        raise StimuliError(f"{path}: holds no picture")
    steps = [later - earlier for earlier, later in pairwise(times)] or [1]
    ticks_per_s = int(base[2]) / int(base[1])
    fps = ticks_per_s / max(mode(steps), 1)
    if len(set(steps)) > 1:
        shortest, longest = (1000 * step / ticks_per_s for step in (min(steps), max(steps)))
        raise StimuliError(
            f"{path}: its frames are {shortest:.4g} to {longest:.4g} ms apart, expected one constant frame rate; "
            f"encode it again, for example by `ffmpeg -i {shlex.quote(path.name)} -r {fps:.4g} -crf 10 NEW.mp4`"
        )
    return VideoFacts(int(size[1]), int(size[2]), fps, len(times))


def run_ffmpeg(arguments: Iterable[str], complaint: str) -> str:
    """Run ffmpeg and return its output; `complaint` begins the message of a failure."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-nostdin", *arguments]
    quiet = {**os.environ, "SVT_LOG": "1"}  # the AV1 encoder prints errors only
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False, env=quiet)
    if done.returncode != 0 or done.stderr.strip():
        reason = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[0]
        raise StimuliError(f"{complaint}: {reason}")
    return done.stdout


def in_parallel(jobs: Sequence[tuple[str, Callable[[], None]]], progress: Progress) -> None:
    """Run jobs in parallel, each waiting for a process; the first error cancels those that have not begun."""
    progress("", 0, len(jobs))
    with ThreadPoolExecutor(WORKERS) as pool:
        names = {pool.submit(job): name for name, job in jobs}
        try:
            for done, future in enumerate(as_completed(names), start=1):
                future.result()
                progress(names[future], done, len(jobs))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise

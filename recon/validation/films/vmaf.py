"""VMAF of a film, by the filter libvmaf of ffmpeg with the model that is built into it."""

from __future__ import annotations

import re
import tempfile
from functools import cache
from pathlib import Path

from recon.render.encoding.video import FILE_ALONE, STRICT, STUDIO_RANGE, run_ffmpeg
from recon.runtime.files import read_json

MODEL = "vmaf_v0.6.1"  # Netflix's default: a screen of full HD at three times its height


@cache
def has_vmaf() -> bool:
    """Return whether the ffmpeg that is used has the filter libvmaf."""
    filters = run_ffmpeg(("-hide_banner", "-filters"), "ffmpeg's filters cannot be listed").decode("utf-8", "replace")
    return re.search(r"^\s*\S+\s+libvmaf\s", filters, re.MULTILINE) is not None


def vmaf_scores(film: Path, reference: Path, *, every: int = 1, threads: int = 1) -> list[float]:
    """Compute VMAF of every `every`-th frame, from the first on, 0 to 100.

    Parameters
    ----------
    film, reference : videos of the same size and number of frames
    every : measure only each such frame; the change between frames is still taken from its neighbours
    threads : of libvmaf; the scores do not depend on it

    Raises
    ------
    VideoError
        If ffmpeg cannot read a film, or has no libvmaf.

    Source
    ------
    Li, Aaron, Katsavounidis, Moorthy, Manohara, "Toward a practical perceptual video quality metric" (2016); libvmaf,
    model vmaf_v0.6.1.
    """
    in_step = "settb=1/1000,setpts=N"  # frame by frame, whatever the containers say of their times
    alike = f"{in_step},{STUDIO_RANGE},format=yuv420p"
    options = f"model=version={MODEL}:n_threads={threads}:n_subsample={every}:log_fmt=json:log_path=vmaf.json"
    graph = f"[0:v:0]{alike}[film];[1:v:0]{alike}[reference];[film][reference]libvmaf={options}"
    inputs = [part for video in (film, reference) for part in (*FILE_ALONE, "-i", f"file:{video.resolve()}")]
    with tempfile.TemporaryDirectory() as folder:  # the log's name is relative: a filter's options take no ":" or "\\"
        command = (*STRICT, *inputs, "-lavfi", graph, "-f", "null", "-")
        run_ffmpeg(command, f"{film}: VMAF failed", Path(folder))
        log = read_json(Path(folder) / "vmaf.json")
    return [float(frame["metrics"]["vmaf"]) for frame in log["frames"] if frame["frameNum"] % every == 0]

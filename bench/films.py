"""The whole way by the commands, timed: `python bench/films.py [--keep FOLDER] [--frames 375] [--size 480x270]`.

A synthetic actor is recorded, cut out, reconstructed by every approach and rendered to full-HD films, each command in
processes of its own. Printed are seconds, processor seconds and the largest process of each, and what every film is.
FOLDER, which must not be there yet, keeps everything. Half an hour of two cores as it stands.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from imageio_ffmpeg import count_frames_and_secs

from recon.runtime.files import read_json

FILMS = 30  # of a study of five scenes by six approaches
CORES = 2


def timed(*command: str) -> dict[str, float]:
    """Run a command of ours; processor time and memory include the processes that it started."""
    started = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", "from app.cli import main; main()", *command], stdout=subprocess.DEVNULL
    )
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} ended with status {os.waitstatus_to_exitcode(status)}")
    return {
        "seconds": round(time.perf_counter() - started, 1),
        "processor_s": round(used.ru_utime + used.ru_stime, 1),
        "peak_mib": round(used.ru_maxrss / 1024),
    }


def films_of(folder: Path) -> list[dict[str, Any]]:
    """What a stimulus set's manifest says of each film, and how many frames a decoder finds in it."""
    return [
        {
            "approach": entry["approach"],
            "size": [entry["width"], entry["height"]],
            "frames": count_frames_and_secs(folder / entry["video"])[0],
            "model_frames": entry["model_frames"],
            "mb": round((folder / entry["video"]).stat().st_size / 1e6, 2),
            **entry["quality"],
        }
        for entry in read_json(folder / "manifest.json")["stimuli"]
    ]


def whole_way(folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Times of the commands in `folder`, and the films that they made."""
    capture, run, films = (str(folder / name) for name in ("capture", "run", "films"))
    record = f"--scene {arguments.scene} --frames {arguments.frames} --size {arguments.size}"
    match = f"--depth {arguments.depth} --workers {arguments.workers}"
    film = f"--size {arguments.film_size} --seconds {arguments.frames / 25} --renderer software"
    commands = {
        "synth": ["capture", "synth", capture, *record.split()],
        "segment": ["capture", "segment", capture],
        "reconstruct": ["reconstruct", capture, "-o", run, *match.split()],
        "render": ["render", run, "-o", films, *film.split(), "--workers", str(arguments.workers)],
    }
    result: dict[str, Any] = {name: timed(*command) for name, command in commands.items()}
    result["films"] = films_of(folder / "films")
    each = result["render"]["processor_s"] / len(result["films"])
    return result | {
        "render_s_a_frame": round(each / arguments.frames, 3),
        f"{FILMS} films on {CORES} cores, minutes": round(FILMS * each / CORES / 60, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="folder to make; default: a temporary one")
    parser.add_argument("--scene", default="ball")
    parser.add_argument("--frames", type=int, default=375)
    parser.add_argument("--size", default="480x270", help="of the sensors' pictures")
    parser.add_argument("--film-size", default="1920x1080")
    parser.add_argument("--depth", default="id,dr,pm")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    if arguments.keep and arguments.keep.exists():
        parser.error(f"{arguments.keep} is there already: what it holds would not be made again, nor timed")
    with tempfile.TemporaryDirectory() as temporary:
        print(json.dumps(whole_way(arguments.keep or Path(temporary), arguments), indent=2))


if __name__ == "__main__":
    main()

"""Runs that are killed: `python bench/kills.py [--kills 20]`.

A small recording is reconstructed and rendered by the command line in two worker processes, and the whole process group
is killed with SIGKILL at random moments, again and again. After every kill nothing that was finished may have been
written again, and the files in the end have to be those of a run that was left alone.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from recon.runtime.artefacts import file_digest
from recon.studio import SynthParameters, synthesise

KINDS = (".tiff", ".npy", ".ply", ".png", ".mp4", ".quality.json")
BOTH = """
import sys
from app.cli import main

capture, run, stimuli = sys.argv[1:]
film = ["--size", "320x240", "--seconds", "6", "--renderer", "software", "--workers", "2"]
for arguments in (["reconstruct", capture, "-o", run, "--depth", "id,dr", "--workers", "2"],
                  ["render", run, "-o", stimuli, *film]):
    sys.argv = ["reconstudy", *arguments]
    try:
        main()
    except SystemExit as ended:
        if ended.code:
            raise
"""


def started(capture: Path, folder: Path) -> subprocess.Popen[bytes]:
    """Both commands, one after the other, in a process group of their own."""
    command = [sys.executable, "-c", BOTH, str(capture), str(folder / "run"), str(folder / "set")]
    return subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def made(folder: Path) -> list[Path]:
    """The artefacts below a folder that are noted as finished."""
    notes = [path for part in ("run", "set") for path in (folder / part / ".finished").rglob("*.json")]
    artefacts = []
    for note in notes:
        top = next(parent for parent in note.parents if parent.name == ".finished")
        artefacts.append(top.parent / note.relative_to(top).with_suffix(""))
    return [path for path in artefacts if path.exists()]


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): file_digest(path)
        for path in sorted(folder.rglob("*"))
        if path.name.endswith(KINDS) and ".finished" not in path.parts
    }


def killed_again_and_again(capture: Path, folder: Path, n_kills: int, longest: float, rng: random.Random) -> int:
    """Start, kill, start again, until the commands end by themselves or enough was killed; returns the kills."""
    for kills in range(n_kills + 1):
        before = {path: path.stat().st_mtime_ns for path in made(folder)}
        process = started(capture, folder)
        try:
            code = process.wait(timeout=rng.uniform(0.5, longest) if kills < n_kills else None)
        except subprocess.TimeoutExpired:
            code = None
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        again = [path for path, changed in before.items() if path.exists() and path.stat().st_mtime_ns != changed]
        if again:
            raise SystemExit(f"made again although it was finished: {again}")
        if code is not None:
            if code != 0:
                raise SystemExit(f"the commands ended with {code}")
            break
    return kills


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as temporary:
        top = Path(temporary)
        capture, alone = top / "ball", top / "alone"
        synthesise(capture, SynthParameters(scene="ball", n_sensors=2, n_frames=4, size=(320, 240)))
        begun = time.perf_counter()
        if started(capture, alone).wait() != 0:
            raise SystemExit("the run that was left alone failed")
        seconds = time.perf_counter() - begun
        expected, kills, rounds = digests(alone), 0, 0
        stages: Counter[str] = Counter()
        while kills < arguments.kills:
            folder = top / f"killed {rounds}"
            kills += killed_again_and_again(capture, folder, arguments.kills - kills, seconds / 2, rng)
            rounds += 1
            if digests(folder) != expected:
                raise SystemExit(f"other files than those of the run that was left alone: {folder}")
            lines = [json.loads(line)["made"] for line in (folder / "run/log.jsonl").read_text().splitlines()]
            stages.update(path.split("/")[0] for path, times in Counter(lines).items() if times > 1)
            if list(folder.rglob(".*.part*")) or (folder / "set/.parts").exists():
                raise SystemExit(f"temporary files were left: {folder}")
            shutil.rmtree(folder)
    result = {"kills": kills, "rounds": rounds, "files": len(expected), "seconds_alone": round(seconds, 1)}
    sys.stdout.write(json.dumps({**result, "made_twice": dict(stages), "identical": True}) + "\n")


if __name__ == "__main__":
    main()

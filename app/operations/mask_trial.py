"""Try strokes on one picture: `reconstudy capture mask` in a process of its own, one at a time.

The server itself never loads the reconstruction's packages.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from tempfile import TemporaryDirectory

from app.errors import InvalidError, UnavailableError
from app.intake.captures import CameraPictures
from app.intake.strokes import STROKES_FILE, read_strokes
from app.operations.extras import has_extra
from app.operations.jobs.command import needed_environment

LONGEST_S = 120
WAITS_S = 60  # for the trial of somebody else
NICENESS = 10  # participants come first

_turn = threading.Lock()


def try_strokes(folder: Path, camera: CameraPictures, frame: int) -> bytes:
    """Return the mask of a picture from the strokes on it, as PNG: 255 foreground, 0 background.

    Parameters
    ----------
    folder : the capture's, with its strokes
    camera, frame : of the picture

    Raises
    ------
    InvalidError
        If the strokes make no mask: says why.
    UnavailableError
        If the server cannot do it, or does it for others now.
    """
    place = (camera.sensor, camera.side, frame)
    if place not in {(stroke.sensor, stroke.side, stroke.frame) for stroke in read_strokes(folder)}:
        raise InvalidError(
            "There is no mask: nothing is drawn on this frame. Draw on the object, and a line around it."
        )
    if not has_extra("recon"):
        raise UnavailableError(
            "Masks cannot be tried on this server, which has no reconstruction. The strokes are kept, and a worker "
            "that has it can segment all frames."
        )
    if not _turn.acquire(timeout=WAITS_S):
        raise UnavailableError("Others try masks now. Please try again in a minute.")
    try:
        with TemporaryDirectory(prefix="reconstudy-mask-") as temporary:
            out = Path(temporary) / "mask.png"
            _run(folder, camera, frame, out)
            return out.read_bytes()
    finally:
        _turn.release()


def _run(folder: Path, camera: CameraPictures, frame: int, out: Path) -> None:
    place = [f"--sensor={camera.sensor}", f"--side={camera.side}", f"--frame={frame}"]
    arguments = ["capture", "mask", str(folder), f"--scribbles={folder / STROKES_FILE}", *place, f"--out={out}"]
    command = ["nice", "-n", str(NICENESS), sys.executable, "-m", "app.cli", *arguments]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=LONGEST_S,
            env=needed_environment(),
        )
    except subprocess.TimeoutExpired as error:
        raise UnavailableError(
            f"The mask took longer than {LONGEST_S} s. Segment all frames by a job instead."
        ) from error
    if done.returncode != 0:
        told = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]
        reason = told.removeprefix("reconstudy: ").replace(f"{folder / STROKES_FILE}: ", "").replace(f"{folder}/", "")
        raise InvalidError(f"There is no mask: {reason}.".replace("..", "."))

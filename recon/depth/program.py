"""Somebody else's program as a matcher: it gets a pair as two PNG files, and writes its disparities into a third file.

The program runs without a shell, in a folder of its own. What it prints goes to a log file there.
"""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from shutil import rmtree

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.depth.disparity_io import read_disparity, read_disparity_png16
from recon.depth.pair import StereoPair
from recon.storage.files import whole_file

READERS = {
    "npy": (".npy", read_disparity),
    "pfm": (".pfm", read_disparity),
    "tiff": (".tiff", read_disparity),
    "png16": (".png", read_disparity_png16),
}
TRIAL: dict[str, str | int] = {
    "left": "left.png",
    "right": "right.png",
    "out": "out",
    "n_disparities": 16,
    "min_disparity": 0,
    "folder": ".",
}
LOG = "log.txt"


class ProgramError(ValueError):
    """A program that could not be started, failed, took too long, or wrote no disparities of the pair."""


@dataclass(frozen=True)
class Program:
    """How to call a program.

    Parameters
    ----------
    command : split into arguments as a shell would; then the names in braces, those of `TRIAL`, are filled in
    output : format of the disparities, one of `READERS`
    timeout_s : it is stopped after so many seconds for one pair
    folder : what {folder} stands for: that of the methods file

    Raises
    ------
    ValueError
        If the command or a value cannot be used.
    """

    command: str
    output: str
    timeout_s: float = 600.0
    folder: str = "."

    def __post_init__(self) -> None:
        if self.output not in READERS:
            raise ValueError(f"output is {self.output!r}, expected one of {', '.join(READERS)}")
        if not (isfinite(self.timeout_s) and self.timeout_s > 0):
            raise ValueError(f"timeout_s is {self.timeout_s}, expected a positive number of seconds")
        if not self.arguments(TRIAL):
            raise ValueError("command is empty, expected a program and its arguments")

    def arguments(self, values: Mapping[str, str | int]) -> list[str]:
        """Return the program and its arguments with the names in braces filled in."""
        try:
            return [argument.format_map(values) for argument in shlex.split(self.command)]
        except (ValueError, LookupError, AttributeError, TypeError) as error:
            known = ", ".join(f"{{{name}}}" for name in TRIAL)
            raise ValueError(
                f"command is {self.command!r}, which cannot be filled in ({error!r}); expected arguments with {known}"
            ) from error


def match_by_program(pair: StereoPair, program: Program, folder: Path) -> NDArray[np.float32]:
    """Match the left image of a pair by a program: float32 (H, W), pixels.

    The program sees the pictures with their background. What it finds on the left background or outside the range is
    dropped: NaN.

    Parameters
    ----------
    pair : the pictures and the range to search
    program : what to call
    folder : where it runs; all that is in it is removed before, and if the program succeeds all but the log afterwards

    Raises
    ------
    ProgramError
        If the program fails in any way; it names the log, and the folder is left as it is, to try by hand.
    """
    suffix, read = READERS[program.output]
    left, right, out, log = (folder / name for name in ("left.png", "right.png", f"out{suffix}", LOG))
    values: dict[str, str | int] = {
        "left": str(left),
        "right": str(right),
        "out": str(out),
        "n_disparities": pair.n_disparities,
        "min_disparity": pair.min_disparity,
        "folder": program.folder,
    }
    _empty(folder)
    _write_picture(left, pair.left)
    _write_picture(right, pair.right)
    try:
        _run(program.arguments(values), program.timeout_s, log)
        disparity = _read_result(out, read, pair)
    except ValueError as error:
        raise ProgramError(f"{error}; its log is {log}") from error
    printed = log.read_bytes()
    _empty(folder)
    log.write_bytes(printed)
    highest = pair.min_disparity + pair.n_disparities - 1
    is_match = (disparity >= pair.min_disparity - 0.5) & (disparity <= highest + 0.5)
    if pair.left_mask is not None:
        is_match &= pair.left_mask
    return np.where(is_match, disparity, np.float32(np.nan))


def _empty(folder: Path) -> None:
    rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)


def _write_picture(path: Path, image: NDArray[np.uint8]) -> None:
    with whole_file(path) as temporary:
        if not cv2.imwrite(str(temporary), image[..., ::-1] if image.ndim == 3 else image):
            raise OSError(f"{path}: could not be written")


def _run(arguments: Sequence[str], timeout_s: float, log: Path) -> None:
    """Run a program in the folder of its log; if it must be stopped, so are all processes that it started."""
    with log.open("w", encoding="utf-8") as printed:
        print("$", shlex.join(arguments), file=printed, flush=True)
        try:
            process = subprocess.Popen(
                arguments,
                stdin=subprocess.DEVNULL,
                stdout=printed,
                stderr=subprocess.STDOUT,
                cwd=log.parent,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise ProgramError(f"the program could not be started: {error}") from error
        try:
            process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise ProgramError(f"the program was stopped after {timeout_s:g} s, its timeout_s") from error
        finally:
            if process.returncode is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    if process.returncode:
        raise ProgramError(f"the program ended with exit status {process.returncode}")


def _read_result(out: Path, read: Callable[[Path], NDArray[np.float32]], pair: StereoPair) -> NDArray[np.float32]:
    if not out.is_file():
        raise ProgramError(f"the program wrote no {out.name}")
    try:
        disparity = read(out)
    except ValueError as error:
        raise ProgramError(f"the program's disparities cannot be read: {error}") from error
    if disparity.shape != pair.left.shape[:2]:
        height, width = disparity.shape
        raise ProgramError(f"the program wrote {width}x{height} disparities of pictures of {pair.width}x{pair.height}")
    return disparity

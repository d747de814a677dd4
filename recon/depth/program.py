"""Somebody else's program as a matcher: it gets a pair as PNG files, and writes its disparities into another file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import write_picture
from recon.depth.disparity_io import read_disparity, read_disparity_png16
from recon.depth.pair import StereoPair, check_range, within_pair
from recon.runtime.programs import Program, ProgramError, Value, check_written, workplace

READERS = {
    "npy": (".npy", read_disparity),
    "pfm": (".pfm", read_disparity),
    "tiff": (".tiff", read_disparity),
    "png16": (".png", read_disparity_png16),
}


@dataclass(frozen=True)
class DepthProgram(Program):
    """How to call a program that matches; its limit of time is for one pair."""

    PLACEHOLDERS: ClassVar[tuple[str, ...]] = (
        "left",
        "right",
        "left_mask",
        "right_mask",
        "out",
        "n_disparities",
        "min_disparity",
    )
    OUTPUTS: ClassVar[tuple[str, ...]] = tuple(READERS)


def match_by_program(pair: StereoPair, program: DepthProgram, folder: Path) -> NDArray[np.float32]:
    """Match the left image of a pair by a program: float32 (H, W), pixels.

    The program sees the pictures with their background. If its command asks for masks, they are written, too, as PNG
    of 8 bits: white on the foreground, all white where there are none. What it finds on the left background or outside
    the range is dropped: NaN.

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
    left, right, out = (folder / name for name in ("left.png", "right.png", f"out{suffix}"))
    values: dict[str, Value] = {
        "left": str(left),
        "right": str(right),
        "out": str(out),
        "n_disparities": pair.n_disparities,
        "min_disparity": pair.min_disparity,
    }
    masks = {"left_mask": pair.left_mask, "right_mask": pair.right_mask}
    with workplace(folder):
        write_picture(left, pair.left)
        write_picture(right, pair.right)
        for name, mask in masks.items():
            values[name] = str(folder / f"{name}.png")
            if program.asks_for(name):
                is_foreground = np.ones(pair.left.shape[:2], np.bool_) if mask is None else mask
                write_picture(folder / f"{name}.png", np.where(is_foreground, np.uint8(255), np.uint8(0)))
        said = program.run(values, folder)
        check_written(out, said)
        disparity = _read_result(out, read, pair)
    return within_pair(pair, disparity)


def _read_result(out: Path, read: Callable[[Path], NDArray[np.float32]], pair: StereoPair) -> NDArray[np.float32]:
    try:
        disparity = read(out)
    except ValueError as error:
        raise ProgramError(f"the program's disparities cannot be read: {error}") from error
    if disparity.shape != pair.left.shape[:2]:
        height, width = disparity.shape
        raise ProgramError(
            f"the program wrote {width}x{height} disparities, expected {pair.width}x{pair.height}, "
            "as many as the left picture has pixels"
        )
    check_range(pair, disparity)
    return disparity

"""OpenEXR files, of depth or of pictures, by a reader that looks at what they announce before it allocates that."""

from __future__ import annotations

import struct
import sys
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HEADER, LONGEST_LIST = 65536, 18432  # bytes; the list of a thousand channels
MOST_PACKED = 1100  # times that deflate can shrink what it packs
BYTES_A_PIXEL = 2  # of half a float


def exr_channels(path: Path) -> dict[str, NDArray[np.generic]]:
    """Read the channels of an EXR file by their names, each (H, W).

    A ValueError says that it is unreadable, or announces more than it can hold.
    """
    import OpenEXR

    _check_announced(path)
    try:
        # its warnings about damaged files go to standard output, where --json prints the result
        with redirect_stdout(sys.stderr), OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: np.asarray(channel.pixels) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, TypeError) as error:
        raise ValueError(f"{path}: is not readable as EXR: {error}") from error


def _check_announced(path: Path) -> None:
    """Refuse more channels than any camera writes, each of which takes time and memory, and more pixels than fit."""
    with path.open("rb") as file:
        header = file.read(HEADER)
    _, name, rest = header.partition(b"channels\0chlist\0")
    n_bytes = int.from_bytes(rest[:4], "little")
    if name and n_bytes > LONGEST_LIST:
        raise ValueError(f"{path}: lists channels in {n_bytes} bytes, expected {LONGEST_LIST} at most")
    windows = [header.partition(name + b"Window\0box2i\0")[2][4:20] for name in (b"data", b"display")]
    if len(windows[0]) < 16:
        return
    left, top, right, bottom = struct.unpack("<4i", windows[0])
    width, height = right - left + 1, bottom - top + 1
    if width * height * BYTES_A_PIXEL > MOST_PACKED * path.stat().st_size:
        raise ValueError(
            f"{path}: announces {width}x{height} pixels, more than its {path.stat().st_size} bytes can hold"
        )
    if windows[0] != windows[1] and len(windows[1]) == 16:
        raise ValueError(
            f"{path}: shows {width}x{height} pixels from ({left}, {top}) on, which are not its whole picture; write it "
            "whole, its data window being its display window"
        )

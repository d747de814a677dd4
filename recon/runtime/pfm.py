"""PFM files: one channel of floating numbers, as stereo benchmarks have them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.runtime.files import refused

PFM_HEADER = re.compile(rb"\s*(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s?")  # one space ends it: floats may look like spaces


def read_pfm(path: Path) -> NDArray[np.float32]:
    """Read the one channel of a PFM file, float32 (H, W), the upper row first.

    A ValueError says that the file is missing, unreadable, damaged, or has three channels.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise refused(path, error) from error
    header = PFM_HEADER.match(content)
    try:
        if header is None:
            raise ValueError("it has fewer than four fields")
        kind, width, height, scale = header[1], int(header[2]), int(header[3]), float(header[4])
    except ValueError as error:
        raise ValueError(f"{path}: is not readable as PFM: the header is damaged") from error
    if kind != b"Pf" or width < 1 or height < 1 or scale == 0:
        raise ValueError(f"{path}: is not a one-channel PFM: its header says {kind!r} {width}x{height}, scale {scale}")
    n_bytes = 4 * width * height
    body = content[header.end() :]
    if len(body) != n_bytes:
        raise ValueError(f"{path}: holds {len(body)} bytes of numbers, {width}x{height} needs {n_bytes}")
    values = np.frombuffer(body, dtype="<f4" if scale < 0 else ">f4").reshape(height, width)
    return values[::-1].astype(np.float32)

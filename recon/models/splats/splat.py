"""Splats as .splat: 32 bytes each, without harmonics, as the first viewers in browsers read them.

Source: https://github.com/antimatter15/splat
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.models.splats.raw import RawSplats, check_count, constant_harmonics

ROW = np.dtype([("centre", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])


def read_splat(path: Path) -> RawSplats:
    """Read a .splat file; a ValueError says that it is cut off."""
    content = path.read_bytes()
    if len(content) % ROW.itemsize:
        raise ValueError(
            f"it has {len(content)} bytes, expected a multiple of {ROW.itemsize}: it is cut off, or no .splat"
        )
    check_count(len(content) // ROW.itemsize)
    rows = np.frombuffer(content, ROW)
    return RawSplats(
        rows["centre"],
        rows["scale"],
        (rows["rotation"].astype(np.float32) - 128) / 128,
        rows["colour"][:, 3] / np.float32(255),
        constant_harmonics(rows["colour"][:, :3] / np.float32(255)),
    )

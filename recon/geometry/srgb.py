"""The encoding of colours, IEC 61966-2-1: files of ours hold sRGB bytes, glTF holds linear light in vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def srgb_bytes(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Encode linear light (..., 3), from 0 to 1, as sRGB bytes, uint8 (..., 3)."""
    light = np.clip(linear, 0, 1)
    encoded = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(encoded * 255), dtype=np.uint8)


def light_of_bytes() -> NDArray[np.float64]:
    """Tabulate the linear light of each sRGB byte, float64 (256,), from 0 to 1."""
    return light_of(np.arange(256) / 255)


def light_of(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """Decode sRGB (..., 3), from 0 to 1, to linear light, float64 (..., 3)."""
    encoded = np.clip(np.asarray(encoded, np.float64), 0, 1)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)

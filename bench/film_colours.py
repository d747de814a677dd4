"""Colours in floating point by the formulas of the standards: what the coded values of a film mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.ffmpeg.look import SDR_NITS

WEIGHTS = {"bt709": (0.2126, 0.0722), "smpte170m": (0.299, 0.114), "bt2020nc": (0.2627, 0.0593)}  # of red and blue
FFMPEG_NAMES = {"709": "bt709", "170m": "smpte170m", "2020_ncl": "bt2020nc"}  # by those of zscale
PRIMARIES = {
    "bt709": ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)),
    "170m": ((0.63, 0.34), (0.31, 0.595), (0.155, 0.07)),
    "bt2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
}

Values = NDArray[np.float64]


def rgb_of(values: Values, *, matrix: str, is_full: bool, bits: int) -> Values:
    """Return red, green and blue, 0 to 1, of luma and chroma as they are coded (ITU-T H.273)."""
    red, blue = WEIGHTS[matrix]
    unit, top = 2 ** (bits - 8), 2**bits - 1
    first, luma, chroma = (0, top, top) if is_full else (16 * unit, 219 * unit, 224 * unit)
    y = (values[..., 0] - first) / luma
    cb, cr = ((values[..., at] - 128 * unit) / chroma for at in (1, 2))
    r, b = y + 2 * (1 - red) * cr, y + 2 * (1 - blue) * cb
    return np.stack([r, (y - red * r - blue * b) / (1 - red - blue), b], axis=-1)


def light_of(rgb: Values, transfer: str, matrix: str) -> Values:
    """Return light of HDR with white at 1 (ITU-R BT.2100)."""
    if transfer == "smpte2084":
        m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
        power = rgb.clip(0, None) ** (1 / m2)
        return 10_000 / SDR_NITS * (np.maximum(power - c1, 0) / (c2 - c3 * power)) ** (1 / m1)
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    scene = np.where(rgb <= 0.5, rgb.clip(0, None) ** 2 / 3, (np.exp((rgb - c) / a) + b) / 12)
    red, blue = WEIGHTS[FFMPEG_NAMES.get(matrix, matrix)]
    brightness = scene @ np.array([red, 1 - red - blue, blue])
    return np.asarray(1000 / SDR_NITS * scene * brightness[..., None] ** 0.2)


def xyz_of(corners: Sequence[tuple[float, float]]) -> Values:
    """Return the matrix from light of red, green and blue with these chromaticities, and white of D65, to XYZ."""
    columns = np.array([(x / y, 1, (1 - x - y) / y) for x, y in corners]).T
    white = np.array([0.3127 / 0.3290, 1, (1 - 0.3127 - 0.3290) / 0.3290])
    return columns * np.linalg.solve(columns, white)

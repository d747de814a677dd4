"""Draw the screening's pictures on the server: a page gets the picture and never the right answer.

Directions are counted from 0 (right) anticlockwise by 45 degrees.
"""

from __future__ import annotations

import math
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

RING = 5  # outer diameter of a Landolt ring in gaps (ISO 8596)
MARGIN = 2  # pixels of ground around a ring
SAMPLES = 80  # at least, across a gap; they give the grey levels of the pixels at its edges


def encode_srgb(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sRGB levels of linear light, both float64 (…,), from 0 to 1.

    Source
    ------
    IEC 61966-2-1.
    """
    inside = np.clip(linear, 0, 1)
    return np.asarray(np.where(inside <= 0.0031308, 12.92 * inside, 1.055 * inside ** (1 / 2.4) - 0.055))


def decode_srgb(level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return linear light of sRGB levels, both float64 (…,), from 0 to 1; the inverse of `encode_srgb`."""
    return np.asarray(np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4))


def direction_vector(direction: int) -> tuple[float, float]:
    """Return the unit vector (x, y) of a direction, y upwards."""
    return math.cos(direction * math.pi / 4), math.sin(direction * math.pi / 4)


def landolt_ring(gap_px: float, direction: int) -> NDArray[np.uint8]:
    """Draw a black ring on white; a pixel that is half covered reflects half the light.

    Parameters
    ----------
    gap_px : width of the gap and of the stroke, pixels; fractions are allowed
    direction : of the gap

    Returns
    -------
    uint8 (H, H), sRGB grey levels, the ring in the centre

    Source
    ------
    ISO 8596:2017, figure 1: outer diameter five gaps, stroke and gap one.
    """
    if not 1 <= gap_px <= 400:
        raise ValueError(f"a gap of {gap_px} pixels: expected 1 to 400")
    side = 2 * math.ceil(RING * gap_px / 2) + 2 * MARGIN
    fine = max(2, math.ceil(SAMPLES / gap_px))  # samples of a pixel along a side
    at = (np.arange(side * fine) + 0.5) / fine - side / 2  # pixels from the centre
    x, y = at[None, :], -at[:, None]
    radius = np.hypot(x, y) / gap_px
    u, v = direction_vector(direction)
    is_gap = (np.abs(x * v - y * u) <= gap_px / 2) & (x * u + y * v > 0)
    is_ring = (radius <= RING / 2) & (radius >= RING / 2 - 1) & ~is_gap
    coverage = is_ring.reshape(side, fine, side, fine).mean(axis=(1, 3))
    return np.round(255 * encode_srgb(1 - coverage)).astype(np.uint8)


def png(picture: NDArray[np.uint8]) -> bytes:
    """Encode a picture as a PNG file; `read_png` is the inverse.

    Parameters
    ----------
    picture : uint8 (H, W) grey or (H, W, 3) sRGB
    """
    file = BytesIO()
    Image.fromarray(picture).save(file, "PNG")
    return file.getvalue()


def read_png(file: bytes) -> NDArray[np.uint8]:
    """Read a picture that `png` wrote, for simulated participants.

    Returns
    -------
    uint8 (H, W) grey or (H, W, 3) sRGB

    Raises
    ------
    ValueError
        If it is not a PNG of 8 bits, grey or RGB.
    """
    try:
        picture = Image.open(BytesIO(file), formats=("PNG",))
    except UnidentifiedImageError as error:
        raise ValueError(f"begins with {file[:8]!r}, expected a PNG") from error
    if picture.mode not in ("L", "RGB"):
        raise ValueError(f"a PNG of mode {picture.mode}, expected 8 bits, grey or RGB")
    return np.asarray(picture)

"""From light to the values that a camera writes: exposure, display curve, sensor noise."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

GAMMA = 2.2
CURVE_STEPS = 4096


def display_curve() -> NDArray[np.float32]:
    """Tabulate display values 0 to 255 of linear intensities 0 to 1, softly cut: float32 (CURVE_STEPS + 2,)."""
    light = np.arange(CURVE_STEPS + 2) / CURVE_STEPS
    return (255.0 * np.minimum(light, 1.0) ** (1 / GAMMA)).astype(np.float32)


def plate_values(plate: NDArray[np.float32], gains: NDArray[np.float64]) -> NDArray[np.float32]:
    """Convert a linear plate, float32 (H, W, 3), at gains (3,) to display values 0 to 255, not rounded."""
    return (255.0 * np.clip(plate * gains.astype(np.float32), 0, 1) ** np.float32(1 / GAMMA)).astype(np.float32)


@numba.njit(cache=True, nogil=True)
def expose(
    plate: NDArray[np.float32],
    actors: tuple[NDArray[np.float32], int, int],
    gains: NDArray[np.float64],
    curve: NDArray[np.float32],
    floor: tuple[NDArray[np.float32], NDArray[np.float32]],
    dimming: NDArray[np.float32],
    noise: float,
    key: np.uint64,
) -> NDArray[np.uint8]:
    """Make the picture that a camera writes, uint8 (H, W, 3) in the order blue, green, red.

    Parameters
    ----------
    plate : float32 (H, W, 3), display values of the empty studio
    actors : float32 (h, w, 4), linear colour and coverage, and the column and row where they stand
    gains : float64 (3,), the camera's exposure per channel
    curve : `display_curve()`
    floor : float32 (S, S), factor on its display values, after float32 (H, W, 2), column and row in it of each pixel,
        -1 where there is no floor
    dimming : float32 (H, W), share of the light that reaches each pixel; (0, 0) for all of it
    noise : standard deviation, grey levels
    key : uint64, makes the noise of this picture
    """
    height, width = plate.shape[0], plate.shape[1]
    (pixels, column, row), (floor_cells, floor_shade) = actors, floor
    picture = np.empty((height, width, 3), np.uint8)
    sigma = np.float32(noise / 63.9980)  # of the sum of three uniform numbers 0 to 127: sqrt(3 (128^2 - 1) / 12)
    values = np.empty((width, 3), np.float32)
    for y in range(height):
        for x in range(width):
            factor = np.float32(1.0)
            u, v = floor_cells[y, x, 0], floor_cells[y, x, 1]
            if u >= 0.0:
                i, j = int(v), int(u)
                ti, tj = v - np.float32(i), u - np.float32(j)
                top = floor_shade[i, j] + tj * (floor_shade[i, j + 1] - floor_shade[i, j])
                low = floor_shade[i + 1, j] + tj * (floor_shade[i + 1, j + 1] - floor_shade[i + 1, j])
                factor = top + ti * (low - top)
            if len(dimming) > 0:
                factor *= dimming[y, x] ** np.float32(1 / 2.2)
            values[x, 0] = plate[y, x, 0] * factor
            values[x, 1] = plate[y, x, 1] * factor
            values[x, 2] = plate[y, x, 2] * factor
        if row <= y < row + pixels.shape[0]:
            for i in range(pixels.shape[1]):
                share_lit = dimming[y, column + i] if len(dimming) > 0 else np.float32(1.0)
                _lay_over(values[column + i], pixels[y - row, i], share_lit, gains, curve)
        for x in range(width):
            state = _random_bits(key + np.uint64(y * width + x) * np.uint64(0x9E3779B97F4A7C15))
            for c in range(3):
                bits = np.int32((state >> np.uint64(21 * c)) & np.uint64(0x1FFFFF))
                deviate = np.float32((bits & 127) + ((bits >> 7) & 127) + (bits >> 14)) - np.float32(190.5)
                value = values[x, c] + sigma * deviate + np.float32(0.5)
                picture[y, x, 2 - c] = np.uint8(max(np.float32(0.0), min(np.float32(255.0), value)))
    return picture


@numba.njit(cache=True, nogil=True, inline="always")
def _lay_over(values, actor, share_lit, gains, curve):  # type: ignore[no-untyped-def]  # numba
    """Lay an actor's linear colour and coverage (4,) over the display values (3,) of a pixel."""
    share = actor[3]
    if share == 0.0:
        return
    for c in range(3):
        light = actor[c] * gains[c] * share_lit
        if share < 1.0:
            light = share * light + (1.0 - share) * (values[c] / 255.0) ** 2.2
        place = min(light, 1.0) * 4096.0
        k = int(place)
        values[c] = curve[k] + (place - k) * (curve[k + 1] - curve[k])


@numba.njit(cache=True, nogil=True, inline="always")
def _random_bits(state):  # type: ignore[no-untyped-def]  # numba
    """Return 64 random bits of a pixel's number (splitmix64, Steele, Lea and Flood, 2014)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))

"""Descriptions of actors, objects and lights: looks, and the rows of numbers that the kernels read.

A look becomes a row of numbers, whose columns are KIND to HALF_SIZE below. A colour has three of them: linear red,
green and blue. The half size has three, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NOISE_SIZE = 64  # cells per side of the periodic noise: 1 MB, which stays in a core's cache
N_LOOK = 32  # numbers that describe one look
# Its columns. Kernels are compiled with them: numba's cache does not see them change.
KIND, FIRST, SECOND, THIRD, FOURTH, FIFTH = 0, 1, 4, 7, 10, 13
PATTERN, SLEEVE, LONG_HAIR, EYES_CLOSED, SHIFT, HALF_SIZE = 16, 17, 18, 19, 20, 21

PERSON, BALL, BOX, SPHERE, CUBOID = 0.0, 1.0, 2.0, 3.0, 4.0
PLAID, STRIPES, KNIT, PRINT = 0.0, 1.0, 2.0, 3.0

# Soft studio light: a key light that casts shadows, a fill and a rim light, and light from all around. Directions point
# towards the light; powers are linear RGB at normal incidence on a white surface.
LIGHTS = (
    ((-0.55, 0.72, 0.62), (0.92, 0.89, 0.84)),
    ((0.75, 0.35, 0.60), (0.36, 0.37, 0.40)),
    ((0.15, 0.65, -0.80), (0.34, 0.34, 0.37)),
)
LIGHT_ABOVE, LIGHT_BELOW = (0.52, 0.53, 0.55), (0.22, 0.20, 0.19)
SOFTNESS = 0.25

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """Colours (sRGB, 0 to 1) and patterns of one actor or object.

    Parameters
    ----------
    kind : PERSON, BALL, BOX, SPHERE or CUBOID
    first, second, third, fourth, fifth : colours; a person's skin, shirt, shirt's pattern, trousers, hair
    pattern : PLAID, STRIPES, KNIT or PRINT, of a person's shirt
    sleeve : mm along the arm from the shoulder
    long_hair : hair down to the shoulders
    half_size : mm, half edges of a box or the radius of a ball
    shift : mm, displaces the texture, so that equal bodies differ
    """

    kind: float
    first: Colour
    second: Colour
    third: Colour = (0.2, 0.2, 0.2)
    fourth: Colour = (0.2, 0.2, 0.2)
    fifth: Colour = (0.1, 0.08, 0.06)
    pattern: float = PLAID
    sleeve: float = 505.0
    long_hair: bool = False
    half_size: Colour = (0.0, 0.0, 0.0)
    shift: float = 0.0


def light_table() -> NDArray[np.float64]:
    """Return the lights as rows, float64 (2 + lights, 6): above and below, softness, then directions and powers."""
    rows: list[tuple[float, ...]] = [(*LIGHT_ABOVE, *LIGHT_BELOW), (SOFTNESS, 0.0, 0.0, 0.0, 0.0, 0.0)]
    for direction, power in LIGHTS:
        unit = np.asarray(direction) / np.linalg.norm(direction)
        rows.append((*map(float, unit), *power))
    return np.array(rows)


def linear(colour: Colour) -> NDArray[np.float64]:
    """Convert a display colour, sRGB 0 to 1, to linear intensities, float64 (3,)."""
    return np.power(np.asarray(colour, dtype=np.float64), 2.2)


def look_row(look: Look) -> NDArray[np.float64]:
    """Convert a look to the row, float64 (N_LOOK,), that the kernels read."""
    row = np.zeros(N_LOOK)
    row[KIND], row[PATTERN], row[SLEEVE] = look.kind, look.pattern, look.sleeve
    row[LONG_HAIR], row[SHIFT] = float(look.long_hair), look.shift
    colours = (look.first, look.second, look.third, look.fourth, look.fifth)
    for column, colour in zip((FIRST, SECOND, THIRD, FOURTH, FIFTH), colours, strict=True):
        row[column : column + 3] = linear(colour)
    row[HALF_SIZE : HALF_SIZE + 3] = look.half_size
    return row


def noise_volume(rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw periodic white noise, float32 (S, S, S), standard deviation 0.5, at most 1, for smooth interpolation."""
    return np.clip(rng.normal(0.0, 0.5, (NOISE_SIZE,) * 3), -1.0, 1.0).astype(np.float32)

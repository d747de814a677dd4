"""Whether two cameras show the same points alike: as bright, and in the same colours."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.continuity import DARK_LEVELS
from recon.capture.checking.matches import Matches

MAX_LEFT_TO_RIGHT = 1.15  # of the brightness of matched points
MAX_COLOUR = 1.2  # of a colour's share of it, either way: exchanged channels differ both ways
COLOURS = ("red", "green", "blue")
SURE = 2.6  # standard deviations of a number of heads, for 99 %


def level_ratios(left: NDArray[np.uint8], right: NDArray[np.uint8], matches: Matches) -> NDArray[np.float64]:
    """Compare how bright matched points are in two pictures, and of which colour.

    Parameters
    ----------
    left, right : uint8 (H, W, 3), sRGB
    matches : of the two

    Returns
    -------
    float64 (N, 4), left by right, NaN where it is dark: brightness, then red, green and blue as shares of it
    """
    levels = []
    for image, points in ((left, matches.left), (right, matches.right)):
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        smooth = cv2.blur(np.dstack([grey, image]), (5, 5)).astype(np.float64)
        columns, rows = np.round(points).astype(int).T
        levels.append(smooth[rows, columns])
    ratios = levels[0] / np.where(np.minimum(*levels) > DARK_LEVELS, levels[1], np.nan)
    ratios[:, 1:] /= ratios[:, :1]
    return np.asarray(ratios)


def unlike(ratios: NDArray[np.float64], most: float) -> float | None:
    """Return the median of ratios (N,) if it is certain to be more than `most` or less than its inverse, else None.

    Points that are matched wrongly, and highlights, spread them: of a few, the median is chance. NaN are left out.
    """
    ratios = ratios[np.isfinite(ratios)]
    if not len(ratios):
        return None
    off = SURE * np.sqrt(len(ratios)) / 2  # places in order: the interval of a median
    low, high = np.interp([len(ratios) / 2 - off, len(ratios) / 2 + off], np.arange(len(ratios)), np.sort(ratios))
    return float(np.median(ratios)) if low > most or high < 1 / most else None


def exposure_warnings(sensor_id: str, ratios: NDArray[np.float64]) -> Iterator[str]:
    """Say that left and right are unlike bright or of other colours, by ratios (N, 4) of matches that agree."""
    ratio = unlike(ratios[:, 0], MAX_LEFT_TO_RIGHT)
    if ratio is not None:
        yield (
            f"sensor {sensor_id}: the left pictures are {ratio:.2f} times as bright as the right ones at matched "
            "points; use the same exposure and gain"
        )
    apart = {
        colour: ratio
        for colour, column in zip(COLOURS, ratios.T[1:], strict=True)
        if (ratio := unlike(np.maximum(column, 1 / column), MAX_COLOUR)) is not None
    }
    if apart:
        told = " and ".join(f"{ratio:.2f} times in {colour}" for colour, ratio in apart.items())
        yield (
            f"sensor {sensor_id}: for their brightness, matched points differ {told} between the left and the right "
            "pictures (median); use the same white balance, and one order of red, green and blue"
        )

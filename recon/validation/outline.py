"""Where a surface ends: there the density of its points falls from full to none, blurred by their noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NOT_SEEN = float("nan"), float("nan")
N_BINS = 48
MIN_COUNT = 200  # points in the window; fewer do not tell where the density falls
LARGEST_REST = 0.5  # of the density inside, that may be left outside


def end_of_points(along: NDArray[np.float64], start: float, side: float, window: float) -> tuple[float, float]:
    """Where the points end along a line, and its standard error, mm; NaN where no end is to be found near the start.

    Least squares of the counts in bins to a slope inside, a Gaussian's cumulative distribution across the end, and a
    constant rest outside. The blur is symmetric, so it does not move the end.

    Parameters
    ----------
    along : float64 (N,), mm, places of the points of one face along an edge
    start : mm, where the end is about
    side : 1.0 if it is the upper end, -1.0 the lower
    window : mm, how far from the start is looked on either side
    """
    from scipy.optimize import OptimizeWarning, curve_fit
    from scipy.special import erfc

    places = side * (along - start)
    counts, borders = np.histogram(places, N_BINS, (-window, window))
    if counts.sum() < MIN_COUNT:
        return NOT_SEEN
    middles = (borders[:-1] + borders[1:]) / 2

    def density(t, level, slope, end, blur, rest):  # type: ignore[no-untyped-def]  # as curve_fit calls it
        return level * (1 + slope * t / window) * 0.5 * erfc((t - end) / (np.sqrt(2) * blur)) + rest

    level = float(np.percentile(counts[: N_BINS // 3], 50))
    if not level > 0:
        return NOT_SEEN
    guess = (level, 0.0, float(middles[np.argmax(np.cumsum(counts) >= 0.98 * counts.sum())]) * 0.5, window / 10, 0.0)
    low, high = (0, -0.9, -window, window / 200, 0), (10 * level, 0.9, window, window / 2, level)
    try:
        found, covariance = curve_fit(density, middles, counts, guess, np.sqrt(counts + 4.0), bounds=(low, high))
    except (RuntimeError, OptimizeWarning):
        return NOT_SEEN
    if found[4] > LARGEST_REST * found[0] or abs(found[2]) > 0.95 * window or not covariance[2, 2] > 0:
        return NOT_SEEN
    return float(start + side * found[2]), float(np.sqrt(covariance[2, 2]))

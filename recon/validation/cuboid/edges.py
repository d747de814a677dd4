"""The end of a surface: there the density of its points falls from full to none, blurred by their noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NOT_SEEN = float("nan"), float("nan")
N_BINS = 96
INSIDE_WINDOWS = 3.0  # windows that are counted inside, against one outside, so that the density there is well known
MIN_COUNT = 200  # points near the end; fewer do not tell where the density falls
LARGEST_REST = 0.5  # of the density inside; with more left outside there is no end
BROAD = 0.6  # of the window, blur of the points that lie far off
SMALLEST_ERROR = 1e-4  # of the window; points without noise end more sharply than a bin is wide
MOST_BROAD = 0.3  # share of the points that lie far off
# Start, lowest, highest: density as a share of the level, slope, end and blur in windows, broad share, rest outside.
STARTS_AND_LIMITS = (
    (1.0, 0.1, 10.0),
    (0.0, -0.3, 0.3),
    (0.0, -1.0, 1.0),
    (0.1, 0.02, 0.5),
    (0.02, 0.0, MOST_BROAD),
    (0.01, 0.0, 1.0),
)


def end_of_points(along: NDArray[np.float64], start: float, side: float, window: float) -> tuple[float, float]:
    """Return where the points end along a line, and its standard error, mm; NaN where there is no end near the start.

    The counts in bins are fitted by the likeliest density: a slope inside, the cumulative distribution of two Gaussians
    across the end, one of the noise and a broad one of wrong points, and a constant rest outside. Both blurs are
    symmetric, so they do not move the end.

    Parameters
    ----------
    along : float64 (N,), mm, places of one face's points along an edge
    start : mm, about where the end is
    side : 1.0 if it is the upper end, -1.0 the lower
    window : mm, searched beyond the start
    """
    places = side * (along - start)
    counts, borders = np.histogram(places, N_BINS, (-INSIDE_WINDOWS * window, window))
    middles = (borders[:-1] + borders[1:]) / 2
    level = float(np.median(counts[middles < -window / 3]))
    if counts[np.abs(middles) < window].sum() < MIN_COUNT or not level > 0:
        return NOT_SEEN
    likeliest = _likeliest(middles / window, counts.astype(np.float64), level)
    if likeliest is None:
        return NOT_SEEN
    end, error = likeliest
    return float(start + side * window * end), window * error


def _likeliest(t: NDArray[np.float64], counts: NDArray[np.float64], level: float) -> tuple[float, float] | None:
    """Return the end and its standard error in windows, of least Poisson deviance for counts (B,) at places t (B,)."""
    from scipy.optimize import least_squares
    from scipy.special import erfc, xlogy

    def density(values: NDArray[np.float64]) -> NDArray[np.float64]:
        full, slope, end, blur, broad, rest = values
        fall = [0.5 * erfc((t - end) / (np.sqrt(2) * width)) for width in (blur, BROAD)]
        return np.asarray(level * (full * (1 + slope * t) * ((1 - broad) * fall[0] + broad * fall[1]) + rest))

    def deviances(values: NDArray[np.float64]) -> NDArray[np.float64]:
        expected = np.maximum(density(values), 1e-3)
        half = np.maximum(xlogy(counts, counts / expected) - counts + expected, 0.0)
        return np.asarray(np.sign(counts - expected) * np.sqrt(2 * half))

    start, low, high = zip(*STARTS_AND_LIMITS, strict=True)
    solved = least_squares(deviances, start, bounds=(low, high))
    full, _, end, _, _, rest = solved.x
    jacobian: NDArray[np.float64] = np.asarray(solved.jac)
    information = jacobian.T @ jacobian
    if not solved.success or rest > LARGEST_REST * full or abs(end) > 0.95:
        return None
    error = max(float(np.linalg.pinv(information, hermitian=True)[2, 2]), 0.0)
    spread = max(1.0, float(2 * solved.cost / (len(t) - len(start))))  # counts of a reconstruction scatter more
    return float(end), max(float(np.sqrt(spread * error)), SMALLEST_ERROR)

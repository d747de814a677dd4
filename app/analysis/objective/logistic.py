"""Fit the logistic curve from a measure to the scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

Array = NDArray[np.float64]

PARAMETERS = 4
MIDDLES = 17  # of the first grid, over the range of the values
WIDTHS = np.geomspace(1 / 50, 2, 9)  # of the first grid, shares of the range: nearly a step to nearly a line
ZOOMS = 10  # each halves the distance to the best curve
AT_LIMIT = 1.001  # a width this close to a limit stands on it


@dataclass(frozen=True)
class Logistic:
    """The curve bottom + (top - bottom) / (1 + exp(-(value - middle) / width)).

    Parameters
    ----------
    bottom, top : in the scores' unit; the curve falls where top < bottom
    middle, width : in the measure's unit, width > 0
    correlation : of curve and scores, with the sign of the curve's direction
    status : `ok`; `step` or `line` where the scores are met best by a curve as steep, or as straight, as any allowed
    """

    bottom: float
    top: float
    middle: float
    width: float
    correlation: float
    status: str

    def __call__(self, values: Array) -> Array:
        """Return the predicted scores, in their unit, of float64 (n,) values."""
        return np.asarray(self.bottom + (self.top - self.bottom) * expit((values - self.middle) / self.width))


def fit_logistic(values: Array, scores: Array) -> Logistic:
    """Fit the logistic curve of four parameters by least squares.

    For a given middle and width, the best top and bottom follow by linear regression, so only two parameters are
    searched: on a grid, then on ever finer grids around its best point. This cannot fail to converge. The middle stays
    within the values and the width between 1/50 and twice their range: where a step or a line fits best, the least
    squares have no minimum, and `status` says so.

    Parameters
    ----------
    values : float64 (n,), of the measure, not all equal
    scores : float64 (n,), in their unit, not all equal

    Source
    ------
    Curve: VQEG (2000), final report on phase I of full-reference television. Linear parameters eliminated: Golub and
    Pereyra (1973).
    """
    low, extent = values.min(), np.ptp(values)
    middles, widths = _grid(values)
    step, factor = extent / (MIDDLES - 1), WIDTHS[1] / WIDTHS[0]
    target = (scores - scores.mean())[None]
    for _ in range(ZOOMS + 1):
        fits = _correlations(values, target, middles, widths)[0]
        best = int(np.argmax(np.abs(fits)))
        middle, width, correlation = middles[best], widths[best], fits[best]
        step, factor = step / 2, np.sqrt(factor)
        near, narrow = np.arange(-2, 3) * step + middle, factor ** np.arange(-2, 3) * width
        near, narrow = np.clip(near, low, low + extent), np.clip(narrow, extent * WIDTHS[0], extent * WIDTHS[-1])
        middles, widths = (part.ravel() for part in np.meshgrid(near, narrow))
    curve = expit((values - middle) / width)
    slope = ((curve - curve.mean()) @ scores) / np.sum((curve - curve.mean()) ** 2)
    bottom = scores.mean() - slope * curve.mean()
    is_step, is_line = width <= extent * WIDTHS[0] * AT_LIMIT, width >= extent * WIDTHS[-1] / AT_LIMIT
    status = "step" if is_step else "line" if is_line else "ok"
    return Logistic(float(bottom), float(bottom + slope), float(middle), float(width), float(correlation), status)


def grid_correlations(values: Array, scores: Array) -> Array:
    """Return the correlation of each row of scores with the best curve of a grid; it has the curve's direction.

    Parameters
    ----------
    values : float64 (n,), of the measure
    scores : float64 (P, n), in their unit

    Returns
    -------
    float64 (P,), a little closer to zero than that of `fit_logistic`
    """
    fits = _correlations(values, scores - scores.mean(axis=1, keepdims=True), *_grid(values))
    best = np.argmax(np.abs(fits), axis=1)
    return np.asarray(np.take_along_axis(fits, best[:, None], axis=1)[:, 0])


def _grid(values: Array) -> tuple[Array, Array]:
    """Return middles and widths of the first grid, each float64 (G,)."""
    middles, widths = np.meshgrid(np.linspace(values.min(), values.max(), MIDDLES), WIDTHS * np.ptp(values))
    return middles.ravel(), widths.ravel()


def _correlations(values: Array, centred: Array, middles: Array, widths: Array) -> Array:
    """Return the correlation of every row of centred scores (P, n) with every curve (G,), float64 (P, G)."""
    curves = expit((values[:, None] - middles) / widths)  # (n, G)
    curves -= curves.mean(axis=0)
    lengths = np.sqrt(np.sum(curves**2, axis=0))
    curves /= np.where(lengths > 0, lengths, np.inf)
    lengths = np.sqrt(np.sum(centred**2, axis=1, keepdims=True))
    return np.asarray((centred / lengths) @ curves)

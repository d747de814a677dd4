"""Fit the logistic curves of four and of five parameters from a measure to the scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

Array = NDArray[np.float64]

PARAMETERS, PARAMETERS_WITH_LINE = 4, 5
MIDDLES = 17  # of the first grid, over the range of the values
WIDTHS = np.geomspace(1 / 50, 2, 9)  # of the first grid, shares of the range: nearly a step to nearly a line
ZOOMS = 10  # each halves the distance to the best curve
NO_LENGTH = 1e-12  # of a curve that lies in the basis, but for rounding
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


@dataclass(frozen=True)
class LogisticWithLine:
    """The curve b1 (1/2 - 1 / (1 + exp(b2 (value - b3)))) + b4 value + b5.

    Parameters
    ----------
    b1, b2, b3, b4, b5 : b2 > 0
    correlation : of curve and scores, with the sign of the linear correlation of values and scores
    status : as in `Logistic`; `not monotone` where the curve turns within the values
    """

    b1: float
    b2: float
    b3: float
    b4: float
    b5: float
    correlation: float
    status: str

    def __call__(self, values: Array) -> Array:
        """Return the predicted scores, in their unit, of float64 (n,) values."""
        return np.asarray(self.b1 * (expit(self.b2 * (values - self.b3)) - 0.5) + self.b4 * values + self.b5)


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
    middle, width, correlation, status = _searched(values, scores, _constant(values))
    curve = expit((values - middle) / width)
    slope = ((curve - curve.mean()) @ scores) / np.sum((curve - curve.mean()) ** 2)
    bottom = scores.mean() - slope * curve.mean()
    return Logistic(float(bottom), float(bottom + slope), middle, width, correlation, status)


def fit_logistic_with_line(values: Array, scores: Array) -> LogisticWithLine:
    """Fit the logistic curve of five parameters, the fifth a linear term, by least squares as in `fit_logistic`.

    Parameters
    ----------
    values, scores : as in `fit_logistic`; more than five

    Source
    ------
    Sheikh, Sabir and Bovik (2006), equations 7 and 8, as the VQEG's tests use it.
    """
    four = fit_logistic(values, scores)
    middle, width, partial, status = _searched(values, scores, _line(values), (four.middle, four.width))
    terms = np.c_[expit((values - middle) / width) - 0.5, values, np.ones(len(values))]
    b1, b4, b5 = np.linalg.lstsq(terms, scores, rcond=None)[0].tolist()
    slopes = np.diff((terms @ (b1, b4, b5))[np.argsort(values)])
    if status == "ok" and slopes.min() < 0 < slopes.max():
        status = "not monotone"
    linear = float(np.corrcoef(values, scores)[0, 1])
    return LogisticWithLine(b1, 1 / width, middle, b4, b5, float(_together(linear, partial)), status)


def _searched(
    values: Array, scores: Array, basis: Array, start: tuple[float, float] | None = None
) -> tuple[float, float, float, str]:
    """Return the middle and the width of the best curve, its correlation beside a basis, and the status.

    Parameters
    ----------
    values, scores : as in `fit_logistic`
    basis : float64 (n, q), orthonormal, what is fitted beside the curve
    start : a middle and a width to try beside the grid's
    """
    low, extent = values.min(), np.ptp(values)
    middles, widths = _grid(values)
    if start is not None:
        middles, widths = np.r_[middles, start[0]], np.r_[widths, start[1]]
    step, factor = extent / (MIDDLES - 1), WIDTHS[1] / WIDTHS[0]
    target = _without(scores[:, None], basis).T
    for _ in range(ZOOMS + 1):
        fits = _correlations(values, target, middles, widths, basis)[0]
        best = int(np.argmax(np.abs(fits)))
        middle, width, correlation = middles[best], widths[best], fits[best]
        step, factor = step / 2, np.sqrt(factor)
        near, narrow = np.arange(-2, 3) * step + middle, factor ** np.arange(-2, 3) * width
        near, narrow = np.clip(near, low, low + extent), np.clip(narrow, extent * WIDTHS[0], extent * WIDTHS[-1])
        middles, widths = (part.ravel() for part in np.meshgrid(near, narrow))
    is_step, is_line = width <= extent * WIDTHS[0] * AT_LIMIT, width >= extent * WIDTHS[-1] / AT_LIMIT
    return float(middle), float(width), float(correlation), "step" if is_step else "line" if is_line else "ok"


def grid_correlations(values: Array, scores: Array, *, with_line: bool = False) -> Array:
    """Return the correlation of each row of scores with the best curve of a grid; it has the curve's direction.

    Parameters
    ----------
    values : float64 (n,), of the measure
    scores : float64 (P, n), in their unit
    with_line : of the curve of five parameters, which has the direction of the linear correlation

    Returns
    -------
    float64 (P,), a little closer to zero than that of the fit
    """
    basis = _line(values) if with_line else _constant(values)
    fits = _correlations(values, _without(scores.T, basis).T, *_grid(values), basis)
    best = np.take_along_axis(fits, np.argmax(np.abs(fits), axis=1)[:, None], axis=1)[:, 0]
    if not with_line:
        return np.asarray(best)
    centred = scores - scores.mean(axis=1, keepdims=True)
    linear: Array = (centred @ basis[:, 1]) / np.sqrt(np.sum(centred**2, axis=1))
    return _together(linear, best)


def _together(linear: Array | float, partial: Array | float) -> Array:
    """Return the correlation with a line and a curve, of those with the line and with the curve beside it."""
    shares = np.square(linear) + (1 - np.square(linear)) * np.square(partial)
    together: Array = np.sign(linear) * np.sqrt(shares)
    return together


def _constant(values: Array) -> Array:
    return np.full((len(values), 1), 1 / np.sqrt(len(values)))


def _line(values: Array) -> Array:
    """Return an orthonormal basis of the lines, float64 (n, 2)."""
    centred = values - values.mean()
    return np.asarray(np.c_[_constant(values), centred / np.sqrt(centred @ centred)])


def _without(columns: Array, basis: Array) -> Array:
    return np.asarray(columns - basis @ (basis.T @ columns))


def _grid(values: Array) -> tuple[Array, Array]:
    """Return middles and widths of the first grid, each float64 (G,)."""
    middles, widths = np.meshgrid(np.linspace(values.min(), values.max(), MIDDLES), WIDTHS * np.ptp(values))
    return middles.ravel(), widths.ravel()


def _correlations(values: Array, targets: Array, middles: Array, widths: Array, basis: Array) -> Array:
    """Return the correlation of every row of targets (P, n) with every curve (G,), without a basis; float64 (P, G)."""
    curves = _without(expit((values[:, None] - middles) / widths), basis)  # (n, G)
    lengths = np.sqrt(np.sum(curves**2, axis=0))
    curves /= np.where(lengths > NO_LENGTH, lengths, np.inf)
    lengths = np.sqrt(np.sum(targets**2, axis=1, keepdims=True))
    return np.asarray((targets / np.where(lengths > 0, lengths, np.inf)) @ curves)

"""Estimate scores where no maximum exists: Firth's correction of the first-order bias."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.model.likelihood.newton import LARGEST_STEP, Design
from app.analysis.model.likelihood.ties import TieModel

Array = NDArray[np.float64]

PENALTIES = ("firth", "ridge")
TOLERANCE = 1e-10
ROUNDING = 1e-12  # relative; smaller decreases are rounding
MAX_ITERATIONS = 1000  # the scoring steps converge linearly


def maximise_firth(design: Design, counts: PairCounts) -> tuple[Array, int]:
    """Maximise the likelihood times the square root of the information's determinant (Jeffreys' prior).

    Returns
    -------
    theta : float64 (P,), log-odds
    iterations : int

    Raises
    ------
    RuntimeError
        If the steps do not converge.

    Source
    ------
    Firth (1993), equation 1 for exponential families: the score is raised by half the trace of inverse information x
    its derivative, which for each pair needs the third cumulants of its statistics.
    """
    theta = np.zeros(design.n_parameters)
    value, step = _evaluate(design, counts, theta)
    for iteration in range(1, MAX_ITERATIONS + 1):
        if np.abs(step).max() < TOLERANCE:
            return theta, iteration
        step *= min(1.0, LARGEST_STEP / max(np.abs(step).max(), LARGEST_STEP))
        following = _evaluate(design, counts, theta + step)
        while following[0] < value - ROUNDING * abs(value):
            step = step / 2
            following = _evaluate(design, counts, theta + step)
        theta = theta + step
        value, step = following
    raise RuntimeError(
        f"Firth's estimate did not converge in {MAX_ITERATIONS} iterations; last step {np.abs(step).max():.1e}"
    )


def _evaluate(design: Design, counts: PairCounts, theta: Array) -> tuple[float, Array]:
    """Return the penalised log-likelihood and the next step (P,).

    The step is Newton's for votes augmented by the pairs' leverages, which is how Firth's correction acts. On the
    information of the votes alone it would be up to twice too long.
    """
    table = counts.wins[None], counts.losses[None], counts.ties[None]
    d, t = design.predictors(theta[None])
    by_pair = design.model.derivatives(d, t, *table)
    information = design.information(by_pair)[0]
    spread = _spread(design, design.covariance(information))
    leverage = by_pair.dd[0] * spread[0, 0] + 2 * by_pair.dt[0] * spread[0, 1] + by_pair.tt[0] * spread[1, 1]
    factor = 1 + leverage / counts.totals
    augmented = replace(by_pair, dd=by_pair.dd * factor, dt=by_pair.dt * factor, tt=by_pair.tt * factor)
    gradient = design.gradient(by_pair)[0] + _correction(design, counts, spread, d, t)
    value = float(design.model.loglik(d, t, *table).sum()) + design.log_determinant(information) / 2
    return value, design.covariance(design.information(augmented)[0]) @ gradient


def _spread(design: Design, covariance: Array) -> Array:
    """Return the covariance of d and t of each pair, float64 (2, 2, C)."""
    effects = [design.effects, design.tie_effects]
    rows = [[left.multiply((covariance @ right.T).T).sum(axis=1) for right in effects] for left in effects]
    return np.stack(rows)


def _correction(design: Design, counts: PairCounts, spread: Array, d: Array, t: Array) -> Array:
    """Return half the trace term for each parameter, (P,)."""
    pull = third_order(design.model, d[0], t[0], spread) * counts.totals / 2
    result: Array = pull[0] @ design.effects + pull[1] @ design.tie_effects
    return result


def third_order(model: TieModel, d: Array, t: Array, spread: Array) -> Array:
    """Return the third cumulants of a vote's statistics times the covariance of its parameters, float64 (2, …, C).

    Parameters
    ----------
    model : one that `is_canonical`
    d, t : float64 (…, C), or t (…, 1), log-odds
    spread : float64 (2, 2, …, C), covariance of d and t
    """
    probabilities = model.probabilities(d, t)  # (3, …, C)
    statistics = np.array([[0.5, -0.5, 0.0], [0.0, 0.0, 1.0]])  # of d and of t, for a win, a loss and a tie
    means = np.tensordot(statistics, probabilities, axes=1)  # (2, …, C)
    centred = statistics.reshape(2, 3, *[1] * d.ndim) - means[:, None]  # (2, 3, …, C)
    return np.asarray(
        np.einsum("o...,ko...,lo...,mo...,lm...->k...", probabilities, *[centred] * 3, spread, optimize=True)
    )

"""Model votes without preference (ties): by Davidson, by Rao and Kupper, as half a win each, or left out.

Every model is a set of functions of `d`, the difference of the two scores (plus the order effect), and of `t`, the tie
parameter: the log-likelihood and its first and second derivatives. From these all designs are fitted. In all of them d,
t (log-odds) and the numbers of wins, losses and ties are float64 (…, C) for C pairs; t may also be (…, 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Derivatives:
    """Gradient and negative Hessian of each pair's log-likelihood, all float64 (…, C)."""

    d: Array
    t: Array
    dd: Array
    dt: Array
    tt: Array


@dataclass(frozen=True)
class TieModel:
    """A way of treating ties.

    Parameters
    ----------
    counted : function of wins, losses and ties; returns the counts that enter the likelihood
    probabilities : function of d and t; returns P(win), P(loss) and P(tie), float64 (3, …, C)
    loglik : function of d, t, wins, losses, ties; returns each pair's log-likelihood without combinatorial constants
    derivatives : function of d, t, wins, losses, ties
    parameter : name of the tie parameter t; None if there is none
    order_in_t : the order effect o enters as d + o and t + order_in_t * o
    is_canonical : is the model an exponential family in its parameters? Firth's correction needs that
    """

    counted: Callable[[Array, Array, Array], tuple[Array, Array, Array]]
    probabilities: Callable[[Array, Array], Array]
    loglik: Callable[[Array, Array, Array, Array, Array], Array]
    derivatives: Callable[[Array, Array, Array, Array, Array], Derivatives]
    parameter: str | None
    order_in_t: float
    is_canonical: bool


def _davidson_probabilities(d: Array, t: Array) -> Array:
    """Return P(win), P(loss), P(tie), float64 (3, …, C), proportional to exp(d/2), exp(-d/2), exp(t).

    Source
    ------
    Davidson (1970), with the order effect of Davidson and Beaver (1977).
    """
    win = np.exp(d / 2)
    loss = 1 / win
    tie = np.exp(t) + np.zeros_like(d)
    total = win + loss + tie
    return np.stack([win / total, loss / total, tie / total])


def _davidson_loglik(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Array:
    """Return the log-likelihood of each pair, float64 (…, C)."""
    win = np.exp(d / 2)
    total = win + 1 / win + np.exp(t)
    result: Array = (wins - losses) * d / 2 + ties * t - (wins + losses + ties) * np.log(total)
    return result


def _davidson_derivatives(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Derivatives:
    """Return the derivatives: observed less expected statistics (win - loss) / 2 and tie, and their covariance."""
    win = np.exp(d / 2)
    loss = 1 / win
    tie = np.exp(t)
    inverse = 1 / (win + loss + tie)
    n = wins + losses + ties
    mean = (win - loss) * inverse / 2
    p_tie = tie * inverse
    n_tie = n * p_tie
    return Derivatives(
        d=(wins - losses) / 2 - n * mean,
        t=ties - n_tie,
        dd=n * ((1 - p_tie) / 4 - mean * mean),
        dt=-n_tie * mean,
        tt=n_tie * (1 - p_tie),
    )


def _rao_kupper_probabilities(d: Array, t: Array) -> Array:
    """Return P(win) = logistic(d - t), P(loss) = logistic(-d - t) and P(tie), the rest, float64 (3, …, C).

    Source
    ------
    Rao and Kupper (1967).
    """
    win, loss = 1 / (1 + np.exp(t - d)), 1 / (1 + np.exp(t + d))
    return np.stack([win, loss, np.expm1(2 * t) * win * loss])


def _rao_kupper_loglik(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Array:
    """Return the log-likelihood of each pair, float64 (…, C), with P(tie) = (theta^2 - 1) P(win) P(loss)."""
    result: Array = -(wins + ties) * np.logaddexp(0, t - d) - (losses + ties) * np.logaddexp(0, t + d)
    return result + np.where(ties > 0, ties * np.log(np.maximum(np.expm1(2 * t), np.finfo(float).tiny)), 0)


def _rao_kupper_derivatives(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Derivatives:
    """Return the derivatives in d and log theta."""
    not_win, not_loss = 1 / (1 + np.exp(d - t)), 1 / (1 + np.exp(-d - t))
    decay = np.exp(-2 * t)
    first = (wins + ties) * not_win
    second = (losses + ties) * not_loss
    first_curve, second_curve = first * (1 - not_win), second * (1 - not_loss)
    return Derivatives(
        d=first - second,
        t=ties * 2 / (1 - decay) - first - second,
        dd=first_curve + second_curve,
        dt=second_curve - first_curve,
        tt=first_curve + second_curve + ties * 4 * decay / (1 - decay) ** 2,
    )


def _binomial_probabilities(d: Array, t: Array) -> Array:  # noqa: ARG001 (one signature for all models)
    """Return P(win) = logistic(d), P(loss), and 0 for ties, float64 (3, …, C).

    Source
    ------
    Bradley and Terry (1952).
    """
    win, loss = 1 / (1 + np.exp(-d)), 1 / (1 + np.exp(d))  # 1 - win is 0 beyond 37 log-odds
    return np.stack([win, loss, np.zeros_like(win)])


def _binomial_loglik(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Array:  # noqa: ARG001
    """Return the log-likelihood of each pair, float64 (…, C); ties do not enter."""
    result: Array = -wins * np.logaddexp(0, -d) - losses * np.logaddexp(0, d)
    return result


def _binomial_derivatives(d: Array, t: Array, wins: Array, losses: Array, ties: Array) -> Derivatives:  # noqa: ARG001
    """Return the derivatives in d; those in t are zero."""
    odds = np.exp(-d)
    win = 1 / (1 + odds)
    loss = odds * win  # not 1 - win, which rounds a rare loss among many votes
    nothing = np.zeros_like(win)
    slope, curve = wins * loss - losses * win, (wins + losses) * win * loss
    return Derivatives(d=slope, t=nothing, dd=curve, dt=nothing, tt=nothing)


def _as_they_are(wins: Array, losses: Array, ties: Array) -> tuple[Array, Array, Array]:
    return wins, losses, ties


def _half_each(wins: Array, losses: Array, ties: Array) -> tuple[Array, Array, Array]:
    return wins + ties / 2, losses + ties / 2, np.zeros_like(ties)


def _dropped(wins: Array, losses: Array, ties: Array) -> tuple[Array, Array, Array]:
    return wins, losses, np.zeros_like(ties)


TIE_MODELS = {
    "davidson": TieModel(
        _as_they_are,
        _davidson_probabilities,
        _davidson_loglik,
        _davidson_derivatives,
        "log_nu",
        -0.5,
        is_canonical=True,
    ),
    "rao-kupper": TieModel(
        _as_they_are,
        _rao_kupper_probabilities,
        _rao_kupper_loglik,
        _rao_kupper_derivatives,
        "log_theta",
        0.0,
        is_canonical=False,
    ),
    "half": TieModel(
        _half_each, _binomial_probabilities, _binomial_loglik, _binomial_derivatives, None, 0.0, is_canonical=True
    ),
    "drop": TieModel(
        _dropped, _binomial_probabilities, _binomial_loglik, _binomial_derivatives, None, 0.0, is_canonical=True
    ),
}
# Without ties in the data, every model has its maximum where ties are impossible, and equals this one.
WITHOUT_TIES = TIE_MODELS["drop"]

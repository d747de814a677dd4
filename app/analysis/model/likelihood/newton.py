"""Maximise the likelihood of paired comparisons by Newton's method: one table of counts, or thousands on the same pairs
together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, hstack

from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.model.likelihood.ties import Derivatives, TieModel

Array = NDArray[np.float64]

MAX_ITERATIONS = 100
LARGEST_STEP = 3.0  # log-odds of any pair; keeps the exponentials finite while far from the maximum
OVERSHOT = 0.9  # share of the old slope that a step may leave behind the maximum before it is halved
IN_CACHE = 100_000  # pairs times tables computed together: a few arrays of this size stay in the cache


@dataclass(frozen=True)
class Design:
    """Linear map from the parameters to the two numbers d and t of each pair.

    The parameters are: scores of the items (or effects of the factors), then the order effect, then the tie
    parameter, each if present.

    Parameters
    ----------
    counts : PairCounts, the pairs; their counts are not used
    model : TieModel
    has_tie : False where the data have no tie: the tie parameter is then at its limit and is left out
    levels : float64 (n, q), makes the items' scores `levels @ effects`; without it, every item has a score and scores
        sum to zero
    """

    counts: PairCounts
    model: TieModel
    has_tie: bool
    levels: Array | None = None

    @property
    def n_effects(self) -> int:
        """Number of scores or of factors' effects."""
        return self.counts.n_items if self.levels is None else self.levels.shape[1]

    @property
    def has_order(self) -> bool:
        """Is there an order effect?"""
        return self.counts.is_ordered

    @property
    def n_parameters(self) -> int:
        """Number of parameters, before the sum-to-zero constraint."""
        return self.n_effects + self.has_order + self.has_tie

    @property
    def n_free(self) -> int:
        """Number of free parameters, after the sum-to-zero constraint."""
        return self.n_parameters - (self.levels is None)

    @cached_property
    def incidence(self) -> csr_array:
        """Sparse (C, n): +1 for the first item of each pair and -1 for the second."""
        n_pairs = len(self.counts.first)
        rows = np.repeat(np.arange(n_pairs), 2)
        columns = np.stack([self.counts.first, self.counts.second], axis=1).ravel()
        return csr_array((np.tile([1.0, -1.0], n_pairs), (rows, columns)), shape=(n_pairs, self.counts.n_items))

    @cached_property
    def effects(self) -> csr_array:
        """Sparse (C, P): change of d with each parameter."""
        n_pairs = len(self.counts.first)
        scores = self.incidence if self.levels is None else csr_array(self.incidence @ self.levels)
        parts = [scores, csr_array(np.ones((n_pairs, int(self.has_order)))), csr_array((n_pairs, int(self.has_tie)))]
        return csr_array(hstack(parts))

    @cached_property
    def tie_effects(self) -> csr_array:
        """Sparse (C, P): change of t with each parameter."""
        n_pairs = len(self.counts.first)
        order = csr_array(np.full((n_pairs, int(self.has_order)), self.model.order_in_t))
        parts = [csr_array((n_pairs, self.n_effects)), order, csr_array(np.ones((n_pairs, int(self.has_tie))))]
        return csr_array(hstack(parts))

    def predictors(self, theta: Array) -> tuple[Array, Array]:
        """Return d, float64 (B, C), and t, (B, C) or (B, 1), at parameters (B, P)."""
        q = self.n_effects
        scores = theta[:, :q] if self.levels is None else theta[:, :q] @ self.levels.T
        d = scores[:, self.counts.first] - scores[:, self.counts.second]
        t = theta[:, -1:] if self.has_tie else np.zeros((len(theta), 1))
        if self.has_order:
            d = d + theta[:, q : q + 1]
            t = t + self.model.order_in_t * theta[:, q : q + 1]
        return d, t

    def gradient(self, by_pair: Derivatives) -> Array:
        """Return the gradient in the parameters, float64 (B, P)."""
        scores = self._by_item(by_pair.d)
        parts = [scores if self.levels is None else scores @ self.levels]
        if self.has_order:
            parts.append((by_pair.d + self.model.order_in_t * by_pair.t).sum(axis=1, keepdims=True))
        if self.has_tie:
            parts.append(by_pair.t.sum(axis=1, keepdims=True))
        return np.concatenate(parts, axis=1)

    def information(self, by_pair: Derivatives) -> Array:
        """Return the negative Hessian in the parameters, float64 (B, P, P)."""
        q, in_t = self.n_effects, self.model.order_in_t
        n_tables = len(by_pair.dd)
        result = np.zeros((n_tables, self.n_parameters, self.n_parameters))
        scores = self._laplacian(by_pair.dd)
        result[:, :q, :q] = scores if self.levels is None else self.levels.T @ scores @ self.levels
        borders = []
        if self.has_order:
            corner = (by_pair.dd + 2 * in_t * by_pair.dt + in_t**2 * by_pair.tt).sum(axis=1)
            borders.append((by_pair.dd + in_t * by_pair.dt, corner))
        if self.has_tie:
            borders.append((by_pair.dt, by_pair.tt.sum(axis=1)))
        for column, (with_d, corner) in enumerate(borders, start=q):
            with_scores = self._by_item(with_d)
            with_scores = with_scores if self.levels is None else with_scores @ self.levels
            result[:, :q, column] = result[:, column, :q] = with_scores
            result[:, column, column] = corner
        if len(borders) == 2:
            result[:, q, q + 1] = result[:, q + 1, q] = (by_pair.dt + in_t * by_pair.tt).sum(axis=1)
        return result

    def _by_item(self, by_pair: Array) -> Array:
        """Add values of pairs (B, C) to their first items and subtract them from their second, (B, n)."""
        matrices = self._spread(by_pair)
        result: Array = matrices.sum(axis=2) - matrices.sum(axis=1)
        return result

    def _laplacian(self, by_pair: Array) -> Array:
        """Return matrices (B, n, n): minus the pairs' weights off the diagonal, rows that sum to zero."""
        n = self.counts.n_items
        matrices = self._spread(by_pair)
        result: Array = -(matrices + matrices.transpose(0, 2, 1))
        diagonal = np.arange(n)
        result[:, diagonal, diagonal] = -result.sum(axis=2)
        return result

    def _spread(self, by_pair: Array) -> Array:
        """Put values of pairs (B, C) at [first, second] of matrices (B, n, n); each ordered pair appears once."""
        n = self.counts.n_items
        matrices = np.zeros((len(by_pair), n, n))
        matrices[:, self.counts.first, self.counts.second] = by_pair
        return matrices

    def regular(self, information: Array) -> Array:
        """Return the information (B, P, P) made invertible by a weight on the common shift of all scores.

        The shift changes no probability, and Newton steps, whose scores sum to zero, do not depend on the weight.
        """
        if self.levels is not None:
            return information
        n = self.n_effects
        weight = np.trace(information[:, :n, :n], axis1=1, axis2=2) / n**2
        result = information.copy()
        result[:, :n, :n] += weight[:, None, None]
        return result

    def log_determinant(self, information: Array) -> float:
        """Return the logarithm of the determinant of the information (P, P), without the common shift of the scores."""
        regular = self.regular(information[None])[0]
        logarithm = float(np.linalg.slogdet(regular)[1])
        if self.levels is not None:
            return logarithm
        return logarithm - float(np.log(np.trace(information[: self.n_effects, : self.n_effects]) / self.n_effects))

    def covariance(self, information: Array) -> Array:
        """Return the inverse of the information, float64 (P, P), under the constraint that the scores sum to zero."""
        regular = self.regular(information[None])[0]
        inverse: Array = np.linalg.inv(regular)
        if self.levels is None:
            n = self.n_effects
            weight = np.trace(information[:n, :n]) / n**2
            inverse[:n, :n] -= 1 / (weight * n**2)
        return (inverse + inverse.T) / 2


@dataclass(frozen=True)
class Search:
    """Settings of the search for a maximum.

    Parameters
    ----------
    tolerance : largest change of a parameter in the last step; the remaining error is of the order of its square
    runaway : tables with a parameter beyond this are abandoned
    ridge : penalty ridge / 2 * sum of squared parameters, which makes a maximum exist where there is none
    """

    tolerance: float = 1e-8
    runaway: float = np.inf
    ridge: float = 0.0


@dataclass(frozen=True)
class Maximum:
    """Where Newton's method stopped.

    Parameters
    ----------
    theta : float64 (B, P), log-odds
    converged : bool (B,)
    iterations : of the slowest table
    """

    theta: Array
    converged: NDArray[np.bool_]
    iterations: int


def maximise(
    design: Design,
    wins: Array,
    losses: Array,
    ties: Array,
    *,
    start: Array | None = None,
    search: Search | None = None,
) -> Maximum:
    """Maximise the likelihood of each table.

    Parameters
    ----------
    design : Design of the pairs
    wins, losses, ties : float32 or float64 (B, C), votes after `TieModel.counted`
    start : float64 (P,) or (B, P), start parameters; by default equal scores and the overall share of ties
    search : tolerance, limits and penalty

    Returns
    -------
    Maximum; a table that did not converge has no finite maximum, or needs more than `MAX_ITERATIONS`; it is marked, not
    dropped
    """
    start = start_parameters(design, wins, losses, ties) if start is None else start
    starts = np.broadcast_to(start, (len(wins), design.n_parameters))
    size = max(1, IN_CACHE // max(1, wins.shape[1]))
    parts = []
    for first in range(0, len(wins), size):
        some_wins, some_losses, some_ties = (
            part[first : first + size].astype(np.float64) for part in (wins, losses, ties)
        )
        some_starts = starts[first : first + size]
        parts.append(_maximise_together(design, some_wins, some_losses, some_ties, some_starts, search or Search()))
    return Maximum(
        np.concatenate([part.theta for part in parts]),
        np.concatenate([part.converged for part in parts]),
        max(part.iterations for part in parts),
    )


def _maximise_together(
    design: Design, wins: Array, losses: Array, ties: Array, starts: Array, search: Search
) -> Maximum:
    """Take Newton steps on all tables together until each has converged or is abandoned."""
    n_tables = len(wins)
    theta = starts.copy()
    result, converged = theta.copy(), np.zeros(n_tables, bool)
    active = np.arange(n_tables)
    step, slope = np.zeros_like(theta), np.zeros(n_tables)
    penalty = np.full(design.n_parameters, search.ridge)
    iteration = 0
    while len(active) and iteration < MAX_ITERATIONS:
        iteration += 1
        by_pair = design.model.derivatives(*design.predictors(theta), wins, losses, ties)
        gradient = design.gradient(by_pair) - penalty * theta
        information = design.information(by_pair) + np.diag(penalty)
        newton = solve(design.regular(information), gradient)
        is_lost = np.logical_not(np.isfinite(newton).all(axis=1))  # it ran away until no vote could tell the next step
        newton = shorten(design, theta, np.where(is_lost[:, None], 0.0, newton))
        overshot = np.einsum("bp,bp->b", gradient, step) < -OVERSHOT * slope
        overshot &= np.abs(step).max(axis=1) >= search.tolerance  # smaller ones are rounding, at the maximum
        newton_slope = np.einsum("bp,bp->b", gradient, newton)
        theta = theta + np.where(overshot[:, None], -step / 2, newton)
        step = np.where(overshot[:, None], step / 2, newton)
        slope = np.where(overshot, slope / 2, newton_slope)
        done = ~overshot & ~is_lost & (np.abs(newton).max(axis=1) < search.tolerance)
        result[active] = theta
        converged[active] = done
        done |= is_lost | (np.abs(theta).max(axis=1) > search.runaway)
        if done.sum() > len(active) / 2 or (search.runaway < np.inf and done.any()):
            keep = ~done
            active, theta, step, slope = active[keep], theta[keep], step[keep], slope[keep]
            wins, losses, ties = wins[keep], losses[keep], ties[keep]
    return Maximum(result, converged, iteration)


def start_parameters(design: Design, wins: Array, losses: Array, ties: Array) -> Array:
    """Return equal scores and the tie parameter of the overall share of ties, float64 (P,).

    Parameters
    ----------
    design : Design of the pairs
    wins, losses, ties : float64 (…, C), votes
    """
    theta = np.zeros(design.n_parameters)
    if design.has_tie:
        share = np.clip(ties.sum() / (wins + losses + ties).sum(), 0.01, 0.95)
        theta[-1] = {"log_nu": np.log(2 * share / (1 - share)), "log_theta": np.log((1 + share) / (1 - share))}[
            str(design.model.parameter)
        ]
    return theta


def shorten(design: Design, theta: Array, newton: Array) -> Array:
    """Shorten steps that change a pair too much, and steps that would make a tie threshold negative.

    Parameters
    ----------
    design : Design of the pairs
    theta : float64 (B, P), where the steps start
    newton : float64 (B, P), the steps
    """
    longest = np.abs(newton).max(axis=1)
    if (longest > LARGEST_STEP).any():
        d, t = design.predictors(newton)
        longest = np.maximum(np.abs(d).max(axis=1), np.abs(t).max(axis=1))
    factor = np.minimum(1.0, LARGEST_STEP / np.maximum(longest, LARGEST_STEP))
    if design.has_tie and design.model.parameter == "log_theta":
        down = np.minimum(newton[:, -1] * factor, 0)
        factor *= np.minimum(1.0, 0.9 * theta[:, -1] / np.maximum(-down, 0.9 * theta[:, -1]))
    result: Array = newton * factor[:, None]
    return result


def solve(matrices: Array, right: Array) -> Array:
    """Solve symmetric positive definite systems, float64 (B, P, P) and (B, P) to (B, P); NaN where one is singular."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0], np.float64)
    except np.linalg.LinAlgError:
        if len(right) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([solve(matrices[i : i + 1], right[i : i + 1]) for i in range(len(right))])

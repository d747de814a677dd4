"""Fit hundreds or thousands of items: Newton's method, each step solved by conjugate gradients instead of matrices."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg

from app.analysis.model.likelihood.newton import MAX_ITERATIONS, Design, Maximum, Search, shorten, start_parameters
from app.analysis.model.likelihood.ties import Derivatives

Array = NDArray[np.float64]

CG_TOLERANCE = 1e-5  # relative norm of the residual; Newton's method then still gains five digits a step
CG_ROUNDING = 1e-13  # log-odds; a residual that would change the scores by less is rounding
CG_STEPS = 2  # times the number of parameters; exact arithmetic would need one


def maximise_many_items(design: Design, wins: Array, losses: Array, ties: Array, *, ridge: float = 0.0) -> Maximum:
    """Maximise the likelihood of one table of many items by Newton steps solved with conjugate gradients.

    A step costs a few operations per pair and nothing that grows with the square of the number of items. Ten
    thousand items fit easily unless nearly all their pairs were compared.

    Parameters
    ----------
    design : Design without levels and without an order effect
    wins, losses, ties : float64 (C,), votes
    ridge : penalty ridge / 2 * sum of squared parameters
    """
    n, first, second = design.counts.n_items, design.counts.first, design.counts.second
    theta = np.r_[_start_scores(design, wins, losses, ties), start_parameters(design, wins, losses, ties)[n:]]
    table = wins[None], losses[None], ties[None]
    weights = csr_array((np.zeros(len(first)), (first, second)), shape=(n, n))
    place = np.argsort(first * n + second)  # csr order
    for iteration in range(1, MAX_ITERATIONS + 1):
        by_pair = design.model.derivatives(*design.predictors(theta[None]), *table)
        by_pair = Derivatives(*(getattr(by_pair, part.name)[0] for part in fields(by_pair)))
        weights.data[:] = by_pair.dd[place]
        step = _conjugate_gradients(design, by_pair, weights, theta, ridge)
        step = shorten(design, theta[None], step[None])[0]
        theta = theta + step
        if np.abs(step).max() < Search.tolerance:
            return Maximum(theta[None], np.array([True]), iteration)
    return Maximum(theta[None], np.array([False]), MAX_ITERATIONS)


def _start_scores(design: Design, wins: Array, losses: Array, ties: Array) -> Array:
    """Return the log-odds of each item's share of won votes, with half a vote added to both sides."""
    n, first, second = design.counts.n_items, design.counts.first, design.counts.second
    won = np.bincount(first, wins + ties / 2, n) + np.bincount(second, losses + ties / 2, n)
    lost = np.bincount(first, losses + ties / 2, n) + np.bincount(second, wins + ties / 2, n)
    scores = np.log((won + 0.5) / (lost + 0.5))
    return np.asarray(scores - scores.mean())


def _conjugate_gradients(design: Design, by_pair: Derivatives, weights: csr_array, theta: Array, ridge: float) -> Array:
    """Return information^-1 gradient (P,) of a table, by conjugate gradients preconditioned with the diagonal.

    A common shift of all scores is in the null space of both sides, so the scores keep their sum of zero.
    """
    n, first, second = design.counts.n_items, design.counts.first, design.counts.second
    ties = design.has_tie

    def by_item(values: Array) -> Array:
        return np.asarray(np.bincount(first, values, n) - np.bincount(second, values, n), np.float64)

    degree = np.bincount(first, by_pair.dd, n) + np.bincount(second, by_pair.dd, n) + ridge
    border = by_item(by_pair.dt) if ties else np.zeros(0)
    corner = by_pair.tt.sum() + ridge
    transposed = weights.T

    def times(x: Array) -> Array:
        product = degree * x[:n] - weights @ x[:n] - transposed @ x[:n]
        return np.r_[product + border * x[n], border @ x[:n] + corner * x[n]] if ties else np.asarray(product)

    residual = np.r_[by_item(by_pair.d), by_pair.t.sum()] if ties else by_item(by_pair.d)
    scale = np.r_[degree, corner] if ties else degree
    residual = residual - ridge * theta
    residual[:n] -= residual[:n].mean()  # rounding, which later steps could not remove
    root = np.sqrt(
        scale
    )  # a system of the diagonal 1: the preconditioner, so that the limits below hold for every item
    scaled = LinearOperator((len(root), len(root)), matvec=lambda y: times(y / root) / root, dtype=np.float64)
    enough = float(np.linalg.norm(root)) * CG_ROUNDING
    y, _ = cg(scaled, residual / root, rtol=CG_TOLERANCE, atol=enough, maxiter=CG_STEPS * len(root))
    x: Array = y / root
    x[:n] -= x[:n].mean()
    return x

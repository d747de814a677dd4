"""Normals and curvatures of a cloud from quadrics that are fitted to the nearest points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CHUNK = 50_000  # neighbourhoods that are fitted at once, to bound the memory
LINE = 1e-6  # width over length of points on a line; float32 coordinates resolve no less
SINGULAR = 1e-12  # of the largest; a smaller diagonal element of R means that the points fix no quadric


def fit_quadrics(
    points: NDArray[np.float32], rows: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit z = p20 x^2 + p11 x y + p10 x + p02 y^2 + p01 y + p00 to neighbourhoods.

    Parameters
    ----------
    points : float32 (N, 3)
    rows : integer (M, K), the points of each neighbourhood, the first of which is its origin; K at least 6

    Returns
    -------
    normals : float64 (M, 3), of unit length, of either sign; NaN where the points fix no quadric
    curvatures : float64 (M,), one over the unit of length; NaN likewise

    Convention
    ----------
    The axes are the eigenvectors of the neighbours' covariance by falling eigenvalue, each turned so that its entry of
    largest magnitude is positive. The curvature is that of PointSSIM's scripts,
    ((1 + p10^2) p20 + (1 + p01^2) p02 - 4 p20 p02 p11) / (1 + p10^2 + p01^2)^1.5, which is not the mean curvature: it
    depends on the signs of the axes.
    """
    normals, curvatures = np.empty((len(rows), 3)), np.empty(len(rows))
    for first in range(0, len(rows), CHUNK):
        chunk = slice(first, first + CHUNK)
        normals[chunk], curvatures[chunk] = _fitted(points[rows[chunk]].astype(np.float64))
    return normals, curvatures


def _fitted(neighbours: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return normals (M, 3) and curvatures (M,) of neighbourhoods (M, K, 3)."""
    axes = principal_axes(neighbours)
    local = (neighbours - neighbours[:, :1]) @ axes  # (M, K, 3)
    p20, p11, p10, p02, p01 = _coefficients(local).T
    slope = 1 + p10**2 + p01**2
    curvatures = ((1 + p10**2) * p20 + (1 + p01**2) * p02 - 4 * p20 * p02 * p11) / slope**1.5
    normals = np.stack([-p10, -p01, np.ones(len(slope))], axis=1) / np.sqrt(slope)[:, None]
    return np.einsum("mij,mj->mi", axes, normals), curvatures


def principal_axes(neighbours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the principal axes (M, 3, 3) of neighbourhoods (M, K, 3), as columns by falling variance.

    The entry of largest magnitude of each is positive.
    """
    centred = neighbours - neighbours.mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(centred.transpose(0, 2, 1) @ centred / neighbours.shape[1])[1][:, :, ::-1]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1, keepdims=True), axis=1)
    return np.asarray(axes * np.sign(largest))


def _coefficients(local: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients (M, 5) of x^2, xy, x, y^2 and y; NaN where points (M, K, 3) fix none."""
    x, y, z = np.moveaxis(local, 2, 0)  # (M, K) each
    scales = [values.std(axis=1, ddof=1) for values in (x, y)]
    a, b = (np.where(scale > 0, scale, 1.0) for scale in scales)
    u, v = x / a[:, None], y / b[:, None]
    q, r = np.linalg.qr(np.stack([u * u, u * v, u, v * v, v, np.ones_like(u)], axis=2))
    diagonal = np.abs(np.diagonal(r, axis1=1, axis2=2))
    is_singular = scales[1] <= LINE * scales[0]
    is_singular |= diagonal.min(axis=1) < SINGULAR * diagonal.max(axis=1)
    r[is_singular] = np.eye(6)
    solved = np.linalg.solve(r, q.transpose(0, 2, 1) @ z[..., None])[..., 0]  # (M, 6)
    solved[is_singular] = np.nan
    return np.asarray(solved[:, :5] / np.stack([a * a, a * b, a, b * b, b], axis=1))

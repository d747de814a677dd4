"""Find an error for each score alone, from which the error of every difference follows: quasi-variances.

The error of a score depends on what scores are measured against, here their mean. A quasi-variance does not: the
variance of a difference is nearly the sum of two of them, as if the scores were independent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import MOST_ITEMS, Estimates

Array = NDArray[np.float64]

FEWEST = 3  # estimates; two leave their quasi-variances open
MOST_STEPS, TOLERANCE = 100, 1e-12  # of Gauss and Newton's method


def quasi_variances(covariance: Array) -> tuple[Array, float] | None:
    """Return the quasi-variances of estimates, and the largest relative error of a difference's standard error.

    They make the sum of squares of log(q_i + q_j) - log(variance of the difference) smallest over all pairs. One of
    them may be negative. None where a difference has no variance.

    Parameters
    ----------
    covariance : float64 (K, K), of at least three estimates

    Source
    ------
    Firth and de Menezes (2004), Biometrika 91, 65-80.
    """
    n = len(covariance)
    first, second = np.triu_indices(n, 1)
    wanted = np.diag(covariance)[first] + np.diag(covariance)[second] - 2 * covariance[first, second]
    if n < FEWEST or (wanted <= 0).any():
        return None
    pairs = np.eye(n)[first] + np.eye(n)[second]
    quasi = np.full(n, wanted.mean() / 2)
    for _ in range(MOST_STEPS):
        sums = pairs @ quasi
        step = np.linalg.lstsq(pairs / sums[:, None], np.log(wanted / sums), rcond=None)[0]
        while (pairs @ (quasi + step) <= 0).any():
            step /= 2
        quasi = quasi + step
        if np.abs(step).max() < TOLERANCE * wanted.mean():
            break
    errors = np.sqrt(pairs @ quasi / wanted) - 1
    return quasi, float(np.abs(errors).max())


def quasi_errors(estimates: Estimates) -> tuple[Array, float] | None:
    """Return the quasi standard error of each estimate, NaN where its quasi-variance is negative, and the largest
    relative error of what they say; clustered by participant where participants are known.

    None where there are none, or too many estimates.
    """
    n, clustered = len(estimates.names), estimates.participant_covariance
    if not FEWEST <= n <= MOST_ITEMS or (clustered is None and estimates.n_participants is not None):
        return None
    known = quasi_variances((estimates.covariance if clustered is None else clustered)[:n, :n])
    if known is None:
        return None
    quasi, error = known
    return np.sqrt(np.where(quasi > 0, quasi, np.nan)), error

"""Ask whether a measure tells pairs apart as the votes do: which pairs differ, and which of the two is better.

The votes decide which pairs of a dataset differ significantly; the others count as similar.

Source
------
Krasula, Fliegel, Le Callet and Klima (2016), "On the accuracy of objective image and video quality models: new
methodology for performance evaluation". Their tests take pairs as independent, which pairs with a condition in common
are not; `permutation` tests instead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from app.analysis.objective.points import Indices, without_noise

Array = NDArray[np.float64]


def better_worse(differences: Array) -> Array:
    """Return the area under the curve that tells pairs in order from pairs in reverse.

    Every pair appears twice, as better minus worse and as worse minus better; the area is the share of all couples of
    the first and the second kind in which the first has the larger difference of the measure.

    Parameters
    ----------
    differences : float64 (P, M), the measure of the better item less that of the worse, in the direction that should
        be better

    Returns
    -------
    float64 (P,), 1/2 for a measure without information
    """
    # The couples of i <= j whose sum is positive are counted by Wilcoxon's signed ranks; ties count half.
    ranks = rankdata(np.abs(differences), axis=1)
    is_right = _right(differences)
    couples = 2 * np.sum(ranks * is_right, axis=1) - np.sum(is_right, axis=1)
    return np.asarray(couples / differences.shape[1] ** 2)


def different_similar(different: Array, similar: Array) -> Array:
    """Return the area under the curve that tells different pairs from similar ones by the size of the difference.

    Parameters
    ----------
    different : float64 (P, M), differences of the measure of pairs that differ
    similar : float64 (P, S), of those that do not

    Returns
    -------
    float64 (P,), 1/2 for a measure without information
    """
    n, m = different.shape[1], similar.shape[1]
    ranks = rankdata(np.abs(np.concatenate([different, similar], axis=1)), axis=1)
    return np.asarray((ranks[:, :n].sum(axis=1) - n * (n + 1) / 2) / (n * m))  # Mann and Whitney (1947)


def share_in_order(differences: Array) -> Array:
    """Return the share of pairs in the right order; an equal pair counts half.

    Parameters
    ----------
    differences : float64 (P, M), as in `better_worse`

    Returns
    -------
    float64 (P,)
    """
    return np.asarray(_right(differences).mean(axis=1))


def pair_differences(values: Array, pairs: Indices) -> Array:
    """Return the first minus the second of each pair, float64 (P, M), of values (P, N) and pairs (M, 2)."""
    return without_noise(values[:, pairs[:, 0]] - values[:, pairs[:, 1]], values)


def _right(differences: Array) -> Array:
    return (np.sign(differences) + 1) / 2

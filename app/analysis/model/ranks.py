"""Say how probable it is that each condition is the best, and which ranks the tests of pairs leave it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import MOST_ITEMS, SIGNIFICANT, Contrast, Estimates, drawn_errors

Array = NDArray[np.float64]


def best_probabilities(estimates: Estimates) -> Array | None:
    """Return the probability of each estimate to be the highest, float64 (K,), to about 0.8 %.

    It is that of the true scores given the votes, if all scores were as likely before: the share of random vectors
    around the estimates (fixed seed) in which it is the highest. With few participants the larger of both errors
    counts. None with too many estimates, or where participants are known but their variation is not.
    """
    n, clustered = len(estimates.names), estimates.participant_covariance
    if not 1 < n <= MOST_ITEMS or (clustered is None and estimates.n_participants is not None):
        return None
    naive = estimates.covariance[:n, :n]
    covariance = naive if clustered is None else clustered[:n, :n]
    if estimates.is_few and np.trace(naive) > np.trace(covariance):
        covariance = naive
    drawn = estimates.values + drawn_errors(estimates, covariance)
    return np.bincount(drawn.argmax(axis=1), minlength=n) / len(drawn)


def rank_intervals(items: Sequence[str], contrasts: Sequence[Contrast]) -> dict[str, tuple[int, int]]:
    """Return the first and the last rank that each item may have, all intervals together with 95 % confidence.

    An item comes after all that are significantly better, and before all that are significantly worse.

    Parameters
    ----------
    items : their names
    contrasts : of all pairs, corrected for their number; none: nothing is known

    Source
    ------
    Al Mohamad, Goeman and van Zwet (2022), from simultaneous tests of pairs.
    """
    if not contrasts:
        return {}
    better, worse = dict.fromkeys(items, 0), dict.fromkeys(items, 0)
    for row in contrasts:
        if row.p_holm < SIGNIFICANT:
            above, below = (row.item_a, row.item_b) if row.difference > 0 else (row.item_b, row.item_a)
            better[below] += 1
            worse[above] += 1
    return {item: (1 + better[item], len(items) - worse[item]) for item in items}

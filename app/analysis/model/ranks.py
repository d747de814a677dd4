"""Say how probable it is that each condition is the best, and which ranks the tests of pairs leave it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import DRAWN, MOST_ITEMS, SIGNIFICANT, Contrast, Estimates, half_widths

Array = NDArray[np.float64]

WIDEST, N_SPREADS = 3.0, 60  # log-odds, standard deviations of true scores that are tried
N_SCALES = 500  # errors that the number of participants leaves likely


def best_probabilities(estimates: Estimates) -> Array | None:
    """Return the probability of each estimate to be the highest, float64 (K,), to about 0.8 %.

    True scores are taken to be drawn from a normal distribution, of whose spread nothing is known before but what the
    votes tell (uniform up to `WIDEST`): where they tell little, differences are likely to be smaller than they look. It
    is the share of random vectors of what is likely then (fixed seed) in which an estimate is the highest. With few
    participants the larger of both errors counts. None with too many estimates, or where participants are known but
    their variation, or that of one estimate, is not.

    Source
    ------
    Normal distributions within a normal distribution: Gelman (2006), on the uniform prior of its spread.
    """
    n, clustered, n_people = len(estimates.names), estimates.participant_covariance, estimates.n_participants
    half = half_widths(estimates)
    if not 1 < n <= MOST_ITEMS or half is None or np.isnan(half).any():
        return None
    naive = estimates.covariance[:n, :n]
    covariance = naive if clustered is None else clustered[:n, :n]
    if estimates.is_few and np.trace(naive) > np.trace(covariance):
        covariance = naive
    centre = np.eye(n) - 1 / n
    variances, vectors = (part[..., 1:] for part in np.linalg.eigh(centre @ covariance @ centre))  # one is zero
    along = estimates.values @ vectors
    rng = np.random.default_rng(n)
    scale = np.ones(N_SCALES) if n_people is None else (n_people - 1) / rng.chisquare(n_people - 1, N_SCALES)
    error = scale[:, None] * np.maximum(variances, 1e-12)  # (N_SCALES, n - 1)
    spreads = np.arange(0.5, N_SPREADS) * WIDEST / N_SPREADS
    total = spreads[:, None, None] ** 2 + error  # (N_SPREADS, N_SCALES, n - 1)
    logliks = -0.5 * (np.log(total) + along**2 / total).sum(axis=2)
    chances = np.cumsum(np.exp(logliks - logliks.max(axis=0)), axis=0)
    error, chances = np.tile(error, (DRAWN // N_SCALES, 1)), np.tile(chances, DRAWN // N_SCALES)
    spread = spreads[(rng.random(DRAWN) * chances[-1] > chances).sum(axis=0)][:, None]
    kept = spread**2 / (spread**2 + error)
    drawn = along * kept + np.sqrt(kept * error) * rng.standard_normal(error.shape)
    return np.bincount((drawn @ vectors.T).argmax(axis=1), minlength=n) / DRAWN


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

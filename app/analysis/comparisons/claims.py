"""Find how often each claim that a report can make would be made, in simulated studies.

Hundreds of studies are simulated and analysed in one batch, so the power of a claim takes about a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from app.analysis.comparisons.datasets_sample import FEWEST_DATASETS
from app.analysis.comparisons.study_plan import PlannedStudy, Studies
from app.analysis.model.contrasts import SIGNIFICANT
from app.study.planning import MEASURE_CORRELATION, Claim

Array = NDArray[np.float64]

TOGETHER = 1_500_000  # trials simulated at once


def holm_together(p_values: Array) -> Array:
    """Return p-values (R, K) corrected over each row by Holm's method."""
    order = np.argsort(p_values, axis=1)
    factors = np.arange(p_values.shape[1], 0, -1)
    stepped = np.maximum.accumulate(np.take_along_axis(p_values, order, 1) * factors, axis=1)
    result = np.empty_like(p_values)
    np.put_along_axis(result, order, np.minimum(stepped, 1.0), 1)
    return result


def pair_directions(n: int) -> Array:
    """Return the contrast of every pair of n conditions, float64 (n (n - 1) / 2, n)."""
    low, high = np.triu_indices(n, 1)
    return np.eye(n)[low] - np.eye(n)[high]


def _two_apart(n: int, effect: float) -> Array:
    """Return scores of which the first two differ, and the others lie halfway."""
    return np.asarray(np.r_[effect / 2, -effect / 2, np.zeros(n - 2)])


def _one_above(n: int, effect: float) -> Array:
    return np.asarray(np.r_[effect, np.zeros(n - 1)])


def _two_halves(n: int, effect: float) -> Array:
    return np.where(np.arange(n) < n // 2, effect / 2, -effect / 2)


def _evenly(n: int, effect: float) -> Array:
    return np.linspace(effect / 2, -effect / 2, n)


def _told_apart(studies: Studies, _rng: np.random.Generator) -> NDArray[np.bool_]:
    """Is the first pair told apart, as the report tells pairs apart: all pairs, Holm?"""
    return holm_together(studies.p_values(pair_directions(studies.scores.shape[1])))[:, 0] < SIGNIFICANT


def _pair(studies: Studies, _rng: np.random.Generator) -> NDArray[np.bool_]:
    return studies.p_values(pair_directions(studies.scores.shape[1])[:1])[:, 0] < SIGNIFICANT


def _best(studies: Studies, _rng: np.random.Generator) -> NDArray[np.bool_]:
    pairs = pair_directions(studies.scores.shape[1])
    corrected = holm_together(studies.p_values(pairs))
    is_above = (studies.scores[:, :1] > studies.scores[:, 1:]).all(axis=1)
    return np.asarray((corrected[:, pairs[:, 0] != 0] < SIGNIFICANT).all(axis=1) & is_above)


def _factor(studies: Studies, _rng: np.random.Generator) -> NDArray[np.bool_]:
    n = studies.scores.shape[1]
    half = np.where(np.arange(n) < n // 2, 1 / (n // 2), -1 / (n - n // 2))[None]
    return np.asarray((studies.p_values(half)[:, 0] < SIGNIFICANT) & studies.has_scores)


def _measure(studies: Studies, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Is the correlation of a measure with the scores shown?"""
    n_studies, n = studies.scores.shape
    if n < 3:
        return np.zeros(n_studies, bool)
    truth = _evenly(n, 1.0) / _evenly(n, 1.0).std()
    noise = rng.standard_normal((n_studies, n)) * np.sqrt(1 - MEASURE_CORRELATION**2)
    measured = MEASURE_CORRELATION * truth + noise
    measured -= measured.mean(axis=1, keepdims=True)
    scores = studies.scores - studies.scores.mean(axis=1, keepdims=True)
    size = np.sqrt((measured**2).sum(axis=1) * (scores**2).sum(axis=1))
    r = np.divide((measured * scores).sum(axis=1), size, out=np.zeros_like(size), where=size > 0)  # all scores equal: 0
    p_value = 2 * student.sf(np.abs(r) * np.sqrt((n - 2) / np.maximum(1 - r**2, 1e-12)), n - 2)
    return np.asarray(p_value < SIGNIFICANT)


def _over_datasets(studies: Studies, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Is a pair fixed before told apart for datasets like these, datasets being a sample?"""
    return np.asarray((studies.p_over_datasets() < SIGNIFICANT) & _pair(studies, rng))


Made = Callable[[Studies, np.random.Generator], NDArray[np.bool_]]
MADE: Mapping[Claim, tuple[Callable[[int, float], Array], Made]] = {  # the true scores, and in which studies it is made
    "told apart": (_two_apart, _told_apart),
    "pair": (_two_apart, _pair),
    "best": (_one_above, _best),
    "factor": (_two_halves, _factor),
    "measure": (_evenly, _measure),
    "datasets": (_two_apart, _over_datasets),
}


def is_untested(plan: PlannedStudy, claim: Claim) -> bool:
    """Is a claim never made of a study, whose datasets are too few for its test?"""
    return claim == "datasets" and plan.datasets < FEWEST_DATASETS


def claim_power(plan: PlannedStudy, claim: Claim, effect: float, seed: int, replicates: int) -> float:
    """Return the share of simulated studies in which a claim is made.

    Parameters
    ----------
    plan : the study
    claim : key of `CLAIMS`
    effect : what is true, JOD or grades: the difference of the two conditions, of the best from the others, of the
        factor's levels, or of the ends of evenly spaced conditions
    seed : for the simulated studies
    replicates : simulated studies
    """
    scores_of, is_made = MADE[claim]
    if is_untested(plan, claim):
        return 0.0
    rng = np.random.default_rng(seed)
    size = max(1, TOGETHER // (plan.participants * plan.datasets * plan.trials))
    made = 0
    for start in range(0, replicates, size):
        scores = scores_of(plan.conditions, effect * plan.unit)
        made += int(is_made(plan.simulated(scores, min(size, replicates - start), rng), rng).sum())
    return made / replicates

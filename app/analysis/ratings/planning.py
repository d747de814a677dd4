"""Plan the number of participants who rate: power and detectable differences of mean opinion scores."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import ncf, t

from app.analysis.comparisons.power import WANTED_POWER, StudySize
from app.analysis.model.contrasts import SIGNIFICANT


@dataclass(frozen=True)
class RatingPlan(StudySize):
    """A study in which every participant rates every condition on every dataset once.

    A hidden reference is a condition, too.

    Parameters
    ----------
    inconsistency : standard deviation of a participant's ratings around the qualities, grades
    """

    inconsistency: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.inconsistency < np.inf:
            raise ValueError(f"inconsistency is {self.inconsistency}, expected more than 0")

    @property
    def difference_se(self) -> float:
        """Standard error of the difference of two conditions' means over all datasets; biases cancel out."""
        return self.inconsistency * float(np.sqrt(2 / (self.datasets * self.participants)))


def plan_ratings(plan: RatingPlan, effect: float) -> dict[str, Any]:
    """Return the power for a difference of two conditions, and the difference detected with 80 % power.

    Parameters
    ----------
    plan : the study
    effect : true difference of two conditions, grades

    Returns
    -------
    dict, with powers and detectable differences for one dataset and over all datasets
    """
    if not 0 < effect < np.inf:
        raise ValueError(f"effect is {effect}, expected a difference above 0")
    single, n_trials = replace(plan, datasets=1), plan.conditions * plan.datasets
    return {
        "conditions": plan.conditions,
        "datasets": plan.datasets,
        "participants": plan.participants,
        "inconsistency": plan.inconsistency,
        "votes_per_participant": n_trials,
        "votes": n_trials * plan.participants,
        "effect": effect,
        "power_one_dataset": rating_power(single, effect),
        "power_pooled": rating_power(plan, effect),
        "detectable_one_dataset": detectable_difference(single),
        "detectable_pooled": detectable_difference(plan),
    }


def rating_power(plan: RatingPlan, effect: float) -> float:
    """Return the power of a paired t-test over participants, two-sided at 5 %.

    Parameters
    ----------
    plan : the study
    effect : true difference of two conditions, grades
    """
    df, shift = plan.participants - 1, effect / plan.difference_se
    limit = float(t.ppf(1 - SIGNIFICANT / 2, df))
    return float(ncf.sf(limit**2, 1, df, shift**2))  # of T squared, as the tails of scipy's nct may be NaN


def detectable_difference(plan: RatingPlan) -> float:
    """Return the difference that is detected with 80 % power, grades."""
    high = plan.difference_se
    while rating_power(plan, high) < WANTED_POWER:
        high *= 2
    return float(brentq(lambda effect: rating_power(plan, effect) - WANTED_POWER, 0.0, high, xtol=1e-4))

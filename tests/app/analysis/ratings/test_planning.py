from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ttest_rel

from app.analysis.ratings.planning import RatingPlan, detectable_difference, plan_ratings, rating_power

PLAN = RatingPlan(conditions=6, datasets=3, participants=12, inconsistency=0.8)


@pytest.mark.parametrize("effect", [0.2, 0.5])
def test_the_power_is_the_share_of_simulated_studies_that_find_the_difference(effect: float) -> None:
    rng = np.random.default_rng(5)
    shape = (4000, PLAN.participants, PLAN.datasets)
    bias = rng.normal(size=shape[:2])
    a, b = (rng.normal(scale=PLAN.inconsistency, size=shape).mean(axis=2) + bias for _ in range(2))
    share = float(np.mean(ttest_rel(a + effect, b, axis=1).pvalue < 0.05))
    assert rating_power(PLAN, effect) == pytest.approx(share, abs=0.03)


def test_the_detectable_difference_has_a_power_of_80_percent() -> None:
    assert rating_power(PLAN, detectable_difference(PLAN)) == pytest.approx(0.8, abs=0.001)


def test_a_plan_counts_ratings_and_more_datasets_find_more() -> None:
    result = plan_ratings(PLAN, 0.5)
    assert (result["votes_per_participant"], result["votes"]) == (18, 216)
    assert result["power_pooled"] > result["power_one_dataset"]
    assert result["detectable_pooled"] < result["detectable_one_dataset"]


def test_numbers_that_make_no_study_are_named() -> None:
    with pytest.raises(ValueError, match="inconsistency is 0"):
        RatingPlan(6, 3, 12, 0)
    with pytest.raises(ValueError, match="effect is -1"):
        plan_ratings(PLAN, -1)


def test_power_rises_to_one_with_the_effect_for_few_and_for_many() -> None:
    for participants in (2, 3, 5, 10, 100, 1000):
        plan = RatingPlan(2, 1, participants, 0.7)
        powers = np.array([rating_power(plan, float(effect)) for effect in np.geomspace(1e-3, 1e4, 150)])
        assert powers[0] == pytest.approx(0.05, abs=1e-3)
        assert powers[-1] == pytest.approx(1)
        assert (np.diff(powers) > -1e-9).all()
        assert rating_power(plan, detectable_difference(plan)) == pytest.approx(0.8, abs=1e-3)

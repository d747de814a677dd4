"""Planning a study of ratings by simulating it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ncf, t

from app.analysis.comparisons.claims import pair_directions
from app.analysis.comparisons.power import detectable, participants_wanted, power
from app.analysis.ratings.contrasts import rating_contrasts
from app.analysis.ratings.planning import RatingPlan, RatingStudies, plan_ratings
from app.analysis.ratings.table import RatingTable
from app.study.planning import CLAIMS, Claim

PLAN = RatingPlan(conditions=6, datasets=3, participants=12, inconsistency=0.8)


def exact_power(plan: RatingPlan, effect: float) -> float:
    """Return the power of a paired t-test over participants, from the noncentral distribution."""
    variance = 2 * (plan.spread**2 + (plan.inconsistency**2 + plan.by_dataset**2) / plan.datasets) / plan.participants
    limit = float(t.ppf(0.975, plan.participants - 1))
    return float(ncf.sf(limit**2, 1, plan.participants - 1, effect**2 / variance))


@pytest.mark.parametrize("people", [{}, {"spread": 0.4}, {"by_dataset": 0.6}])
def test_the_power_for_a_pair_is_that_of_the_paired_t_test(people: dict[str, float]) -> None:
    for effect in (0.2, 0.5):
        plan = replace(PLAN, **people)
        assert power(plan, effect, 1, 2000, claim="pair") == pytest.approx(exact_power(plan, effect), abs=0.035)


def test_the_detectable_difference_has_a_power_of_80_percent() -> None:
    found = detectable(PLAN, 1, 800, claim="pair")
    assert found is not None
    assert exact_power(PLAN, found) == pytest.approx(0.8, abs=0.05)


@pytest.mark.slow
def test_a_plan_counts_ratings_and_more_datasets_find_more() -> None:
    result = plan_ratings(PLAN, 0.5, replicates=200)
    assert (result["votes_per_participant"], result["votes"]) == (18, 216)
    assert result["power_pooled"] > result["power_one_dataset"]
    assert result["detectable_pooled"] < result["detectable_one_dataset"]
    assert result["claim"] == "told apart"
    assert {row["claim"] for row in result["claims"]} == set(CLAIMS)


@pytest.mark.parametrize("people", [{}, {"drop_out": 0.5}, {"drop_out": 0.9, "participants": 6}])
def test_simulated_ratings_have_the_p_values_of_the_analysis(people: dict[str, Any]) -> None:
    scores = np.array([0.6, 0.0, 0.2, -0.4, 0.0, 0.1])
    studies = replace(PLAN, **people).simulated(scores, 2, np.random.default_rng(3))
    assert isinstance(studies, RatingStudies)
    for ratings, of_batch in zip(studies.ratings, studies.p_values(pair_directions(6)), strict=True):
        assert [row.p_value for row in rating_contrasts(table_of(ratings))] == pytest.approx(of_batch.tolist())


def table_of(ratings: np.ndarray) -> RatingTable:
    is_there = ~np.isnan(ratings)
    person, dataset, condition = (part[is_there] for part in np.indices(ratings.shape))
    items = tuple((f"d{d}", f"c{c}") for d in range(ratings.shape[1]) for c in range(ratings.shape[2]))
    people = tuple(f"P{j:02d}" for j in range(len(ratings)))
    none = np.zeros(len(items), bool)
    item = dataset * ratings.shape[2] + condition
    return RatingTable(people, items, person, item, ratings[is_there], none, "acr", -9.0, 9.0)


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_claim_of_nothing_is_made_as_often_as_its_level_says(claim: Claim) -> None:
    assert power(replace(PLAN, datasets=5, spread=0.3), 1e-9, 3, 400, claim=claim) < 0.09


def test_who_leaves_clicks_or_differs_costs_power() -> None:
    full = power(PLAN, 0.4, 1, 400)
    for people in ({"drop_out": 0.5}, {"careless": 0.3}, {"spread": 0.8}, {"by_dataset": 1.0}):
        assert power(replace(PLAN, **people), 0.4, 1, 400) < full


def test_datasets_that_differ_cost_the_claim_over_datasets() -> None:
    alike, unlike = (replace(PLAN, datasets=5, dataset_spread=spread) for spread in (0.0, 0.5))
    assert power(unlike, 0.5, 1, 400, claim="datasets") < power(alike, 0.5, 1, 400, claim="datasets")


def test_the_participants_for_80_percent_suffice() -> None:
    wanted = participants_wanted(PLAN, 0.4, 1, 400, claim="pair")
    assert wanted is not None
    assert exact_power(replace(PLAN, participants=wanted["participants"]), 0.4) > 0.74


def test_numbers_that_make_no_study_are_named() -> None:
    with pytest.raises(ValueError, match="inconsistency is 0"):
        RatingPlan(6, 3, 12, 0)
    with pytest.raises(ValueError, match="effect is -1"):
        plan_ratings(PLAN, -1)

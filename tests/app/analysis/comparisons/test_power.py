"""Planning a study by simulating it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.analysis.comparisons.claims import claim_power, pair_directions
from app.analysis.comparisons.comparison import compare
from app.analysis.comparisons.datasets_sample import pair_p_values
from app.analysis.comparisons.power import (
    claim_rows,
    clickers_named,
    detectable,
    participants_wanted,
    plan_study,
    power,
    simulate_votes,
)
from app.analysis.comparisons.vote_studies import StudyPlan, VoteStudies, simulated_votes
from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.contrasts import contrasts
from app.analysis.model.settings import AnalysisSettings
from app.analysis.ratings.planning import RatingPlan, plan_ratings
from app.analysis.reading.votes_table import VotesTable, votes_from_indices
from app.study.planning import CLAIMS, Claim


def test_simulated_votes_have_the_abilities_and_ties_put_in() -> None:
    abilities = np.array([-0.5, 0.0, 0.5])
    votes = simulate_votes(StudyPlan(3, 4, 2000, tie_rate=0.3, spread=0.0), abilities, np.random.default_rng(1))
    fit = fit_scores(votes)
    assert fit.scores is not None
    np.testing.assert_allclose(fit.scores, abilities, atol=0.06)
    assert fit.tie_parameter == pytest.approx(np.log(2 * 0.3 / 0.7), abs=0.06)


@pytest.mark.slow
def test_power_grows_with_the_effect_and_with_people_and_keeps_its_size() -> None:
    small = StudyPlan(4, 1, 10)
    assert power(small, 1e-9, 1, 300) < 0.1
    assert power(small, 0.5, 1, 100) < power(small, 1.5, 1, 100)
    assert power(small, 0.7, 1, 100) < power(StudyPlan(4, 1, 40), 0.7, 1, 100)


def test_different_opinions_cost_power() -> None:
    assert power(StudyPlan(4, 5, 12, spread=1.0), 0.5, 1, 100) < power(StudyPlan(4, 5, 12, spread=0.0), 0.5, 1, 100)


@pytest.mark.slow
def test_a_study_of_the_papers_size_detects_what_is_known() -> None:
    """Two conditions fixed before: 0.91 JOD in one dataset and 0.43 pooled over five, for people whose errors are about
    1.4 times the naive ones.
    """
    told: list[tuple[str, int, int]] = []
    plan = plan_study(
        StudyPlan(6, 5, 22),
        np.random.default_rng(2),
        replicates=80,
        progress=lambda *each: told.append(each),
        claim="pair",
    )
    assert plan["votes"] == 1650
    assert plan["detectable_jod_one_dataset"] == pytest.approx(0.91, abs=0.15)
    assert plan["detectable_jod_pooled"] == pytest.approx(0.43, abs=0.08)
    n_studies = 80 * 11  # of the power asked for, of the largest difference, and of each halving
    assert told == [
        (f"studies of {where} simulated", done, n_studies)
        for where in ("one dataset", "all datasets")
        for done in range(n_studies + 1)
    ]


@pytest.mark.parametrize(
    "wrong", [{"conditions": 1}, {"datasets": 0}, {"participants": 1}, {"tie_rate": 1.0}, {"spread": -0.1}]
)
def test_an_impossible_plan_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        StudyPlan(**{"conditions": 6, "datasets": 5, "participants": 22, **wrong})  # type: ignore[arg-type]


@pytest.mark.slow
def test_few_people_who_agree_by_chance_are_no_finding() -> None:
    for participants in (2, 5):
        assert power(StudyPlan(2, 1, participants), 1e-9, 1, 100) <= 0.08
    assert power(StudyPlan(2, 1, 3), 1.5, 1, 100) == 0  # three of three are p = 0.25
    assert power(StudyPlan(2, 1, 30), 4.0, 1, 50) > 0.9  # thirty of thirty are a finding


@pytest.mark.slow
def test_a_plan_without_a_chance_has_no_detectable_difference() -> None:
    assert detectable(StudyPlan(2, 1, 2, tie_rate=0.5), 1, 100) is None


@pytest.mark.parametrize("effect", [0.0, -1.0, float("nan"), float("inf")])
def test_a_difference_that_is_none_is_refused(effect: float) -> None:
    for name, plan in (
        ("effect_jod", lambda: plan_study(StudyPlan(3, 1, 4), np.random.default_rng(1), effect_jod=effect)),
        ("effect", lambda: plan_ratings(RatingPlan(3, 1, 4, 0.8), effect)),
    ):
        with pytest.raises(ValueError, match=f"{name} is {effect}, expected a difference above 0"):
            plan()


def test_the_power_is_that_of_the_claim_that_the_report_makes() -> None:
    """What was called a power of .80 is .38 for two conditions told apart among 15 pairs, and .06 if people differ."""
    plan = StudyPlan(6, 5, 22)
    assert power(plan, 0.469, 1, 300, claim="pair") == pytest.approx(0.80, abs=0.07)
    assert power(plan, 0.469, 1, 300) == pytest.approx(0.38, abs=0.08)
    assert power(replace(plan, spread=1.0), 0.469, 1, 300) < 0.12


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_claim_of_nothing_is_made_as_often_as_its_level_says(claim: Claim) -> None:
    assert power(StudyPlan(6, 5, 22, dataset_spread=0.0), 1e-9, 3, 300, claim=claim) < 0.09


def as_table(study: np.ndarray) -> VotesTable:
    """The votes of a simulated study, (J, D, 3, C) of all pairs of a, b, c, …"""
    j, d, kind, pair = (part.ravel() for part in np.indices(study.shape))
    n = round((1 + np.sqrt(1 + 8 * study.shape[3])) / 2)
    cast, (low, high) = study.ravel() > 0, np.triu_indices(n, 1)
    names = tuple(map(str, range(len(study)))), tuple("wxyz"[: study.shape[1]]), tuple("abcdefghijklmno"[:n])
    return votes_from_indices(
        j[cast], d[cast], low[pair[cast]], high[pair[cast]], kind[cast].astype(np.int8), names=names
    )


def test_batches_have_the_p_values_of_the_analysis() -> None:
    plan = StudyPlan(4, 4, 14, dataset_spread=0.4)
    votes = simulated_votes(plan, np.array([0.6, 0.0, -0.2, -0.4]), 3, np.random.default_rng(1))
    together = VoteStudies(votes)
    batch = zip(votes, together.p_values(pair_directions(4)), together.p_over_datasets(), strict=True)
    for study, of_batch, over_datasets in batch:
        table = as_table(study)
        alone = [row.p_value for row in contrasts(fit_scores(table))]
        np.testing.assert_allclose(of_batch, alone, rtol=1e-6, atol=1e-12)
        sampled, _ = pair_p_values(list(compare(table, AnalysisSettings())))["a", "b"]
        assert max(over_datasets, of_batch[0]) == pytest.approx(sampled, rel=1e-6)


def test_studies_in_which_nobody_has_a_tie_have_the_p_values_of_the_analysis() -> None:
    plan = StudyPlan(3, 1, 10, tie_rate=0.05)
    simulated = simulated_votes(plan, np.array([0.4, 0.0, -0.4]), 30, np.random.default_rng(2))
    has_tie = simulated[..., 2, :].any(axis=(1, 2, 3))
    assert 0 < has_tie.sum() < 30
    p_values = VoteStudies(simulated).p_values(pair_directions(3))
    for study, of_batch in zip(simulated, p_values, strict=True):
        fit = fit_scores(as_table(study))
        if fit.status == "ok":
            assert of_batch == pytest.approx([row.p_value for row in contrasts(fit)], rel=1e-5)


def test_people_who_are_no_more_than_the_parameters_are_few_in_batches_too() -> None:
    simulated = simulated_votes(StudyPlan(14, 1, 13), np.linspace(-0.5, 0.5, 14), 1, np.random.default_rng(1))
    alone = [row.p_value for row in contrasts(fit_scores(as_table(simulated[0])))]
    assert VoteStudies(simulated).p_values(pair_directions(14))[0] == pytest.approx(alone, rel=1e-5)


def test_people_who_drop_out_or_click_cost_power() -> None:
    plan = StudyPlan(6, 5, 22)
    full = power(plan, 0.6, 1, 300)
    assert power(replace(plan, drop_out=0.5), 0.6, 1, 300) < full
    assert power(replace(plan, careless=0.3), 0.6, 1, 300) < full
    assert power(replace(plan, by_dataset=1.5), 0.6, 1, 300) < full


def test_the_number_of_participants_comes_with_the_error_of_its_simulation() -> None:
    plan = StudyPlan(4, 3, 2)
    wanted = participants_wanted(plan, 0.8, 1, 200, claim="pair")
    assert wanted is not None
    assert wanted["low"] <= wanted["participants"] <= wanted["high"]
    assert power(replace(plan, participants=wanted["participants"]), 0.8, 1, 200, claim="pair") >= 0.8
    assert participants_wanted(replace(plan, spread=8.0), 0.05, 1, 50) is None


def test_a_claim_that_so_few_datasets_never_allow_says_so() -> None:
    *_, of_two = claim_rows(StudyPlan(3, 2, 8), 1.0, 1, 20)
    *_, of_three = claim_rows(StudyPlan(3, 3, 8), 1.0, 1, 20)
    assert (of_two["power"], of_two["power_error"]) == (0, 0)
    assert of_two["what"] == f"{of_three['what']} (takes 3 datasets)"


def test_an_unknown_claim_is_refused() -> None:
    with pytest.raises(ValueError, match="claim is 'all', expected one of told apart, pair"):
        plan_study(StudyPlan(3, 1, 4), np.random.default_rng(1), claim="all")  # type: ignore[arg-type]  # what is refused


def test_a_measure_is_not_shown_by_scores_that_are_all_equal() -> None:
    """Two people and three conditions: in some simulated studies nothing differs, and no correlation is there."""
    assert claim_power(StudyPlan(3, 1, 2, spread=0.0), "measure", 0.05, 1, 200) < 0.2


@pytest.mark.slow
def test_a_plan_says_which_random_clickers_would_be_named() -> None:
    small, large = (clickers_named(StudyPlan(6, 5, 22), jod, np.random.default_rng(1)) for jod in (1.1, 3.0))
    assert small is not None
    assert large is not None
    assert small["by_votes"] < 0.5 < 0.8 < large["by_votes"]
    assert small["with_checks"] > 0.8
    assert clickers_named(StudyPlan(6, 5, 2), 1.1, np.random.default_rng(1)) is None

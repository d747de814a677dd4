"""Factors, contrasts and tests against reference values, enumeration and simulation."""

from __future__ import annotations

import json
from itertools import combinations, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import f as f_distribution
from scipy.stats import ttest_1samp

from app.analysis import AnalysisSettings, analyse
from app.analysis.comparisons.comparison import compare
from app.analysis.comparisons.factor_fits import factor_results
from app.analysis.comparisons.factors import coding, votes_on_factor, wald_p_value
from app.analysis.findings.ranking import sharing_letters
from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.contrasts import Contrast, contrasts, holm, letters
from app.analysis.reading.read_votes import read_votes, votes_from_rows
from app.analysis.reading.votes_table import VotesTable, votes_from_indices

ITEMS = tuple(f"{depth}_{fusion}" for depth in ("id", "dr", "pm") for fusion in ("fa", "fb"))
FACTORS = {
    "depth": {item: item.split("_")[0] for item in ITEMS},
    "fusion": {item: item.split("_")[1] for item in ITEMS},
}


def simulated(
    abilities: NDArray[np.float64], *, n_participants: int, nu: float, rng: np.random.Generator, order: float = 0.0
) -> VotesTable:
    """Every participant judges every pair once, the item shown first taken at random."""
    n = len(abilities)
    low, high = (np.tile(part, n_participants) for part in np.triu_indices(n, 1))
    swap = rng.random(len(low)) < 0.5
    first, second = np.where(swap, high, low), np.where(swap, low, high)
    d = abilities[first] - abilities[second]
    weights = np.stack([np.exp(d / 2 + order), np.exp(-d / 2), np.full(len(d), nu)])
    drawn = rng.random(len(d)) * weights.sum(axis=0)
    choice = (drawn > weights[0]).astype(int) + (drawn > weights[:2].sum(axis=0))
    who = np.repeat(np.arange(n_participants), n * (n - 1) // 2)
    items = ITEMS if n <= len(ITEMS) else tuple(f"item {k}" for k in range(n))
    names = tuple(f"p{k}" for k in range(n_participants)), ("",), items[:n]
    return votes_from_indices(who, np.zeros(len(who), int), first, second, choice, names=names, first_shown=0 * choice)


def test_a_factor_alone_uses_the_pairs_that_differ_in_nothing_else() -> None:
    votes = simulated(np.zeros(6), n_participants=2, nu=0.5, rng=np.random.default_rng(0))
    assert len(votes_on_factor(votes, FACTORS, "depth")) == 2 * 6
    assert len(votes_on_factor(votes, FACTORS, "fusion")) == 2 * 3
    assert votes_on_factor(votes, FACTORS, "fusion").items == ("fa", "fb")


def test_the_coding_spans_all_levels_and_sums_to_zero_over_items() -> None:
    levels, columns = coding(FACTORS, ITEMS)
    assert levels.shape == (6, 3)
    assert np.linalg.matrix_rank(np.c_[levels, np.ones(6)]) == 4
    assert not levels.sum(axis=0).any()
    assert [name for name, _ in columns] == ["depth", "fusion"]


def test_a_factor_with_one_level_is_left_out() -> None:
    analysis = analyse(
        simulated(np.linspace(-0.5, 0.5, 6), n_participants=10, nu=0.5, rng=np.random.default_rng(1)),
        AnalysisSettings(factors={**FACTORS, "scene": dict.fromkeys(ITEMS, "same")}),
    )
    assert {row["factor"] for row in analysis["effects"]} == {"depth", "fusion"}
    assert not [row for row in analysis["scores"] if row["comparison"] == "scene"]


def test_a_single_factor_that_names_every_item_has_the_items_scores_as_effects() -> None:
    votes = simulated(np.linspace(-0.5, 0.5, 6), n_participants=40, nu=0.5, rng=np.random.default_rng(2))
    analysis = analyse(votes, AnalysisSettings(factors={"approach": {item: item for item in ITEMS}}))
    effects = {row["level"]: row["effect"] for row in analysis["effects"]}
    scores = {row["item"]: row["score"] for row in analysis["scores"] if row["comparison"] == "all"}
    assert effects == pytest.approx(scores, abs=1e-9)
    letters_of = {row["item"]: row["letters"] for row in analysis["scores"] if row["comparison"] == "all"}
    assert {row["level"]: row["letters"] for row in analysis["effects"]} == letters_of
    assert len(set(letters_of.values())) > 1
    assert not [row for row in analysis["tests"] if row["name"] == "interaction"]


@pytest.mark.parametrize("n_participants", [8, 13, 40])  # few; no more than the free parameters; enough
def test_effects_have_the_intervals_of_scores_if_a_single_factor_names_every_item(n_participants: int) -> None:
    rng = np.random.default_rng(4)
    votes = simulated(np.linspace(-0.5, 0.5, 14), n_participants=n_participants, nu=0.5, rng=rng)
    analysis = analyse(votes, AnalysisSettings(factors={"approach": {item: item for item in votes.items}}))
    assert analysis["models"][0]["few_participants"] == (n_participants < 40)
    effects = {row["level"]: (row["ci_low"], row["ci_high"]) for row in analysis["effects"]}
    scores = {row["item"]: row for row in analysis["scores"] if row["comparison"] == "all"}
    for item, limits in effects.items():
        assert limits == pytest.approx((scores[item]["ci_low"], scores[item]["ci_high"]), abs=1e-9)


@pytest.mark.slow
def test_additive_and_interaction_models_have_the_reference_values(real_data: Path) -> None:
    folder = real_data / "votes" / "reference" / "paper_like_22x5x6"
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
    analysis = analyse(read_votes(folder / "votes.csv"), AnalysisSettings(factors=FACTORS))
    for dataset, models in expected["datasets"].items():
        where = "all" if dataset == "ALL" else dataset
        effects = {row["level"]: row for row in analysis["effects"] if row["dataset"] == where}
        for level in ("id", "dr", "fb"):
            assert effects[level]["effect"] == pytest.approx(models["additive"]["params"][level], abs=1e-6)
            assert effects[level]["se"] == pytest.approx(models["additive"]["se"][level], abs=1e-5)
            clustered = effects[level]["se_participant"] * np.sqrt(21 / 22)
            assert clustered == pytest.approx(models["additive"]["se_cluster"][level], abs=1e-5)
        (test,) = [row for row in analysis["tests"] if (row["name"], row["dataset"]) == ("interaction", where)]
        assert test["g2"] == pytest.approx(models["LRT_interaction"]["G2"], abs=1e-5)
        assert (test["df"], test["p_value"]) == (2, pytest.approx(models["LRT_interaction"]["p"], abs=1e-6))
    (differ,) = [row for row in analysis["tests"] if (row["name"], row["model"]) == ("datasets differ", "additive")]
    assert differ["g2"] == pytest.approx(expected["LRT_dataset_heterogeneity_additive"]["G2"], abs=1e-5)
    assert differ["df"] == 16


def test_an_effect_over_all_names_all_datasets_that_it_is_made_of() -> None:
    """On one of three datasets everybody decides alike, so that it has no effects of its own."""
    rng = np.random.default_rng(1)
    rows = [
        {"participant": f"p{person}", "dataset": dataset, "item_a": a, "item_b": b, "choice": choice}
        for person in range(6)
        for dataset in ("ball", "box", "clear")
        for a, b in combinations(ITEMS, 2)
        for choice in ("a" if dataset == "clear" else rng.choice(["a", "b"]),)
    ]
    votes, settings = votes_from_rows(rows), AnalysisSettings(factors=FACTORS, analysed_factors=())
    effects, _ = factor_results(votes, settings, list(compare(votes, settings)))
    scopes = {row["dataset"]: row["scope"] for row in effects}
    assert scopes == {"ball": "dataset ball", "box": "dataset box", "all": "these 3 datasets"}


def test_an_interaction_on_which_all_voted_alike_says_nothing_about_other_people() -> None:
    """Half of them prefer a to b and the others b to a; a1 to a2 and b2 to b1 all of them."""
    sides = [(up, down) for up, down in ("ab", "ba") for _ in range(7)]
    rows = [
        {"participant": f"p{who}", "item_a": first, "item_b": second, "choice": "a"}
        for who, (up, down) in enumerate(sides)
        for first, second in [*((f"{up}{i}", f"{down}{j}") for i in "12" for j in "12"), ("a1", "a2"), ("b2", "b1")]
    ]
    factors = {"letter": {name: name[0] for name in ("a1", "a2", "b1", "b2")}}
    factors["number"] = {name: name[1] for name in factors["letter"]}
    tests = analyse(votes_from_rows(rows), AnalysisSettings(factors=factors))["tests"]
    assert {test["p_participant"] for test in tests if test["name"] == "interaction"} == {None}


@pytest.mark.slow
def test_the_order_effect_of_the_additive_model_has_the_reference_test(real_data: Path) -> None:
    folder = real_data / "votes" / "reference" / "paper_like_22x5x6"
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))["datasets"]
    analysis = analyse(read_votes(folder / "votes.csv"), AnalysisSettings(factors=FACTORS, order_effect=True))
    for dataset, models in expected.items():
        where = "all" if dataset == "ALL" else dataset
        key = ("order effect", "additive", where)
        (test,) = [row for row in analysis["tests"] if (row["name"], row["model"], row["dataset"]) == key]
        assert test["g2"] == pytest.approx(models["LRT_order"]["G2"], abs=1e-5)


def test_with_people_as_the_sample_effects_are_tested_as_by_hotelling() -> None:
    """Against Student's t for one effect and Wilks' lambda for two."""
    people = np.random.default_rng(3).normal((0.6, 0.2), 1.0, (9, 2))
    n, mean, within = len(people), people.mean(axis=0), np.cov(people.T) * (len(people) - 1)
    fit: Any = SimpleNamespace(
        theta=mean, covariance=np.eye(2), participant_covariance=within / (n * (n - 1)), n_participants=n
    )
    assert wald_p_value(fit, np.eye(2)[:1]) == pytest.approx(ttest_1samp(people[:, 0], 0.0).pvalue)
    wilks = np.linalg.det(within) / np.linalg.det(within + n * np.outer(mean, mean))
    assert wald_p_value(fit, np.eye(2)) == pytest.approx(f_distribution.sf((1 / wilks - 1) * (n - 2) / 2, 2, n - 2))
    for too_little in ({"n_participants": 2}, {"theta": None}, {"participant_covariance": np.zeros((2, 2))}):
        assert wald_p_value(SimpleNamespace(**vars(fit) | too_little), np.eye(2)) is None


def test_holm_is_the_textbook_example() -> None:
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])


@given(
    st.integers(2, 7).flatmap(lambda n: st.lists(st.booleans(), min_size=n * (n - 1) // 2, max_size=n * (n - 1) // 2))
)
def test_two_items_share_a_letter_if_and_only_if_they_do_not_differ(differ: list[bool]) -> None:
    n = round((1 + np.sqrt(1 + 8 * len(differ))) / 2)
    names = [f"i{k}" for k in range(n)]
    found = [
        Contrast(a, b, 0.0, 1.0, 0.0, 0.01 if significant else 0.5, -2.0, 2.0)
        for (a, b), significant in zip(combinations(names, 2), differ, strict=True)
    ]
    shown = letters(names, found)
    for contrast in found:
        assert (not set(shown[contrast.item_a]) & set(shown[contrast.item_b])) == (contrast.p_holm < 0.05)


def test_contrasts_use_the_covariance_of_the_scores() -> None:
    votes = simulated(np.array([0.5, -0.5]), n_participants=30, nu=0.5, rng=np.random.default_rng(3))
    fit = fit_scores(votes)
    (contrast,) = contrasts(fit)
    clustered = fit.error(0, by_participant=True)
    assert clustered is not None
    assert contrast.se == pytest.approx(2 * clustered, rel=1e-9)


def test_dataset_without_a_maximum_has_no_contrasts() -> None:
    votes = simulated(np.array([9.0, -9.0]), n_participants=5, nu=0.001, rng=np.random.default_rng(3))
    assert contrasts(fit_scores(votes)) == []


@pytest.mark.slow
def test_intervals_cover_the_truth_and_scores_are_unbiased_in_80_studies() -> None:
    """22 participants who differ, 75 votes each: five datasets of 15 pairs."""
    rng = np.random.default_rng(20)
    truth = np.array([-0.9, -0.5, -0.1, 0.2, 0.5, 0.8])
    covered, errors = [], []
    for _ in range(80):
        studies = [simulated(truth, n_participants=22, nu=0.6, rng=rng) for _ in range(5)]
        columns: dict[str, Any] = {
            key: np.concatenate([getattr(study, key) for study in studies])
            for key, value in vars(studies[0]).items()
            if isinstance(value, np.ndarray)
        }
        rows = analyse(VotesTable(**{**vars(studies[0]), **columns}))["scores"]
        errors.append([row["score"] - truth[ITEMS.index(row["item"])] for row in rows])
        covered.append([row["ci_low"] <= truth[ITEMS.index(row["item"])] <= row["ci_high"] for row in rows])
    bias, spread = np.mean(errors, axis=0), np.std(errors, axis=0)
    assert 0.93 <= np.mean(covered) <= 0.97
    assert (np.abs(bias) < 3.5 * spread / np.sqrt(80)).all()


def test_a_position_bias_is_found_and_does_not_leak_into_the_scores() -> None:
    rng = np.random.default_rng(4)
    truth = np.array([-0.6, -0.2, 0.2, 0.6])
    votes = simulated(truth, n_participants=400, nu=0.5, rng=rng, order=0.5)
    fit = fit_scores(votes, order_effect=True)
    assert fit.order_effect is not None
    error = fit.error(fit.design.n_effects, by_participant=True)
    assert error is not None
    assert abs(fit.order_effect - 0.5) < 4 * error
    assert fit.order_effect > 5 * error
    assert fit.scores is not None
    np.testing.assert_allclose(fit.scores, truth, atol=0.15)


def test_letters_of_many_groups_go_on_with_capitals_and_dots_and_are_told_apart_again() -> None:
    names = [f"i{place:02}" for place in range(56)]
    compared = [
        Contrast(a, b, 0.0, 1.0, p_value=p, p_holm=p, ci_low=None, ci_high=None)
        for (first, a), (second, b) in combinations(enumerate(names), 2)
        for p in (1.0 if second - first == 1 else 0.001,)
    ]
    shown = letters(names, compared)
    assert [shown[names[place]] for place in (0, 25, 26, 51, 52, 54)] == ["a", "yz", "zA", "YZ", "Za.", "b.c."]
    shared = sharing_letters(shown.items())
    assert list(shared.values()) == [list(pair) for pair in pairwise(names)]

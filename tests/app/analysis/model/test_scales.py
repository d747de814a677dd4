"""Published scales against closed forms and a general optimiser."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import ndtr
from scipy.stats import norm
from scipy.stats import t as student

from app.analysis import AnalysisSettings, analyse, votes_from_rows
from app.analysis.analyse import scored
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.model.distance_prior import fit_with_prior
from app.analysis.model.thurstone import JOD, THURSTONE, fit_thurstone

VOTES = simulate_votes(StudyPlan(5, 2, 20), np.linspace(-0.6, 0.6, 5), np.random.default_rng(11))


def only(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [row for row in rows if row["dataset"] == "all"]


def test_what_75_percent_prefer_is_one_jod_better() -> None:
    votes = [
        {"participant": "", "dataset": "", "item_a": "x", "item_b": "y", "choice": choice, "count": count}
        for choice, count in (("a", 12), ("b", 2), ("none", 6))  # 15 and 5 with half of the ties each
    ]
    first, second = analyse(votes_from_rows(votes), AnalysisSettings(ties="half"))["scores"]
    assert first["jod_thurstone"] - second["jod_thurstone"] == pytest.approx(1, abs=1e-9)
    assert first["jod"] - second["jod"] == pytest.approx(1, abs=1e-9)


def test_thurstones_scores_are_those_of_a_general_optimiser() -> None:
    fit = fit_thurstone(VOTES)
    assert fit is not None
    assert fit.theta is not None
    counts = fit.counts

    def loss(scores: np.ndarray[Any, Any]) -> float:
        d = scores[counts.first] - scores[counts.second]
        return -float(np.sum(counts.wins * norm.logcdf(d) + counts.losses * norm.logcdf(-d)))

    optimise: Any = minimize
    found = optimise(loss, np.zeros(5), method="BFGS", tol=1e-9)
    np.testing.assert_allclose(fit.theta, found.x - found.x.mean(), atol=1e-5)
    assert fit.loglik == pytest.approx(-found.fun, abs=1e-8)


def test_thurstones_derivatives_are_finite_differences() -> None:
    d, counts, step = np.linspace(-4, 4, 9), (np.full(9, 7.0), np.full(9, 4.0), np.zeros(9)), 1e-5
    t = np.zeros(9)
    slopes = THURSTONE.derivatives(d, t, *counts)
    around = [THURSTONE.loglik(d + side * step, t, *counts) for side in (1, -1)]
    np.testing.assert_allclose(slopes.d, (around[0] - around[1]) / (2 * step), atol=1e-6)
    curves = [THURSTONE.derivatives(d + side * step, t, *counts).d for side in (1, -1)]
    np.testing.assert_allclose(slopes.dd, -(curves[0] - curves[1]) / (2 * step), atol=1e-6)
    np.testing.assert_allclose(THURSTONE.probabilities(d, t)[0], norm.cdf(d))


@pytest.mark.parametrize("ties", ["davidson", "rao-kupper", "half"])
def test_preferences_are_the_scores_and_limits_as_probabilities(ties: str) -> None:
    analysis = analyse(VOTES, AnalysisSettings(ties=ties))
    log_theta = only(analysis["models"])[0].get("log_theta", 0.0)

    def share(d: float) -> float:
        win, loss = (1 / (1 + np.exp(log_theta - side)) for side in (d, -d))
        return float(win / (win + loss))

    for row in only(analysis["contrasts"]):
        shown = [row[name] for name in ("preference", "preference_low", "preference_high")]
        assert shown == pytest.approx([share(row[name]) for name in ("difference", "ci_low", "ci_high")])
    for row in only(analysis["scores"]):
        shown = [row[f"preference_to_mean{end}"] for end in ("", "_low", "_high")]
        assert shown == pytest.approx([share(row[name]) for name in ("score", "ci_low", "ci_high")])
        assert row["jod_low"] == pytest.approx(row["ci_low"] / np.log(3))


def test_equivalence_is_two_one_sided_tests_against_the_margin() -> None:
    analysis = analyse(VOTES, AnalysisSettings(equivalence_margin=1.0))
    for row in only(analysis["contrasts"]):
        sides = [(row["difference"] + side * np.log(3)) / row["se"] for side in (1, -1)]
        assert row["p_equivalent"] == pytest.approx(max(student.sf(sides[0], 19), student.cdf(sides[1], 19)))
        assert row["p_equivalent_holm"] >= row["p_equivalent"]
    shown = {row["about"]: row["text"] for row in analysis["findings"]}["equivalent"]
    alike = [row for row in only(analysis["contrasts"]) if row["p_equivalent_holm"] < 0.05]
    assert 0 < len(alike) < 10
    assert shown.startswith(f"Equivalent: {alike[0]['item_a']} with {alike[0]['item_b']}")
    assert all(row["p_equivalent"] is None for row in analyse(VOTES)["contrasts"])
    with pytest.raises(ValueError, match="equivalence_margin is -1"):
        AnalysisSettings(equivalence_margin=-1)


def test_equivalence_within_a_group_of_separated_votes_counts_those_who_voted_in_the_group() -> None:
    everybody = [(f"p{k}", better, "z", "a") for k in range(20) for better in ("x", "y")]  # nobody prefers z
    some = [(f"p{k}", "x", "y", choice) for k in range(14) for choice in ("a", "b", "aab"[k % 3])]
    names = ("participant", "item_a", "item_b", "choice")
    votes = votes_from_rows([dict(zip(names, vote, strict=True)) for vote in everybody + some])
    rows = analyse(votes, AnalysisSettings(equivalence_margin=1.0))["contrasts"]
    (row,) = (row for row in rows if row["method"] == "difference of scores in the group")
    sides = [(row["difference"] + side * np.log(3)) / row["se"] for side in (1, -1)]
    assert row["p_equivalent"] == pytest.approx(max(student.sf(sides[0], 13), student.cdf(sides[1], 13)))


# The scene "exhibition" of the example of pwcmp: how often the row was preferred to the column.
TONE_MAPPING = {
    "tmo_camera": (0, 6, 0, 11, 9, 8, 4),
    "ronan12": (4, 0, 1, 13, 7, 7, 5),
    "irawan05": (10, 11, 0, 6, 10, 9, 13),
    "hateren06": (1, 0, 0, 0, 1, 1, 1),
    "ferwerda96": (1, 6, 0, 10, 0, 10, 3),
    "pattanaik00": (5, 5, 0, 13, 5, 0, 1),
    "mantiuk08": (10, 9, 0, 10, 9, 11, 0),
}
# What pwcmp gives for it without a prior, in its examples/ex3_tmo_cmp_scaled.csv.
BY_PWCMP = {"ferwerda96": 0.0, "hateren06": -1.95922, "irawan05": 3.60789, "mantiuk08": 1.06656}
BY_PWCMP |= {"pattanaik00": -0.23306, "ronan12": 0.41576, "tmo_camera": 0.55270}


def tone_mapping(*participants: str) -> list[dict[str, Any]]:
    """The example's votes, once from each participant."""
    return [
        {"participant": name, "item_a": winner, "item_b": loser, "choice": "a", "count": count}
        for name in participants
        for winner, row in TONE_MAPPING.items()
        for loser, count in zip(TONE_MAPPING, row, strict=True)
        if count
    ]


def scores_by_pwcmp() -> np.ndarray[Any, Any]:
    """What its function pw_scale minimises with the prior "gaussian", pair by pair, by a general optimiser; JOD."""
    d = np.array(list(TONE_MAPPING.values()))
    n, everybody = d + d.T, range(len(d))
    moved = d.copy()
    moved[(n > 0) & (d == 0)] = 1
    moved[(n > 0) & (d.T == 0)] -= 1
    compared = [(i, j) for i in everybody for j in everybody if n[i, j]]

    def loss(q: np.ndarray[Any, Any]) -> float:
        p = {(i, j): float(ndtr((q[i] - q[j]) * JOD)) for i, j in compared}
        prior = dict.fromkeys(compared, 0.0)
        for k, m in compared:
            said = {pair: p[pair] ** moved[k, m] * (1 - p[pair]) ** (n[k, m] - moved[k, m]) for pair in compared}
            total = sum(said.values())
            prior = {pair: prior[pair] + said[pair] / total for pair in compared}
        logs = (d[i, j] * np.log(p[i, j]) + d[j, i] * np.log(1 - p[i, j]) for i, j in compared)
        return float(0.01 * np.mean(q) ** 2 - sum(logs) - sum(np.log(prior[pair] + 0.1) for pair in compared))

    optimise: Any = minimize
    found = optimise(loss, np.zeros(len(d)), method="BFGS", tol=1e-3)
    return np.asarray(found.x - found.x.mean())


@pytest.mark.slow
def test_jod_with_and_without_the_prior_are_those_of_pwcmp() -> None:
    plain = {row["item"]: row["jod_thurstone"] for row in analyse(votes_from_rows(tone_mapping("")))["scores"]}
    assert {item: jod - plain["ferwerda96"] for item, jod in plain.items()} == pytest.approx(BY_PWCMP, abs=2e-5)
    analysis = analyse(votes_from_rows(tone_mapping("")), AnalysisSettings(jod_prior="pwcmp"))
    with_prior = {row["item"]: row["jod_thurstone"] for row in analysis["scores"]}
    expected = dict(zip(TONE_MAPPING, scores_by_pwcmp(), strict=True))
    assert with_prior == pytest.approx(expected, abs=1e-4)
    assert with_prior["irawan05"] < plain["irawan05"] - 0.3  # votes without a vote against it count for less
    assert analysis["scores"][0]["jod_thurstone_low"] is None  # nobody knows how people differ
    assert "pwcmp's prior" in analysis["findings"][-1]["text"]
    with pytest.raises(ValueError, match="jod_prior is 'flat', expected none or pwcmp"):
        AnalysisSettings(jod_prior="flat")


def test_the_intervals_of_jod_with_a_prior_are_by_the_jackknife_over_participants() -> None:
    votes = VOTES.where(VOTES.participant < 6)
    rows = scored(votes, AnalysisSettings(jod_prior="pwcmp", by_dataset=False))
    jods, low, high = (np.array([row[f"jod_thurstone{end}"] for row in rows]) for end in ("", "_low", "_high"))
    without = [fit_with_prior(votes.where(votes.participant != person)) for person in range(6)]
    spread = np.std([fit.scores / JOD for fit in without if fit is not None], axis=0)
    half = student.ppf(0.975, 5) * np.sqrt(5) * spread
    np.testing.assert_allclose(low, jods - half, atol=1e-5)
    np.testing.assert_allclose(high, jods + half, atol=1e-5)


def test_a_condition_that_wins_everything_has_a_finite_jod_by_the_prior() -> None:
    won = [
        {"participant": f"p{person}", "item_a": a, "item_b": b, "choice": "b" if a > "a" and person < 3 else "a"}
        for person in range(10)
        for a, b in ("ab", "ac", "ad", "bc", "bd", "cd")
    ]
    plain, with_prior = (scored(votes_from_rows(won), AnalysisSettings(jod_prior=name)) for name in ("none", "pwcmp"))
    assert [row["jod_thurstone"] for row in plain] == [None] * 4
    jods = {row["item"]: row["jod_thurstone"] for row in with_prior}
    assert max(jods, key=lambda item: jods[item]) == "a"
    assert 1 < jods["a"] - jods["b"] < 6
    two = [row for row in won if row["item_a"] + row["item_b"] == "ab"]  # nothing else says how far
    alone = scored(votes_from_rows(two), AnalysisSettings(jod_prior="pwcmp"))
    assert [row["jod_thurstone"] for row in alone] == [None, None]

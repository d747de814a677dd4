"""Scores against closed forms, finite differences, and independent implementations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.likelihood.conjugate_gradients import maximise_many_items
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.newton import solve
from app.analysis.model.likelihood.participant_errors import participant_gradients
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.analysis.reading.read_votes import read_votes, votes_from_rows
from app.analysis.reading.votes_table import VotesTable, only_compared, votes_from_indices

SCORE, ERROR, LIKELIHOOD = 1e-6, 1e-5, 1e-5


def table(*rows: tuple[str, str, str, int], participant: str = "", first_shown: str = "") -> VotesTable:
    return votes_from_rows(
        {
            "participant": participant,
            "dataset": "",
            "item_a": a,
            "item_b": b,
            "choice": choice,
            "count": count,
            "first_shown": first_shown and (a if first_shown == "a" else b),
        }
        for a, b, choice, count in rows
    )


def random_votes(seed: int, *, n_items: int = 4, n_participants: int = 8, tie: float = 0.25) -> VotesTable:
    rng = np.random.default_rng(seed)
    strength = rng.normal(0, 0.6, n_items)
    rows = []
    for participant in range(n_participants):
        for a in range(n_items):
            for b in range(a + 1, n_items):
                first, second = (a, b) if rng.random() < 0.5 else (b, a)
                wins = rng.random() < 1 / (1 + np.exp(strength[second] - strength[first]))
                choice = "none" if rng.random() < tie else "a" if wins else "b"
                shown = f"i{first if rng.random() < 0.5 else second}"
                rows.append(
                    {
                        "participant": f"p{participant}",
                        "dataset": "d",
                        "item_a": f"i{first}",
                        "item_b": f"i{second}",
                        "choice": choice,
                        "first_shown": shown,
                    }
                )
    return votes_from_rows(rows)


def scores(fit: Fit) -> dict[str, float]:
    assert fit.scores is not None
    return dict(zip(fit.items, fit.scores.tolist(), strict=True))


def loglik_at(fit: Fit, theta: np.ndarray[Any, Any]) -> float:
    counts = fit.counts
    d, t = fit.design.predictors(theta[None])
    return float(fit.design.model.loglik(d, t, counts.wins[None], counts.losses[None], counts.ties[None]).sum())


def test_two_items_have_a_closed_form() -> None:
    fit = fit_scores(table(("A", "B", "a", 15), ("A", "B", "b", 5)))
    assert scores(fit)["A"] - scores(fit)["B"] == pytest.approx(np.log(3), abs=1e-12)
    assert fit.error(0) == pytest.approx(np.sqrt(1 / 15 + 1 / 5) / 2, abs=1e-12)
    assert fit.loglik == pytest.approx(15 * np.log(0.75) + 5 * np.log(0.25), abs=1e-12)
    assert fit.tie_parameter is None


def test_two_items_with_ties_have_a_closed_form() -> None:
    fit = fit_scores(table(("A", "B", "a", 9), ("A", "B", "b", 4), ("A", "B", "none", 12)))
    assert scores(fit)["A"] - scores(fit)["B"] == pytest.approx(np.log(9 / 4), abs=1e-12)
    assert fit.tie_parameter == pytest.approx(np.log(12 / 6), abs=1e-12)
    assert fit.df == 0


@pytest.mark.parametrize("ties", TIE_MODELS)
@pytest.mark.parametrize("order_effect", [False, True])
def test_the_maximum_is_that_of_a_general_optimiser(ties: str, order_effect: bool) -> None:
    fit = fit_scores(random_votes(3), ties=ties, order_effect=order_effect)
    assert fit.theta is not None
    start = np.zeros(fit.design.n_parameters)
    start[-1] = 0.3
    optimise: Any = minimize
    found = optimise(lambda theta: -loglik_at(fit, theta), start, method="BFGS", tol=1e-9)
    n = len(fit.items)
    expected = np.r_[found.x[:n] - found.x[:n].mean(), found.x[n:]]
    np.testing.assert_allclose(fit.theta, expected, atol=1e-5)
    assert fit.loglik == pytest.approx(-found.fun, abs=1e-9)


@pytest.mark.parametrize("ties", TIE_MODELS)
@pytest.mark.parametrize("order_effect", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_derivatives_equal_finite_differences(ties: str, order_effect: bool, seed: int) -> None:
    fit = fit_scores(random_votes(seed), ties=ties, order_effect=order_effect)
    rng = np.random.default_rng(seed)
    theta = rng.normal(0, 0.3, fit.design.n_parameters)
    theta[-1] = 0.4
    counts, step = fit.counts, 1e-5
    tables = counts.wins[None], counts.losses[None], counts.ties[None]

    def gradient(at: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        slopes = fit.design.gradient(fit.design.model.derivatives(*fit.design.predictors(at[None]), *tables))
        return np.asarray(slopes[0])

    information = fit.design.information(fit.design.model.derivatives(*fit.design.predictors(theta[None]), *tables))[0]
    for index in range(len(theta)):
        shift = np.eye(len(theta))[index] * step
        slope = (loglik_at(fit, theta + shift) - loglik_at(fit, theta - shift)) / (2 * step)
        curve = (gradient(theta + shift) - gradient(theta - shift)) / (2 * step)
        assert gradient(theta)[index] == pytest.approx(slope, abs=1e-6)
        np.testing.assert_allclose(-information[index], curve, atol=1e-6)


@pytest.mark.parametrize("ties", TIE_MODELS)
@pytest.mark.parametrize("order_effect", [False, True])
def test_participants_gradients_sum_to_zero_at_the_maximum(ties: str, order_effect: bool) -> None:
    votes = random_votes(5)
    gradients = participant_gradients(fit_scores(votes, ties=ties, order_effect=order_effect), votes)
    np.testing.assert_allclose(gradients.sum(axis=0), 0, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(list(TIE_MODELS)))
def test_scores_do_not_depend_on_which_item_is_called_a(seed: int, ties: str) -> None:
    votes = random_votes(seed)
    swapped = VotesTable(
        **{
            **vars(votes),
            "item_a": votes.item_b,
            "item_b": votes.item_a,
            "choice": np.array([1, 0, 2], np.int8)[votes.choice],
        }
    )
    one, other = fit_scores(votes, ties=ties), fit_scores(swapped, ties=ties)
    assert one.status == other.status
    if one.status == "ok":
        assert scores(one) == pytest.approx(scores(other), abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 5))
def test_repeating_every_vote_keeps_scores_and_divides_the_variance(seed: int, times: int) -> None:
    votes = random_votes(seed)
    repeated = VotesTable(**{**vars(votes), "count": votes.count * times})
    one, many = fit_scores(votes), fit_scores(repeated)
    if one.status == "ok":
        assert one.covariance is not None
        assert many.covariance is not None
        assert scores(many) == pytest.approx(scores(one), abs=1e-9)
        np.testing.assert_allclose(many.covariance * times, one.covariance, atol=1e-9)
        assert one.participant_covariance is not None
        assert many.participant_covariance is not None
        np.testing.assert_allclose(many.participant_covariance, one.participant_covariance, atol=1e-9)


def test_expected_wins_equal_observed_wins_at_the_maximum() -> None:
    fit = fit_scores(random_votes(11), ties="half")
    assert fit.theta is not None
    counts = fit.counts
    probabilities = fit.design.model.probabilities(*fit.design.predictors(fit.theta[None]))[:, 0]
    observed = np.bincount(counts.first, counts.wins, 4) + np.bincount(counts.second, counts.losses, 4)
    expected = np.bincount(counts.first, probabilities[0] * counts.totals, 4)
    expected += np.bincount(counts.second, probabilities[1] * counts.totals, 4)
    np.testing.assert_allclose(observed, expected, atol=1e-9)


def test_the_order_effect_is_the_advantage_of_the_item_shown_first() -> None:
    rows = [("A", "B", "a", 30), ("A", "B", "b", 10)]
    both = [*rows, ("B", "A", "a", 30), ("B", "A", "b", 10)]
    fit = fit_scores(table(*both), order_effect=True)
    assert fit.order_effect == pytest.approx(np.log(3), abs=1e-12)
    assert scores(fit)["A"] == pytest.approx(0, abs=1e-12)
    turned = fit_scores(table(*both, first_shown="b"), order_effect=True)
    assert turned.order_effect == pytest.approx(-np.log(3), abs=1e-12)


def test_an_item_that_never_wins_is_named_and_the_estimate_is_marked() -> None:
    fit = fit_scores(table(("A", "B", "a", 6), ("A", "B", "b", 4), ("A", "C", "a", 10), ("B", "C", "a", 10)))
    assert fit.status == "separated"
    assert fit.groups == (("A", "B"), ("C",))
    assert fit.penalty == "firth"
    # R, brglm2
    assert scores(fit) == pytest.approx(
        {"A": 1.412235874316182, "B": 1.0456086393595936, "C": -2.457844513675776}, abs=SCORE
    )


def test_islands_are_named_and_have_no_scores() -> None:
    fit = fit_scores(table(("A", "B", "a", 3), ("A", "B", "b", 1), ("C", "D", "a", 2), ("C", "D", "b", 2)))
    assert fit.status == "disconnected"
    assert fit.groups == (("A", "B"), ("C", "D"))
    assert fit.scores is None


def test_nothing_but_ties_gives_equal_scores_and_no_tie_parameter() -> None:
    fit = fit_scores(table(("A", "B", "none", 4), ("A", "C", "none", 4), ("B", "C", "none", 4)))
    assert fit.status == "separated"
    assert fit.tie_parameter is None
    assert list(scores(fit).values()) == pytest.approx([0, 0, 0], abs=1e-9)
    half = fit_scores(table(("A", "B", "none", 4), ("A", "C", "none", 4), ("B", "C", "none", 4)), ties="half")
    assert half.status == "ok"
    assert list(scores(half).values()) == pytest.approx([0, 0, 0], abs=1e-12)


def test_ties_beside_one_sided_wins_have_no_maximum_although_ford_is_met() -> None:
    fit = fit_scores(table(("A", "B", "a", 10), ("A", "B", "none", 5)))
    assert fit.status == "separated"
    assert fit.groups == (("A",), ("B",))


@pytest.mark.parametrize("ties", TIE_MODELS)
def test_one_vote_is_separated_and_does_not_fail(ties: str) -> None:
    fit = fit_scores(table(("A", "B", "a", 1)), ties=ties)
    assert fit.status == "separated"
    assert scores(fit)["A"] > 0 > scores(fit)["B"]


def test_firths_estimate_of_two_items_adds_half_a_vote_to_each() -> None:
    fit = fit_scores(table(("A", "B", "a", 7)))
    assert scores(fit)["A"] - scores(fit)["B"] == pytest.approx(np.log(7.5 / 0.5), abs=1e-9)


def test_a_circular_judge_has_equal_scores() -> None:
    fit = fit_scores(table(("A", "B", "a", 1), ("B", "C", "a", 1), ("C", "A", "a", 1)))
    assert fit.status == "ok"
    assert list(scores(fit).values()) == pytest.approx([0, 0, 0], abs=1e-12)


def test_an_order_effect_without_limit_is_found() -> None:
    fit = fit_scores(table(("A", "B", "a", 10), ("B", "A", "a", 10)), order_effect=True)
    assert fit.status == "separated"


def test_a_long_chain_of_items_converges() -> None:
    chain = [(f"i{k}", f"i{k + 1}", choice, count) for k in range(40) for choice, count in (("a", 2), ("b", 1))]
    fit = fit_scores(table(*chain))
    assert scores(fit)["i0"] - scores(fit)["i40"] == pytest.approx(40 * np.log(2), abs=1e-8)


def test_only_compared_items_are_fitted() -> None:
    votes = random_votes(2)
    part = only_compared(votes.where((votes.item_a != 0) & (votes.item_b != 0)))
    assert part.items == votes.items[1:]
    assert fit_scores(part).status == "ok"


REFERENCES = [
    ("baseball_agresti", "bt", "davidson", False),
    ("baseball_agresti", "bt_order", "davidson", True),
    ("citations_stigler", "bt", "davidson", False),
    ("cemschoice", "bt_half", "half", False),
    ("cemschoice", "bt_dropties", "drop", False),
    ("cemschoice", "davidson", "davidson", False),
    ("cemschoice", "rao_kupper", "rao-kupper", False),
    ("deg_two_items", "bt", "davidson", False),
    ("deg_two_items_ties", "davidson", "davidson", False),
]


@pytest.mark.parametrize(("name", "model", "ties", "order_effect"), REFERENCES)
def test_reference_data_give_the_reference_values(
    real_data: Path, name: str, model: str, ties: str, order_effect: bool
) -> None:
    folder = real_data / "votes" / "reference" / name
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))["models"][model]
    fit = fit_scores(read_votes(folder / "votes.csv"), ties=ties, order_effect=order_effect)
    assert scores(fit) == pytest.approx(expected["ability"], abs=SCORE)
    assert fit.loglik == pytest.approx(expected["loglik"], abs=LIKELIHOOD)
    for index, item in enumerate(fit.items):
        if "se" in expected:
            assert fit.error(index) == pytest.approx(expected["se"][item], abs=ERROR)
        if "se_cluster_judge" in expected:
            assert fit.n_participants is not None
            without_factor = np.sqrt((fit.n_participants - 1) / fit.n_participants)
            clustered = fit.error(index, by_participant=True)
            assert clustered is not None
            assert clustered * without_factor == pytest.approx(expected["se_cluster_judge"][item], abs=ERROR)
    found = {
        "deviance": fit.deviance,
        "df": fit.df,
        "order": fit.order_effect,
        "order_se": fit.error(len(fit.items)) if order_effect else None,
        "log_nu": fit.tie_parameter,
        "log_theta": fit.tie_parameter,
    }
    for key in found.keys() & expected.keys():
        assert found[key] == pytest.approx(expected[key], abs=SCORE if key != "deviance" else LIKELIHOOD)
    for key in {"log_nu_se", "log_theta_se"} & expected.keys():
        assert fit.error(-1) == pytest.approx(expected[key], abs=ERROR)


def test_a_published_study_gives_the_scores_of_pwcmp(real_data: Path) -> None:
    fit = fit_scores(read_votes(real_data / "votes" / "pwcmp_tone_mapping.csv"))
    expected = {"irawan05": 1.187, "mantiuk08": 0.678, "tmo_camera": 0.425, "ronan12": 0.046}
    expected |= {"ferwerda96": -0.118, "pattanaik00": -0.628, "hateren06": -1.590}
    assert scores(fit) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("tie", [0.0, 0.2])
@pytest.mark.parametrize("ties", ["davidson", "rao-kupper", "half"])
def test_many_items_have_the_same_scores_by_conjugate_gradients(tie: float, ties: str) -> None:
    votes = random_votes(4, n_items=30, n_participants=3, tie=tie)
    fit = fit_scores(votes, ties=ties)
    assert fit.theta is not None
    table = fit.counts.wins, fit.counts.losses, fit.counts.ties
    found = maximise_many_items(fit.design, *table)
    assert found.converged[0]
    np.testing.assert_allclose(found.theta[0], fit.theta, atol=1e-9)


@pytest.mark.parametrize(("n_parameters", "n_tables"), [(3, 2), (3, 12), (20, 12)])
def test_a_table_whose_votes_tell_no_step_takes_none_from_the_others(n_parameters: int, n_tables: int) -> None:
    """Of resampled votes, those of a table may lead away without end, until their information is singular."""
    roots = np.random.default_rng(0).normal(size=(n_tables, n_parameters, n_parameters))
    matrices, right = roots @ np.swapaxes(roots, 1, 2) + np.eye(n_parameters), np.ones((n_tables, n_parameters))
    matrices[1] = 0
    solved = solve(matrices, right)
    assert not np.isfinite(solved[1]).any()
    others = np.arange(n_tables) != 1
    np.testing.assert_allclose((matrices @ solved[..., None])[others, :, 0], 1, atol=1e-8)


@pytest.mark.slow
def test_a_chain_of_ten_thousand_items_is_solved() -> None:
    first = np.repeat(np.arange(9_999), 3)
    nobody = np.zeros(len(first), np.int64)
    names = ("",), ("",), tuple(f"i{k}" for k in range(10_000))
    votes = votes_from_indices(nobody, nobody, first, first + 1, np.tile([0, 0, 1], 9_999), names=names)
    fit = fit_scores(votes)
    assert fit.scores is not None
    np.testing.assert_allclose(np.diff(fit.scores), -np.log(2), atol=1e-9)
    assert fit.covariance is None


def test_hundred_thousands_of_votes_between_ten_thousand_items_reach_the_maximum() -> None:
    rng = np.random.default_rng(1)
    first = rng.integers(0, 10_000, 300_000)
    second = (first + rng.integers(1, 10_000, len(first))) % 10_000
    nobody = np.zeros(len(first), np.int64)
    names = ("",), ("",), tuple(f"i{k}" for k in range(10_000))
    fit = fit_scores(votes_from_indices(nobody, nobody, first, second, rng.integers(0, 3, len(first)), names=names))
    assert fit.status == "ok"
    counts = fit.counts
    assert fit.theta is not None
    d, t = fit.design.predictors(fit.theta[None])
    slopes = fit.design.model.derivatives(d, t, counts.wins[None], counts.losses[None], counts.ties[None])
    by_item = np.bincount(counts.first, slopes.d[0], 10_000) - np.bincount(counts.second, slopes.d[0], 10_000)
    np.testing.assert_allclose(by_item, 0, atol=1e-8)


def test_preferences_of_items_at_both_ends_of_a_long_chain_are_certain_and_numbers() -> None:
    upper = np.tile(np.arange(449), 3)
    names, nothing = (["p"], ["d"], [f"i{item}" for item in range(450)]), np.zeros(3 * 449, int)
    choice, count = np.repeat([0, 1, 2], 449), np.repeat([50, 1, 2], 449)
    fit = fit_scores(votes_from_indices(nothing, nothing, upper, upper + 1, choice, names=names, count=count))
    assert fit.scores is not None
    assert fit.scores[0] - fit.scores[-1] > 1500
    assert fit.preference(fit.scores[0] - fit.scores[[1, -1]]) == pytest.approx([50 / 51, 1.0])


@pytest.mark.parametrize("wins", [10**9, 10**12])
def test_a_rare_loss_among_billions_of_wins_leaves_scores(wins: int) -> None:
    """x, y and z by one distance a: wins e^-a of the neighbours are then the losses of all three pairs, ties half."""
    rows = [
        {"item_a": a, "item_b": b, "choice": choice, "count": count}
        for a, b in ("xy", "yz", "xz")
        for choice, count in (("a", wins), ("b", 1), ("none", 2))
    ]
    fit = fit_scores(votes_from_rows(rows), ties="half")
    assert fit.scores is not None
    assert fit.scores == pytest.approx(np.log((wins + 1) / 4) * np.array([1, 0, -1]), abs=1e-6)

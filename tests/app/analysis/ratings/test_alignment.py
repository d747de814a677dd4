"""One scale for ratings and votes, against numerical derivatives, the pair analysis alone, and simulated people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from app.analysis import AnalysisSettings, VotesTable, analyse
from app.analysis.ratings.alignment import align
from app.analysis.ratings.table import RatingTable
from app.analysis.reading.votes_table import votes_from_indices
from tests.app.analysis.ratings.rated_tables import rating_table

Array = NDArray[np.float64]

SLOPE, NOISE, NU = 1.2, 0.7, 0.8
N_PEOPLE, N_CONDITIONS, N_DATASETS = 20, 5, 2


def simulated_study(rng: np.random.Generator) -> tuple[RatingTable, VotesTable, Array]:
    """Ratings and votes by the same people, and the qualities they come from."""
    n_items = N_CONDITIONS * N_DATASETS
    quality = rng.uniform(1.5, 4.5, n_items)
    person, item = np.divmod(np.arange(N_PEOPLE * n_items), n_items)
    rating = quality[item] + rng.normal(0, 0.3, N_PEOPLE)[person] + rng.normal(0, NOISE, len(item))
    table = rating_table(person, item, rating, n_datasets=N_DATASETS, scale=(-20.0, 30.0))
    a, b = np.triu_indices(N_CONDITIONS, 1)
    dataset = np.tile(np.repeat(np.arange(N_DATASETS), len(a)), N_PEOPLE)
    voter = np.repeat(np.arange(N_PEOPLE), N_DATASETS * len(a))
    a, b = np.tile(a, N_DATASETS * N_PEOPLE), np.tile(b, N_DATASETS * N_PEOPLE)
    d = SLOPE * (quality[dataset * N_CONDITIONS + a] - quality[dataset * N_CONDITIONS + b])
    weight = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(len(d), NU)])
    choice = (rng.random(len(d)) * weight.sum(axis=0) > np.cumsum(weight, axis=0)).sum(axis=0)
    names = ([f"p{i}" for i in range(N_PEOPLE)], ["d0", "d1"], [f"c{i}" for i in range(N_CONDITIONS)])
    return table, votes_from_indices(voter, dataset, a, b, choice, names=names), quality


def test_people_who_all_rate_and_vote_alike_leave_no_intervals() -> None:
    table, votes, _ = simulated_study(np.random.default_rng(1))
    first = np.tile(table.rating[: len(table) // N_PEOPLE], N_PEOPLE)
    twice = replace(
        table,
        person=np.tile(table.person, 2),
        item=np.tile(table.item, 2),
        rating=np.r_[first - 0.5, first + 0.5],
    )
    choice = np.tile(votes.choice[: len(votes) // N_PEOPLE], N_PEOPLE)
    tables = align(twice, VotesTable(**{**vars(votes), "choice": choice}))
    assert [row["slope"] is None for row in tables["alignment"]] == [False]
    for row in (*tables["alignment"], *tables["alignment_items"]):
        assert {row[name] for name in row if name.endswith(("_low", "_high", "_se"))} == {None}


@pytest.mark.slow
def test_slope_qualities_and_scores_are_recovered_with_intervals_and_better_than_from_ratings_alone() -> None:
    rng = np.random.default_rng(4)
    slopes, qualities, scores, errors, plain = [], [], [], [], []
    for _ in range(40):
        table, votes, truth = simulated_study(rng)
        tables = align(table, votes)
        (model,) = tables["alignment"]
        assert (model["status"], model["n_shared"]) == ("ok", 10)
        rows = tables["alignment_items"]
        assert [(row["dataset"], row["condition"]) for row in rows] == list(table.items)
        by_dataset = truth.reshape(N_DATASETS, N_CONDITIONS)
        true_scores = (SLOPE * (by_dataset - by_dataset.mean(axis=1, keepdims=True))).ravel()
        slopes.append(model["slope_low"] < SLOPE < model["slope_high"])
        qualities += [row["quality_low"] < q < row["quality_high"] for row, q in zip(rows, truth, strict=True)]
        scores += [row["score_low"] < s < row["score_high"] for row, s in zip(rows, true_scores, strict=True)]
        means = np.bincount(table.item, table.rating) / np.bincount(table.item)
        errors.append(np.mean((np.array([row["quality"] for row in rows]) - truth) ** 2))
        plain.append(np.mean((means - truth) ** 2))
    assert np.mean(slopes) >= 0.85
    assert 0.90 < np.mean(qualities) < 0.99
    assert 0.90 < np.mean(scores) < 0.99
    assert np.sqrt(np.mean(errors)) < 0.95 * np.sqrt(np.mean(plain))


def negative_loglik(theta: Array, rated: Array, rating: Array, votes: VotesTable) -> float:
    """Of qualities, slope, log noise and log nu, vote by vote."""
    quality, (slope, log_noise, log_nu) = theta[:-3], theta[-3:]
    residue = (rating - quality[rated.astype(int)]) / np.exp(log_noise)
    total = (residue**2 / 2 + log_noise + np.log(2 * np.pi) / 2).sum()
    first, second = (votes.dataset * N_CONDITIONS + item for item in (votes.item_a, votes.item_b))
    d = slope * (quality[first] - quality[second])
    terms = np.stack([d / 2, -d / 2, np.full(len(d), log_nu)])
    return float(total - (terms[votes.choice, np.arange(len(d))] - np.logaddexp.reduce(terms, axis=0)).sum())


def test_the_estimate_is_the_maximum_of_the_likelihood_written_down() -> None:
    table, votes, truth = simulated_study(np.random.default_rng(1))
    tables = align(table, votes)
    (model,) = tables["alignment"]
    start = np.r_[truth, 1.0, 0.0, 0.0]
    best = minimize(negative_loglik, start, args=(table.item, table.rating, votes), method="BFGS")
    assert -best.fun == pytest.approx(model["loglik"], abs=1e-5)
    assert best.x[-3] == pytest.approx(model["slope"], abs=1e-3)
    np.testing.assert_allclose([row["quality"] for row in tables["alignment_items"]], best.x[:-3], atol=1e-3)


def test_with_hardly_any_ratings_the_scores_are_those_of_the_votes() -> None:
    rng = np.random.default_rng(2)
    table, votes, _ = simulated_study(rng)
    noisy = table.rating + rng.normal(0, 60, len(table))
    vague = rating_table(table.person, table.item, noisy, n_datasets=N_DATASETS, scale=(-500.0, 500.0))
    tables = align(vague, votes)
    alone = analyse(votes, AnalysisSettings())["scores"]
    expected = {(row["dataset"], row["item"]): row["score"] for row in alone}
    for row in tables["alignment_items"]:
        assert row["score"] == pytest.approx(expected[row["dataset"], row["condition"]], abs=0.15)


def test_items_that_only_votes_link_are_placed_and_strangers_are_left_out() -> None:
    table, votes, _ = simulated_study(np.random.default_rng(3))
    only_first = table.item < 4  # c4 of d0 is compared only; nothing of d1 is rated
    part = rating_table(table.person[only_first], table.item[only_first], table.rating[only_first], scale=(-20.0, 30.0))
    tables = align(part, votes)
    assert [row["condition"] for row in tables["alignment_items"]] == ["c0", "c1", "c2", "c3", "c4"]
    assert {row["dataset"] for row in tables["alignment_items"]} == {"d0"}
    assert tables["alignment_items"][4]["n_ratings"] == 0
    assert tables["alignment"][0]["n_votes"] == N_PEOPLE * 10


def test_two_items_in_common_are_too_few() -> None:
    table, votes, _ = simulated_study(np.random.default_rng(3))
    rows = table.item < 2
    part = rating_table(table.person[rows], table.item[rows], table.rating[rows], scale=(-20.0, 30.0))
    tables = align(part, votes)
    assert tables["alignment_items"] == []
    assert tables["alignment"][0]["status"] == "too few items in common"


def test_votes_that_all_follow_the_ratings_have_no_maximum() -> None:
    person, item = np.divmod(np.arange(12 * 3), 3)
    rating = np.array([1.0, 3.0, 5.0])[item] + np.random.default_rng(0).normal(0, 0.3, 36)
    a, b = np.tile([1, 2, 2], 12), np.tile([0, 0, 1], 12)
    zeros = np.zeros(36, int)
    names = ([f"p{i}" for i in range(12)], ["d0"], ["c0", "c1", "c2"])
    votes = votes_from_indices(person, zeros, a, b, zeros, names=names)
    tables = align(rating_table(person, item, rating, scale=(-5.0, 10.0)), votes)
    assert tables["alignment"][0]["status"] == "no maximum"
    assert tables["alignment_items"] == []


@pytest.mark.parametrize("tie_rate", [0.0, 0.3])
def test_an_item_that_nobody_rated_and_that_loses_every_vote_is_left_out(tie_rate: float) -> None:
    rng = np.random.default_rng(1)
    person, item = np.divmod(np.arange(48), 4)
    table = rating_table(person, item, 2 + item / 2 + rng.normal(0, 0.5, 48), scale=(-20.0, 30.0))
    a, b = np.triu_indices(5, 1)
    voter, a, b = np.repeat(np.arange(12), 10), np.tile(a, 12), np.tile(b, 12)
    choice = np.where(rng.random(120) < tie_rate, 2, rng.random(120) < 0.6)
    names = ([f"p{i}" for i in range(12)], ["d0"], [f"c{i}" for i in range(5)])
    mixed, loses = (votes_from_indices(voter, 0 * a, a, b, kind, names=names) for kind in (choice, (b < 4) * choice))
    assert align(table, mixed)["alignment"][0]["left_out"] is None
    tables, without = align(table, loses), align(table, loses.where(b < 4))
    assert tables["alignment"][0] == without["alignment"][0] | {"left_out": "c4 of d0"}
    assert tables["alignment"][0]["status"] == "ok"
    assert tables["alignment_items"] == without["alignment_items"]
    nameless = votes_from_indices(voter, 0 * a, a, b, (b < 4) * choice, names=(names[0], [""], names[2]))
    items = tuple(("", condition) for _, condition in table.items)
    assert align(replace(table, items=items), nameless)["alignment"][0]["left_out"] == "c4"


def test_a_slope_that_grows_without_limit_is_no_maximum_and_no_overflow() -> None:
    rater, item = [0, 1, 1, 2, 2, 3, 4, 5, 6, 7, 8, 8, 9, 10], [2, 0, 3, 0, 1, 2, 0, 3, 1, 2, 0, 2, 1, 2]
    table = rating_table(rater, item, [2, 2, 1, 1, 2, 1, 2, 2, 1, 1, 1, 1, 1, 1], n_datasets=2)
    voter, dataset = np.array([11, 12, 4, 6, 13, 10]), np.array([1, 1, 1, 0, 1, 1])
    choice, one = np.array([1, 1, 2, 1, 2, 0]), np.ones(6, int)
    names = ([f"p{i}" for i in range(14)], ["d0", "d1"], ["c0", "c1"])
    votes = votes_from_indices(voter, dataset, one, 0 * one, choice, names=names)
    assert align(table, votes)["alignment"][0]["status"] == "no maximum"


def test_a_single_participant_says_nothing_about_others() -> None:
    table, votes, _ = simulated_study(np.random.default_rng(5))
    everybody = align(table, votes)["alignment_items"]
    alone = replace(table, participants=("p0",), person=np.zeros_like(table.person))
    tables = align(alone, replace(votes, participants=("p0",), participant=np.zeros_like(votes.participant)))
    (model,) = tables["alignment"]
    assert (model["status"], model["n_participants"], model["slope_low"]) == ("ok", 1, None)
    for row, same in zip(tables["alignment_items"], everybody, strict=True):
        assert row["quality"] == pytest.approx(same["quality"])
        assert all(row[name] is None for name in row if name.endswith(("_se", "_low", "_high")))


def of_voters(votes: VotesTable, n: int) -> VotesTable:
    """Return the votes of the first people, under names of their own."""
    return replace(votes, participants=tuple(f"v{i}" for i in range(N_PEOPLE))).where(votes.participant < n)


def test_a_single_voter_among_many_raters_says_nothing_about_other_voters() -> None:
    table, votes, _ = simulated_study(np.random.default_rng(6))
    tables = align(table, of_voters(votes, 1))
    assert (tables["alignment"][0]["status"], tables["alignment"][0]["slope_low"]) == ("ok", None)
    assert all(row["score_low"] is None for row in tables["alignment_items"])


@pytest.mark.slow
def test_intervals_hold_where_two_people_voted_and_many_rated() -> None:
    rng, covered = np.random.default_rng(8), []
    for _ in range(60):
        table, votes, truth = simulated_study(rng)
        tables = align(table, of_voters(votes, 2))
        by_dataset = truth.reshape(N_DATASETS, N_CONDITIONS)
        scores = (SLOPE * (by_dataset - by_dataset.mean(axis=1, keepdims=True))).ravel()
        covered += [
            row["score_low"] < score < row["score_high"]
            for row, score in zip(tables["alignment_items"], scores, strict=True)
        ]
    assert np.mean(covered) > 0.92

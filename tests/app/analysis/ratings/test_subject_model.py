"""The subject model against SUREAL, direct maximum likelihood, numerical derivatives and simulated people."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from app.analysis.ratings.subject_model import COMMON, fit_subject_model, rater_intervals
from app.analysis.ratings.table import RatingTable
from tests.app.analysis.ratings.rated_tables import (
    SUREAL_BIAS,
    SUREAL_INCONSISTENCY,
    SUREAL_QUALITY,
    known_table,
    rating_table,
    simulated,
)

Array = NDArray[np.float64]


def negative_loglik(theta: Array, table: RatingTable) -> float:
    """Of qualities, biases and log inconsistencies, written down as in the paper."""
    n_items, n_people = len(table.items), len(table.participants)
    quality, bias, log_spread = np.split(theta, [n_items, n_items + n_people])
    total = 0.0
    for p, j, o in zip(table.person, table.item, table.rating, strict=True):
        variance = np.exp(2 * log_spread[p])
        total += 0.5 * np.log(2 * np.pi * variance) + (o - quality[j] - bias[p]) ** 2 / (2 * variance)
    return float(total)


def test_qualities_biases_and_inconsistencies_are_those_of_sureal() -> None:
    model = fit_subject_model(known_table())
    np.testing.assert_allclose(model.quality, SUREAL_QUALITY, atol=1e-6)
    np.testing.assert_allclose(model.bias, SUREAL_BIAS, atol=1e-6)
    np.testing.assert_allclose(model.inconsistency, SUREAL_INCONSISTENCY, atol=1e-6)


def test_no_direction_improves_the_likelihood() -> None:
    table = known_table()
    model = fit_subject_model(table)
    theta = np.concatenate([model.quality, model.bias, np.log(model.inconsistency)])
    best = minimize(negative_loglik, theta + 0.02, args=(table,), method="BFGS", options={"gtol": 1e-4})
    assert -best.fun == pytest.approx(model.loglik, abs=1e-6)
    quality, bias, log_spread = np.split(best.x, [12, 20])
    np.testing.assert_allclose(quality + bias.mean(), model.quality, atol=1e-4)
    np.testing.assert_allclose(np.exp(log_spread), model.inconsistency, atol=1e-4)


def test_errors_are_those_of_the_inverse_information_with_biases_of_sum_zero() -> None:
    table = known_table()
    model = fit_subject_model(table)
    theta = np.concatenate([model.quality, model.bias, np.log(model.inconsistency)])
    step, n = 1e-3, len(theta)
    around = step * np.eye(n)
    hessian = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            ends = [
                a * b * negative_loglik(theta + a * around[i] + b * around[j], table) for a in (1, -1) for b in (1, -1)
            ]
            hessian[i, j] = hessian[j, i] = sum(ends) / (4 * step**2)
    zero_sum = np.concatenate([np.zeros(12), np.ones(8), np.zeros(8)])
    bordered = np.block([[hessian, zero_sum[:, None]], [zero_sum[None, :], np.zeros((1, 1))]])
    covariance = np.linalg.inv(bordered)[:n, :n]
    np.testing.assert_allclose(model.quality_covariance, covariance[:12, :12], rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(model.bias_se, np.sqrt(np.diagonal(covariance)[12:20]), rtol=1e-3)
    np.testing.assert_allclose(model.log_inconsistency_se, np.sqrt(np.diagonal(covariance)[20:]), rtol=1e-3)


def test_it_recovers_the_truth_better_than_means_and_its_intervals_cover_it() -> None:
    rng = np.random.default_rng(8)
    errors, plain, covered, bias_covered, spread_covered = [], [], [], [], []
    for _ in range(60):
        table, truth = simulated(rng, 30, 40, missing=0.1)
        model = fit_subject_model(table)
        if model.status == COMMON:  # rare, and said
            continue
        means = np.bincount(table.item, table.rating) / np.bincount(table.item)
        errors.append(np.mean((model.quality - truth.quality) ** 2))
        plain.append(np.mean((means - truth.quality) ** 2))
        covered.append(np.abs(model.quality - truth.quality) < 1.96 * np.sqrt(np.diagonal(model.quality_covariance)))
        bias_covered.append(np.abs(model.bias - truth.bias) < 1.96 * model.bias_se)
        log_error = np.abs(np.log(model.inconsistency / truth.inconsistency))
        spread_covered.append(log_error < 1.96 * model.log_inconsistency_se)
    assert len(errors) >= 57
    assert np.sqrt(np.mean(errors)) < 0.7 * np.sqrt(np.mean(plain))
    assert 0.91 < np.mean(covered) < 0.97
    assert 0.91 < np.mean(bias_covered) < 0.97
    assert 0.90 < np.mean(spread_covered) < 0.97


def test_a_rating_more_for_everybody_changes_the_qualities_alone() -> None:
    table, _ = simulated(np.random.default_rng(2))
    shifted = rating_table(table.person, table.item, table.rating + 1, scale=(-20.0, 30.0))
    before, after = fit_subject_model(table), fit_subject_model(shifted)
    np.testing.assert_allclose(after.quality, before.quality + 1, atol=1e-7)
    np.testing.assert_allclose(after.bias, before.bias, atol=1e-7)


def test_few_ratings_give_everybody_the_same_weight() -> None:
    rng = np.random.default_rng(3)
    person, item = np.divmod(np.arange(4 * 5), 5)
    table = rating_table(person, item, rng.uniform(1, 5, 20))
    model = fit_subject_model(table)
    assert model.status == COMMON
    values = table.rating.reshape(4, 5)
    np.testing.assert_allclose(model.quality, values.mean(axis=0), atol=1e-8)
    np.testing.assert_allclose(model.bias, values.mean(axis=1) - values.mean(), atol=1e-8)
    residue = values - values.mean(axis=0) - values.mean(axis=1)[:, None] + values.mean()
    spread = np.sqrt((residue**2).sum() / (20 - 5 - 4 + 1))
    np.testing.assert_allclose(np.sqrt(np.diagonal(model.quality_covariance)), spread / np.sqrt(4), rtol=1e-8)
    np.testing.assert_allclose(model.bias_se, spread * np.sqrt((1 - 1 / 4) / 5), rtol=1e-8)
    assert np.isnan(model.log_inconsistency_se).all()


def test_participants_who_share_no_item_cannot_be_compared() -> None:
    table = rating_table([0, 0, 0, 1, 1, 1], [0, 1, 2, 3, 4, 5], [1, 2, 3, 3, 4, 5])
    model = fit_subject_model(table)
    assert model.status == "disconnected"
    assert np.isnan(model.quality).all()


def test_a_participant_with_two_ratings_is_left_out_of_the_model() -> None:
    table, _ = simulated(np.random.default_rng(2))
    more = rating_table(
        np.r_[table.person, 24, 24], np.r_[table.item, 0, 1], np.r_[table.rating, 30, -20], scale=(-20.0, 30.0)
    )
    model = fit_subject_model(more)
    np.testing.assert_allclose(model.quality, fit_subject_model(table).quality)
    assert np.isnan(model.bias[24])


def test_a_single_item_rated_often_has_the_mean_of_consistent_participants_as_quality() -> None:
    """Biases have mean zero, so the quality is the mean of the participants' means, of independent errors."""
    ratings = np.array([[1.0, 2, 5], [3, 3, 4], [2, 4, 4]])
    model = fit_subject_model(rating_table(np.repeat(np.arange(3), 3), [0] * 9, ratings.ravel()))
    assert model.status == "ok"
    assert model.quality == pytest.approx([ratings.mean()])
    assert model.inconsistency == pytest.approx(ratings.std(axis=1))
    assert model.quality_covariance[0, 0] == pytest.approx((ratings.var(axis=1) / 3).sum() / 9)


def test_intervals_of_few_people_hold_their_bias_and_inconsistency_in_95_percent() -> None:
    rng = np.random.default_rng(1)
    held: list[list[float]] = []
    for _ in range(60):
        bias = 0.4 * rng.standard_normal(8)
        ratings = 3 + np.linspace(0.75, -0.75, 30) + bias[:, None] + 0.7 * rng.standard_normal((8, 30))
        person, item = np.indices(ratings.shape)
        items = tuple(("d", f"c{c}") for c in range(30))
        people = tuple(f"P{j}" for j in range(8))
        rows = person.ravel(), item.ravel(), ratings.ravel()
        table = RatingTable(people, items, *rows, np.zeros(30, bool), "acr", -9.0, 9.0)
        model = fit_subject_model(table)
        half, low, high = rater_intervals(table, model)
        if model.status == "ok":
            held.append([(abs(model.bias - bias + bias.mean()) <= half).mean(), ((low <= 0.7) & (high >= 0.7)).mean()])
    of_bias, of_inconsistency = np.mean(held, axis=0)
    assert 0.93 <= of_bias <= 0.98  # normal limits with the ratings' number: 0.91
    assert 0.92 <= of_inconsistency <= 0.98  # 0.81

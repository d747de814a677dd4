"""What chance reaches: orders of conditions, p-values and intervals, and how often they err."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from app.analysis.objective.correlations import pearsons, spearmans
from app.analysis.objective.permutation import chance, condition_orders
from app.analysis.objective.points import Points
from app.analysis.objective.prediction import CORRELATIONS, describe
from app.analysis.screening.correlation import pearson, spearman

NO_PAIRS = np.zeros((0, 2), np.intp)


def points_of(values: np.ndarray, scores: np.ndarray, dataset: list[int], condition: list[int]) -> Points:
    places = np.array(dataset, np.intp), np.array(condition, np.intp)
    return Points(values.ravel(), scores.ravel(), np.full(values.size, np.nan), *places, NO_PAIRS, NO_PAIRS)


def grid(values: np.ndarray, scores: np.ndarray) -> Points:
    """Points of all conditions on all datasets, from arrays (datasets, conditions)."""
    dataset, condition = (part.ravel().tolist() for part in np.indices(values.shape))
    return points_of(values, scores, dataset, condition)


def test_six_conditions_change_places_in_all_720_ways_and_together_on_all_datasets() -> None:
    orders = condition_orders(grid(np.zeros((3, 6)), np.zeros((3, 6))), np.random.default_rng(0))
    assert orders.shape == (720, 18)
    assert orders[0].tolist() == list(range(18))
    assert len(np.unique(orders, axis=0)) == 720
    by_dataset = orders.reshape(720, 3, 6) - 6 * np.arange(3)[:, None]
    assert (by_dataset == by_dataset[:, :1]).all()


def test_conditions_change_places_only_with_conditions_of_the_same_datasets() -> None:
    points = points_of(np.zeros(5), np.zeros(5), [0, 0, 0, 1, 1], [0, 1, 2, 0, 1])
    orders = condition_orders(points, np.random.default_rng(0))
    assert orders.tolist() == [[0, 1, 2, 3, 4], [1, 0, 2, 4, 3]]


def test_many_conditions_are_ordered_at_random_and_the_observed_order_counts() -> None:
    orders = condition_orders(grid(np.zeros((2, 9)), np.zeros((2, 9))), np.random.default_rng(0))
    assert len(orders) == 1000
    assert orders[0].tolist() == list(range(18))
    assert (np.sort(orders, axis=1) == np.arange(18)).all()
    assert abs(orders[1:, 0].mean() - 4) < 0.3  # every place is as likely


@pytest.mark.slow
@settings(max_examples=12)
@given(st.integers(0, 10_000))
def test_the_p_value_is_that_of_scipy_over_all_pairings(seed: int) -> None:
    values, scores = np.random.default_rng(seed).normal(size=(2, 5))
    points = grid(values[None], scores[None])
    orders = condition_orders(points, np.random.default_rng(0))
    for batch, single in ((pearsons(values, scores[orders]), pearson), (spearmans(values, scores, orders), spearman)):
        theirs = stats.permutation_test(
            (values,),
            lambda x, single=single: abs(single(x, scores)),
            permutation_type="pairings",
            alternative="greater",
            n_resamples=factorial(5),
        )
        assert chance(batch, batch[0], 5).p_value == pytest.approx(theirs.pvalue)


@pytest.mark.slow
@given(st.integers(0, 10_000), st.booleans())
def test_the_interval_excludes_zero_just_where_chance_rarely_reaches_as_much(seed: int, has_ranks: bool) -> None:
    values, scores = np.random.default_rng(seed).normal(size=(2, 6))
    scores[:3] += 2 * values[:3]
    orders = condition_orders(grid(values[None], scores[None]), np.random.default_rng(0))
    reached = spearmans(values, scores, orders) if has_ranks else pearsons(values, scores[orders])
    low, high, _ = chance(reached, reached[0], 6)
    assert low is not None
    assert high is not None
    assert low <= reached[0] <= high
    sizes = np.round(np.abs(reached), 9)
    middle_p = np.mean(sizes > sizes[0]) + np.mean(sizes == sizes[0]) / 2
    if abs(middle_p - 0.05) > 1e-3:  # between two steps, the limit is interpolated
        assert (low > 0 or high < 0) == (middle_p < 0.05)


def test_the_interval_of_many_normal_points_is_fishers() -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(size=60)
    scores = values + rng.normal(size=60)
    orders = condition_orders(grid(values[None], scores[None]), rng)
    low, high, _ = chance(pearsons(values, scores[orders]), pearson(values, scores), 60)
    fisher = stats.pearsonr(values, scores).confidence_interval()
    assert (low, high) == pytest.approx((fisher.low, fisher.high), abs=0.03)


def test_five_conditions_are_needed_for_an_interval() -> None:
    values, scores = np.arange(4.0), np.array([0.0, 1, 2, 4])
    orders = condition_orders(grid(values[None], scores[None]), np.random.default_rng(0))
    low, high, p_value = chance(spearmans(values, scores, orders), 1.0, 4)
    assert (low, high, p_value) == (None, None, 2 / 24)
    assert len(orders) == 24


def test_a_perfect_order_of_six_conditions_is_not_certain() -> None:
    values = np.arange(6.0)
    orders = condition_orders(grid(values[None], values[None]), np.random.default_rng(0))
    low, high, p_value = chance(spearmans(values, values, orders), 1.0, 6)
    assert high == 1.0
    assert low is not None
    assert 0.5 < low < 0.85
    assert p_value == 2 / 720


def error_rates(n_datasets: int, n_measures: int, *, is_shared: bool, seed: int) -> dict[str, float]:
    """Share of measures of random numbers whose intervals exclude zero; the scores of a condition are alike on all
    datasets, and so are the measures if they are shared.
    """
    rng = np.random.default_rng(seed)
    errors: dict[str, list[bool]] = {name: [] for name in CORRELATIONS}
    orders = condition_orders(grid(*np.zeros((2, n_datasets, 6))), rng)
    for _ in range(n_measures):
        scores = rng.normal(size=6) + 0.3 * rng.normal(size=(n_datasets, 6))
        values = rng.normal(size=(1 if is_shared else n_datasets, 6)) * np.ones((n_datasets, 1))
        row = describe(grid(values, scores), orders, "higher")
        for name in CORRELATIONS:
            errors[name].append(row[f"{name}_low"] > 0 or row[f"{name}_high"] < 0)
    return {name: float(np.mean(excluded)) for name, excluded in errors.items()}


@pytest.mark.slow
def test_random_numbers_seldom_seem_to_predict_one_dataset() -> None:
    rates = error_rates(1, 400, is_shared=False, seed=2)
    assert all(0.03 <= rate <= 0.075 for rate in rates.values()), rates


@pytest.mark.slow
@pytest.mark.parametrize("is_shared", [False, True], ids=["on every dataset", "the same on all datasets"])
def test_random_numbers_seldom_seem_to_predict_five_datasets(is_shared: bool) -> None:
    rates = error_rates(5, 300, is_shared=is_shared, seed=3)
    assert all(0.03 <= rate <= 0.075 for rate in rates.values()), rates

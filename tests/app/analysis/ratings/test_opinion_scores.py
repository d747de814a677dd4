"""Mean opinion scores against scipy's t test, definitions and simulated people."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from app.analysis.ratings.contrasts import rating_contrasts
from app.analysis.ratings.opinion_scores import condition_rows, differential_scores, item_rows, mean_with_interval
from tests.app.analysis.ratings.rated_tables import rating_table, simulated


def test_the_interval_of_an_item_is_that_of_the_t_test() -> None:
    values = np.array([1.0, 2, 2, 3, 5, 4, np.nan])
    row = mean_with_interval(values)
    expected = stats.ttest_1samp(values[:-1], 0).confidence_interval(0.95)
    assert (row["n"], row["mean"], row["sd"]) == (6, pytest.approx(17 / 6), pytest.approx(np.std(values[:-1], ddof=1)))
    assert (row["ci_low"], row["ci_high"]) == (pytest.approx(expected.low), pytest.approx(expected.high))


def test_a_condition_rated_by_all_on_every_dataset_has_the_interval_of_the_participants_means() -> None:
    table, _ = simulated(np.random.default_rng(1), 9, 6, n_datasets=3)
    (row, _) = list(condition_rows(table))
    values = table.rating.reshape(9, 3, 2)[:, :, 0]
    expected = stats.ttest_1samp(values.mean(axis=1), 0).confidence_interval(0.95)
    assert row["n_datasets"] == 3
    assert row["mos"] == pytest.approx(values.mean())
    assert (row["ci_low"], row["ci_high"]) == (pytest.approx(expected.low), pytest.approx(expected.high))


def test_a_dataset_that_many_rated_counts_no_more_than_the_others() -> None:
    table = rating_table([0, 1, 2, 3, 0, 1], [0, 0, 0, 0, 1, 1], [1, 1, 2, 2, 5, 4], n_datasets=2)
    (row,) = condition_rows(table)
    assert row["mos"] == pytest.approx((1.5 + 4.5) / 2)


def test_the_interval_of_a_condition_covers_the_truth_where_ratings_are_missing() -> None:
    rng, covered = np.random.default_rng(5), []
    for _ in range(400):
        quality = np.array([2.0, 3.0, 4.0])
        values = quality + rng.normal(0, 0.5, (16, 1)) + rng.normal(0, 0.7, (16, 3))
        values[rng.random(values.shape) < 0.3] = np.nan
        row = mean_with_interval(values)
        covered.append(row["ci_low"] < 3.0 < row["ci_high"])
    assert 0.92 < np.mean(covered) < 0.98


@pytest.mark.parametrize("n_raters", [1, 2, 4])
def test_the_interval_of_a_condition_covers_the_truth_where_every_dataset_has_raters_of_its_own(n_raters: int) -> None:
    rng, covered, n_items = np.random.default_rng(6), [], 8
    for _ in range(400):
        values = np.full((n_items * n_raters, n_items), np.nan)
        who = np.arange(len(values))
        values[who, who // n_raters] = 3 + rng.normal(0, 0.7, len(values))
        row = mean_with_interval(values)
        covered.append(row["ci_low"] < 3.0 < row["ci_high"])
    assert 0.91 < np.mean(covered) < 0.98


def test_items_with_raters_of_their_own_have_satterthwaites_degrees_of_freedom() -> None:
    """With equal variances: of two means of three and of six, a third and a sixth of the variance."""
    values = np.full((9, 2), np.nan)
    values[:3, 0], values[3:, 1] = np.arange(3), np.arange(6)
    assert mean_with_interval(values)["freedom"] == pytest.approx((1 / 3 + 1 / 6) ** 2 / (1 / 9 / 2 + 1 / 36 / 5))
    assert mean_with_interval(np.random.default_rng(0).normal(size=(9, 4)))["freedom"] == pytest.approx(8)


@pytest.mark.slow
def test_equal_conditions_of_which_half_the_ratings_are_missing_are_seldom_told_apart() -> None:
    rng, rejected = np.random.default_rng(7), []
    for _ in range(150):
        rating = 3 + rng.normal(0, 0.4, (12, 1)) + rng.normal(0, 0.8, (12, 16))
        person, item = np.nonzero(rng.random(rating.shape) < 0.5)
        table = rating_table(person, item, rating[person, item], n_datasets=4, scale=(-9, 15))
        rejected += [contrast.p_value < 0.05 for contrast in rating_contrasts(table)]
    assert np.mean(rejected) < 0.055


def test_repeated_ratings_of_a_participant_count_as_one_opinion() -> None:
    table = rating_table([0, 0, 1], [0, 0, 0], [1, 3, 5])
    (row,) = item_rows(table)
    assert (row["n_ratings"], row["n"], row["mos"]) == (3, 2, 3.5)


def test_an_item_that_nobody_rated_has_no_score() -> None:
    table = rating_table([0, 1], [1, 1], [1, 3])
    unrated, rated = item_rows(table)
    assert (unrated["n"], unrated["mos"], unrated["ci_low"]) == (0, None, None)
    assert rated["mos"] == 2


def test_the_hidden_reference_is_taken_off_and_the_high_end_added() -> None:
    table = rating_table([0, 0, 1, 1, 2], [0, 1, 0, 1, 0], [3, 5, 4, 4, 2], protocol="acr-hr", references=(1,))
    expected = [[3 - 5 + 5, np.nan], [4 - 4 + 5, np.nan], [np.nan, np.nan]]
    np.testing.assert_array_equal(differential_scores(table), expected)
    item, reference = item_rows(table)
    assert (item["mos"], item["dmos"], reference["mos"], reference["dmos"]) == (3, 4, 4.5, None)


def test_on_another_scale_equal_to_the_reference_is_its_high_end() -> None:
    table = rating_table([0, 0], [0, 1], [70, 70], protocol="acr-hr", references=(1,), scale=(0.0, 100.0))
    assert differential_scores(table)[0, 0] == 100


def test_a_degradation_rating_is_a_differential_score_itself() -> None:
    table = rating_table([0, 1], [0, 0], [2, 5], protocol="dcr")
    (row,) = item_rows(table)
    assert (row["mos"], row["dmos"]) == (3.5, 3.5)

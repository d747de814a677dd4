"""Whether a measure predicts better than another."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy import stats

from app.analysis.objective.comparison import comparison_rows, jackknife_test, left_out_z, swap_test
from app.analysis.objective.points import Points

DATASETS, CONDITIONS = 3, 6
FIRST, SECOND = np.triu_indices(CONDITIONS, 1)


def measured(noises: list[float], seed: int) -> list[Points]:
    """Points of measures that are the scores with noise."""
    rng = np.random.default_rng(seed)
    scores = rng.normal(size=(DATASETS, CONDITIONS))
    dataset, condition = (part.ravel() for part in np.indices(scores.shape))
    pairs = np.concatenate([d * CONDITIONS + np.stack([FIRST, SECOND], axis=1) for d in range(DATASETS)])
    is_reverse = scores.ravel()[pairs[:, 0]] < scores.ravel()[pairs[:, 1]]
    pairs = np.where(is_reverse[:, None], pairs[:, ::-1], pairs)
    none = np.zeros((0, 2), np.intp)
    half_widths = np.full(scores.size, np.nan)
    return [
        Points((scores + noise * rng.normal(size=scores.shape)).ravel(), scores.ravel(), half_widths, dataset,
               condition, pairs, none)
        for noise in noises
    ]  # fmt: skip


def relative(points: Points, is_kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and scores of the points kept, less the mean of their dataset."""
    rows = [is_kept & (points.dataset == d) for d in range(DATASETS)]
    parts = [[side[row] - side[row].mean() for side in (points.values, points.scores)] for row in rows]
    x, y = (np.concatenate(side) for side in zip(*parts, strict=True))
    return x, y


def test_the_jackknife_leaves_out_a_condition_on_all_datasets() -> None:
    good, poor = measured([0.3, 1.0], 1)

    def difference(is_kept: np.ndarray) -> float:
        z = [np.arctanh(np.corrcoef(*relative(points, is_kept))[0, 1]) for points in (good, poor)]
        return float(z[0] - z[1])

    left_out = np.array([difference(good.condition != condition) for condition in range(CONDITIONS)])
    error = np.sqrt((CONDITIONS - 1) / CONDITIONS * np.sum((left_out - left_out.mean()) ** 2))
    t = difference(np.ones(len(good), bool)) / error
    expected = 2 * stats.t.sf(abs(t), CONDITIONS - 1)
    assert jackknife_test(left_out_z(good), left_out_z(poor)) == pytest.approx(expected)


def test_all_exchanges_of_conditions_make_the_p_value_of_the_areas() -> None:
    good, poor = measured([0.3, 1.5], 2)

    def area(values: np.ndarray) -> float:
        apart = [values[a] - values[b] for a, b in good.different]
        return float(stats.mannwhitneyu(apart, [-d for d in apart]).statistic) / len(apart) ** 2

    everything = np.ones(len(good), bool)
    a, b = (part / part.std() for part in (relative(good, everything)[0], relative(poor, everything)[0]))
    sizes = []
    for swapped in product((False, True), repeat=CONDITIONS):
        is_swapped = np.array(swapped)[good.condition]
        sizes.append(abs(area(np.where(is_swapped, b, a)) - area(np.where(is_swapped, a, b))))
    first, second, p_value = swap_test(good, poor, np.random.default_rng(0))
    assert (first, second) == pytest.approx((area(a), area(b)))
    assert p_value == pytest.approx(np.mean(np.array(sizes) >= sizes[0] - 1e-9))


def test_the_better_of_two_measures_is_told_and_equal_ones_are_not() -> None:
    good, poor = measured([0.05, 3.0], 1)
    (row,) = comparison_rows(
        {"good": good, "poor": poor}, {"good": "higher", "poor": "higher"}, np.random.default_rng(0)
    )
    assert row["pearson_a"] > row["pearson_b"]
    assert row["auc_a"] > row["auc_b"]
    assert row["p_value"] < 0.05
    assert row["p_holm"] == row["p_value"]
    (row,) = comparison_rows({"a": good, "b": good}, {}, np.random.default_rng(0))
    assert (row["p_value"], row["auc_p"]) == (1.0, 1.0)


def test_measures_of_opposite_directions_are_compared_as_predictors() -> None:
    good, poor = measured([0.2, 2.0], 4)
    turned = Points(
        -good.values, good.scores, good.half_widths, good.dataset, good.condition, good.different, good.similar
    )
    there = comparison_rows({"a": good, "b": poor}, {"a": "higher", "b": "higher"}, np.random.default_rng(0))
    back = comparison_rows({"a": turned, "b": poor}, {"a": "lower", "b": "higher"}, np.random.default_rng(0))
    assert back == there


def test_p_values_are_corrected_for_all_pairs_of_measures() -> None:
    points = dict(zip("abc", measured([0.05, 1.0, 3.0], 5), strict=True))
    rows = comparison_rows(points, dict.fromkeys("abc", "higher"), np.random.default_rng(0))
    smallest = min(rows, key=lambda row: row["p_value"])
    assert len(rows) == 3
    assert smallest["p_holm"] == pytest.approx(min(1.0, 3 * smallest["p_value"]))


def test_measures_are_compared_on_the_points_that_both_have() -> None:
    good, poor = measured([0.3, 1.0], 6)
    fewer = poor.where(poor.dataset > 0)
    (row,) = comparison_rows({"a": good, "b": fewer}, {}, np.random.default_rng(0))
    (same,) = comparison_rows({"a": good.where(good.dataset > 0), "b": fewer}, {}, np.random.default_rng(0))
    assert row["n"] == 2 * CONDITIONS
    assert row == same


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.5, 5.0])
def test_equally_good_measures_are_seldom_told_apart(noise: float) -> None:
    told = []
    for seed in range(400):
        a, b = measured([noise, noise], seed)
        (row,) = comparison_rows({"a": a, "b": b}, {"a": "higher", "b": "higher"}, np.random.default_rng(0))
        told.append((row["p_value"] <= 0.05, row["auc_p"] <= 0.05))
    rates = np.mean(told, axis=0)
    assert (rates > 0.005).all()
    assert (rates < 0.075).all()

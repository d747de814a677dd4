"""How well measures predict scores: what is reported, for which points, in which direction."""

from __future__ import annotations

import csv
import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from app.analysis import AnalysisSettings, VotesError, analyse, analyse_file
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.objective.logistic import fit_logistic
from app.analysis.objective.points import ScoreSet, matched
from app.analysis.objective.prediction import SHARES, prediction_rows
from app.analysis.reading.attributes import read_measures

RNG = np.random.default_rng(0)


def score_set(scores: list[float], half_width: float = np.nan, clear: float = np.inf) -> ScoreSet:
    """Scores whose pairs differ if they are further apart than `clear`."""
    items = tuple(f"i{k}" for k in range(len(scores)))
    pairs = [(a, b) for a in range(len(scores)) for b in range(len(scores)) if scores[a] > scores[b]]
    different = [(a, b) for a, b in pairs if scores[a] - scores[b] > clear]
    similar = [pair for pair in pairs if pair not in different]
    return ScoreSet(items, np.array(scores), np.full(len(scores), half_width), different, similar)


def values_of(*by_dataset: tuple[str, list[float]]) -> dict[str, dict[str, float]]:
    return {name: {f"i{k}": value for k, value in enumerate(values)} for name, values in by_dataset}


def test_datasets_are_compared_relative_to_their_means_and_missing_values_are_counted() -> None:
    by_dataset = {"ball": score_set([-1.0, 0.0, 1.0], clear=1.5), "box": score_set([1.0, 0.0, -1.0], clear=1.5)}
    values = values_of(("ball", [10.0, 11.0, 12.0]), ("box", [92.0, 91.0]))
    rows = prediction_rows(by_dataset, {"psnr": values}, {}, RNG)
    together = rows[-1]
    assert (together["dataset"], together["n"], together["n_missing"]) == ("all", 5, 1)
    assert together["spearman"] == pytest.approx(1, abs=1e-9)
    assert (together["pairs_different"], together["pairs_correct"]) == (1, 1.0)
    assert rows[1]["spearman"] is None


@pytest.mark.parametrize("values", [[1.0, 1.0, 1.0], [1.0]])
def test_a_measure_that_does_not_vary_has_no_correlation(values: list[float]) -> None:
    by_dataset = {"ball": score_set([-1.0, 0.0, 1.0], clear=0.5)}
    rows = prediction_rows(by_dataset, {"same": values_of(("ball", values))}, {"same": "higher"}, RNG)
    for row in rows:
        assert row["pearson"] is row["spearman"] is row["pairs_correct"] is row["pearson_logistic"] is None
    assert len(rows) == (len(values) > 1)


def test_a_measure_that_is_constant_in_each_dataset_has_no_correlation() -> None:
    by_dataset = {"ball": score_set([0.3, -0.1, -0.2]), "box": score_set([0.2, 0.1, -0.3])}
    values = values_of(("ball", [0.1] * 3), ("box", [0.5] * 3))
    overall = prediction_rows(by_dataset, {"m": values}, {}, RNG)[-1]
    assert overall["dataset"] == "all"
    assert overall["pearson"] is overall["kendall"] is overall["pearson_monotone"] is overall["pairs_correct"] is None


def test_ranks_take_for_equal_what_is_equal_but_for_rounding_errors() -> None:
    values = np.array([[1, 2, 4, 3, 6], [12, 11, 13, 14, 17]])  # tenths
    scores = np.array([[3, 1, 4, 6, 7], [9, 11, 13, 12, 16]])
    sets = {name: score_set((row / 10).tolist(), clear=0.25) for name, row in zip("ab", scores, strict=True)}
    measured = values_of(("a", (values[0] / 10).tolist()), ("b", (values[1] / 10).tolist()))
    overall = prediction_rows(sets, {"m": measured}, {"m": "higher"}, RNG)[-1]
    exact = [(5 * table - table.sum(axis=1, keepdims=True)).ravel() for table in (values, scores)]
    assert overall["spearman"] == pytest.approx(stats.spearmanr(*exact).statistic)
    assert overall["kendall"] == pytest.approx(stats.kendalltau(*exact).statistic)
    of_pairs: dict[bool, list[int]] = {True: [], False: []}
    for value, score in zip(values, scores, strict=True):
        for a, b in combinations(range(5), 2):
            of_pairs[abs(int(score[a] - score[b])) > 2].append(abs(int(value[a] - value[b])))
    area = stats.mannwhitneyu(of_pairs[True], of_pairs[False]).statistic / len(of_pairs[True]) / len(of_pairs[False])
    assert overall["auc_different_similar"] == pytest.approx(area)


def test_pairs_count_in_the_stated_direction_not_in_that_of_the_votes() -> None:
    scores = score_set([-1.0, -0.6, -0.2, 0.2, 0.6, 1.0], clear=0.7)
    coverage = {"coverage": values_of(("ball", [0.99, 0.97, 0.98, 0.93, 0.94, 0.90]))}
    (stated,) = prediction_rows({"ball": scores}, coverage, {"coverage": "higher"}, RNG)
    (lower,) = prediction_rows({"ball": scores}, coverage, {"coverage": "lower"}, RNG)
    (guessed,) = prediction_rows({"ball": scores}, coverage, {}, RNG)
    assert stated["spearman"] < -0.7
    for share in ("pairs_correct", "auc_better_worse"):
        assert stated[share] == pytest.approx(1 - lower[share])
        assert stated[share] < 0.2
        assert guessed[share] == lower[share]
    assert (stated["direction_from"], guessed["direction_from"]) == ("measure", "rank correlation")
    assert (stated["better"], guessed["better"]) == ("higher", None)


def test_errors_after_the_fit_are_those_of_the_recommendation() -> None:
    scores = [-1.2, -0.9, -0.1, 0.2, 0.5, 0.6, 0.9]
    x, y, half = np.array([1.0, 2, 3, 4, 5, 6, 7]), np.array(scores), 0.1
    (row,) = prediction_rows({"ball": score_set(scores, half)}, {"m": values_of(("ball", x.tolist()))}, {}, RNG)
    fit = fit_logistic(x - x.mean(), y - y.mean())
    errors = [abs(s - p) for s, p in zip(y - y.mean(), fit(x - x.mean()).tolist(), strict=True)]
    assert row["rmse"] == pytest.approx((sum(e**2 for e in errors) / 3) ** 0.5)
    assert row["rmse_epsilon"] == pytest.approx((sum(max(0, e - half) ** 2 for e in errors) / 3) ** 0.5)
    assert row["outlier_ratio"] == pytest.approx(sum(e > half for e in errors) / 7)
    assert row["pearson_logistic"] == pytest.approx(stats.pearsonr(y, fit(x - x.mean())).statistic)


def test_four_points_are_too_few_for_a_curve_of_four_parameters_and_scores_without_intervals_have_no_outliers() -> None:
    by_dataset = {"ball": score_set([-1.0, 0.0, 0.2, 1.0]), "box": score_set([-1.0, 0.0, 0.2, 0.5, 1.0])}
    values = values_of(("ball", [1.0, 3, 2, 4]), ("box", [1.0, 3, 2, 4, 5]))
    four, five, _ = prediction_rows(by_dataset, {"m": values}, {}, RNG)
    assert (four["pearson_logistic"], four["rmse"], four["logistic_status"]) == (None, None, "too few points")
    assert five["rmse"] is not None
    assert five["rmse_epsilon"] is five["outlier_ratio"] is None


def test_pairs_are_those_of_a_dataset_and_the_better_stands_first() -> None:
    by_dataset = {"ball": score_set([0.0, 1.0], clear=0.5), "box": score_set([3.0, 0.0], clear=0.5)}
    points = matched(by_dataset, values_of(("ball", [5.0, 6.0]), ("box", [7.0, 8.0])))
    assert points.different.tolist() == [[1, 0], [2, 3]]
    assert points.where(points.dataset == 1).different.tolist() == [[0, 1]]


@pytest.fixture
def votes(tmp_path: Path) -> Path:
    """Votes on items 0 to 5 of datasets 0 and 1, the higher the better."""
    table = simulate_votes(StudyPlan(6, 2, 10), np.linspace(-1.2, 1.2, 6), np.random.default_rng(1))
    path = tmp_path / "votes.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("participant", "dataset", "item_a", "item_b", "choice"))
        columns = (table.participant, table.dataset, table.item_a, table.item_b)
        choices = [("a", "b", "none")[choice] for choice in table.choice]
        writer.writerows(zip(*columns, choices, strict=True))
    return path


def long_table(path: Path, *rows: str) -> Path:
    path.write_text("\n".join(["dataset,approach,measure,value,better", *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.slow
def test_the_long_table_of_validate_is_taken_with_its_directions(votes: Path, tmp_path: Path) -> None:
    rows = [f"{d},{item},error,{5 - item + 0.1 * d},lower" for d in range(2) for item in range(6)]
    rows += [f"all,{item},size,{item % 3},higher" for item in range(6)]
    measures = long_table(tmp_path / "measures.csv", *rows, "0,7,error,1,lower")
    analysis = analyse_file(votes, tmp_path / "out", measures=measures)
    overall = {row["measure"]: row for row in analysis["measures"] if row["dataset"] == "all"}
    assert (overall["error"]["better"], overall["size"]["better"]) == ("lower", "higher")
    assert overall["error"]["spearman"] < -0.8
    assert overall["error"]["pairs_correct"] == 1.0
    assert overall["size"]["n"] == 12
    assert "measures: 0/7 not among the votes and left out" in analysis["warnings"]
    assert any("with 6 conditions the smallest p-value" in text for text in analysis["warnings"])
    assert [row["measure_a"] for row in analysis["measure_comparisons"]] == ["error"]
    for name in ("measures.csv", "measure_comparisons.csv", "figures/measures.svg", "figures/measure_error.pdf"):
        assert (tmp_path / "out" / name).stat().st_size > 0
    assert "Do objective measures predict the scores?" in (tmp_path / "out" / "report.html").read_text("utf-8")
    json.loads((tmp_path / "out" / "analysis.json").read_text("utf-8"))


def test_measures_of_other_items_than_the_votes_are_refused(votes: Path, tmp_path: Path) -> None:
    measures = long_table(tmp_path / "measures.csv", "ball,pm_fb,psnr,30,higher")
    with pytest.raises(VotesError, match=r"measures ball/pm_fb; the votes are on 0, 1, 2, 3, 4 … in 0, 1"):
        analyse_file(votes, tmp_path / "out", measures=measures)
    assert not (tmp_path / "out").exists()


def test_a_wide_table_has_no_directions_and_empty_cells_are_no_values(tmp_path: Path) -> None:
    path = tmp_path / "measures.csv"
    path.write_text("dataset,item,psnr,error_mm\nball,x,30.5,\nball,y,-1,2\n", encoding="utf-8")
    measures = read_measures(path)
    assert measures.values == {"psnr": {"ball": {"x": 30.5, "y": -1.0}}, "error_mm": {"ball": {"y": 2.0}}}
    assert measures.better == {}


@pytest.mark.parametrize(
    "text",
    ["item,psnr\nx,1\n", "dataset,item\nb,x\n", "dataset,item,psnr\nb,x,good\n", "dataset,item,psnr\nb,x,1\nb,x,2\n"],
)
def test_a_table_of_measures_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "measures.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(VotesError):
        read_measures(path)


def test_measures_are_compared_on_single_datasets_even_if_these_are_not_reported() -> None:
    abilities = np.linspace(-1, 1, 5)
    votes = simulate_votes(StudyPlan(5, 3, 20), abilities, np.random.default_rng(1))
    values = {dataset: {item: float(abilities[int(item)]) for item in votes.items} for dataset in votes.datasets}
    settings = AnalysisSettings(measures={"truth": values}, better={"truth": "higher"}, by_dataset=False)
    analysis = analyse(votes, settings)
    assert {row["dataset"] for row in analysis["scores"]} == {"all"}
    assert [row["dataset"] for row in analysis["measures"]] == ["0", "1", "2", "all"]
    row = analysis["measures"][-1]
    assert row["n"] == 15
    assert row["pairs_correct"] == row["pairs_correct_high"] == 1.0
    assert 0.5 < row["pearson_low"] <= row["pearson"] <= 1
    for name in ("pearson", "pearson_logistic", "pearson_monotone", "spearman", "kendall", *SHARES):
        assert row[f"{name}_low"] <= row[name] <= row[f"{name}_high"]


def test_better_is_higher_or_lower() -> None:
    with pytest.raises(ValueError, match="better of the measure 'psnr' is 'more', expected higher or lower"):
        AnalysisSettings(better={"psnr": "more"})

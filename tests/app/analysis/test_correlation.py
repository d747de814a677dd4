"""Objective measures against scores."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from app.analysis import AnalysisSettings, analyse
from app.analysis.attributes import read_measures
from app.analysis.correlation import ScoreSet, correlation_rows, kendall, monotone_pearson, pearson, spearman
from app.analysis.power import StudyPlan, simulate_votes
from app.analysis.votes_table import VotesError

points = st.lists(st.floats(-5, 5), min_size=4, max_size=12, unique=True)


def score_set(scores: list[float], different: tuple[tuple[int, int], ...] = ()) -> ScoreSet:
    items = tuple(f"i{k}" for k in range(len(scores)))
    return ScoreSet(items, np.array(scores), np.zeros((0, len(scores))), different)


@given(points, st.integers(0, 1000))
def test_correlations_equal_those_of_scipy(values: list[float], seed: int) -> None:
    scores = np.random.default_rng(seed).normal(size=len(values))
    x = np.array(values)
    assert pearson(x, scores) == pytest.approx(stats.pearsonr(x, scores).statistic, abs=1e-9)
    assert spearman(x, scores) == pytest.approx(stats.spearmanr(x, scores).statistic, abs=1e-9)
    assert kendall(x, scores) == pytest.approx(stats.kendalltau(x, scores).statistic, abs=1e-9)


@given(points)
def test_a_monotone_function_of_the_scores_has_monotone_correlation_one(values: list[float]) -> None:
    scores = np.sort(np.array(values))
    ranks = np.arange(len(scores), dtype=float)
    assert monotone_pearson(np.exp(ranks), scores) == pytest.approx(1, abs=1e-9)
    assert monotone_pearson(-(ranks**3), scores) == pytest.approx(-1, abs=1e-9)


@given(points, st.integers(0, 1000))
def test_the_monotone_correlation_is_no_smaller_than_the_linear_one(values: list[float], seed: int) -> None:
    scores = np.random.default_rng(seed).normal(size=len(values))
    x = np.array(values)
    if np.sign(pearson(x, scores)) == np.sign(spearman(x, scores)):
        assert abs(monotone_pearson(x, scores)) >= abs(pearson(x, scores)) - 1e-9


def test_datasets_are_compared_relative_to_their_means_and_missing_values_are_counted() -> None:
    by_dataset = {"ball": score_set([-1.0, 0.0, 1.0], ((2, 0),)), "box": score_set([1.0, 0.0, -1.0], ((0, 2),))}
    values = {"ball": {"i0": 10.0, "i1": 11.0, "i2": 12.0}, "box": {"i0": 92.0, "i1": 91.0}}
    rows = correlation_rows(by_dataset, {"psnr": values}, np.random.default_rng(0))
    together = rows[-1]
    assert (together["dataset"], together["n"], together["n_missing"]) == ("all", 5, 1)
    assert together["spearman"] == pytest.approx(1, abs=1e-9)
    assert (together["pairs_different"], together["pairs_correct"]) == (1, 1.0)
    assert rows[1]["spearman"] is None


def test_a_constant_measure_has_no_correlation() -> None:
    (row,) = correlation_rows(
        {"ball": score_set([-1.0, 0.0, 1.0])},
        {"same": {"ball": dict.fromkeys(("i0", "i1", "i2"), 1.0)}},
        np.random.default_rng(0),
    )
    assert row["pearson"] is row["spearman"] is row["kendall"] is row["pairs_correct"] is None


@pytest.mark.slow
def test_an_analysis_reports_a_good_measure_with_its_interval() -> None:
    abilities = np.linspace(-1, 1, 5)
    votes = simulate_votes(StudyPlan(5, 3, 20), abilities, np.random.default_rng(1))
    values = {dataset: {item: float(abilities[int(item)]) for item in votes.items} for dataset in votes.datasets}
    analysis = analyse(votes, AnalysisSettings(measures={"truth": values}))
    row = analysis["measures"][-1]
    for each in analysis["measures"]:
        assert each["kendall_low"] <= each["kendall"] <= each["kendall_high"]
    assert row["pairs_correct_low"] == row["pairs_correct_high"] == 1.0
    assert row["dataset"] == "all"
    assert 0.8 < row["pearson_low"] <= row["pearson"] <= 1
    assert row["pairs_correct"] == 1.0


def test_measures_are_read_with_empty_cells_as_no_value(tmp_path: Path) -> None:
    path = tmp_path / "measures.csv"
    path.write_text("dataset,item,psnr,error_mm\nball,x,30.5,\nball,y,-1,2\n", encoding="utf-8")
    assert read_measures(path) == {"psnr": {"ball": {"x": 30.5, "y": -1.0}}, "error_mm": {"ball": {"y": 2.0}}}


@pytest.mark.parametrize(
    "text",
    ["item,psnr\nx,1\n", "dataset,item\nb,x\n", "dataset,item,psnr\nb,x,good\n", "dataset,item,psnr\nb,x,1\nb,x,2\n"],
)
def test_a_table_of_measures_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "measures.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(VotesError):
        read_measures(path)


def test_no_function_of_a_measure_tells_tied_values_apart() -> None:
    assert monotone_pearson(np.array([1.0, 1, 1, 2, 2, 2]), np.arange(6.0)) == pytest.approx(np.sqrt(27 / 35))
    lone = np.array([1.0, 1, 1, 1, 1, 2]), np.array([1, 2, 3, 4, 5, 5.01])
    assert monotone_pearson(*lone) == pytest.approx(pearson(*lone))


def test_a_measure_that_is_constant_in_each_dataset_has_no_correlation() -> None:
    scores = {"ball": score_set([0.3, -0.1, -0.2], ((0, 2),)), "box": score_set([0.2, 0.1, -0.3], ((0, 2),))}
    values = {"m": {name: dict.fromkeys(("i0", "i1", "i2"), level) for name, level in (("ball", 0.1), ("box", 0.5))}}
    overall = correlation_rows(scores, values, np.random.default_rng(0))[-1]
    assert overall["dataset"] == "all"
    assert [overall[name] for name in ("pearson", "spearman", "kendall", "pearson_monotone", "pairs_correct")] == [
        None
    ] * 5

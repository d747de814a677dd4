"""Which items differ by their ratings, and how well measures predict opinion scores."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ttest_rel

from app.analysis import analyse_ratings_file
from app.analysis.objective.against_scores import score_unit
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.score_sets import opinion_score_sets
from app.analysis.ratings.table import ComparisonTable
from app.analysis.reading.votes_table import VotesError
from tests.app.analysis.ratings.rated_tables import rating_table, simulated

CONDITIONS = ("c0", "c1", "c2", "c3", "c4", "c5")


def test_pairs_differ_by_a_paired_t_test_corrected_for_all_pairs_of_the_dataset() -> None:
    table, truth = simulated(np.random.default_rng(4), n_people=12, n_items=6)
    ratings = np.full((12, 6), np.nan)
    ratings[table.person, table.item] = table.rating
    pairs = list(combinations(range(6), 2))
    p_values = np.array([ttest_rel(ratings[:, a], ratings[:, b]).pvalue for a, b in pairs])
    expected, n_left = set(), len(pairs)
    for index in np.argsort(p_values):  # Holm (1979), step by step
        if p_values[index] * n_left >= 0.05:
            break
        expected.add(frozenset(pairs[index]))
        n_left -= 1
    scores = opinion_score_sets(table)["d0"]
    assert {frozenset(pair) for pair in scores.different} == expected
    assert 0 < len(expected) < len(pairs)
    assert len(scores.similar) == len(pairs) - len(expected)
    assert scores.scores == pytest.approx(ratings.mean(axis=0))
    assert all(scores.scores[better] > scores.scores[worse] for better, worse in scores.different)
    assert np.corrcoef(scores.scores, truth.quality)[0, 1] > 0.8


def test_a_difference_without_any_spread_says_nothing_about_other_people() -> None:
    scores = opinion_score_sets(rating_table([0, 0, 1, 1], [0, 1, 0, 1], [5, 3, 5, 3]))["d0"]
    assert (scores.different, scores.similar) == ([], [(0, 1)])


def test_a_pair_that_many_people_order_alike_is_different_also_without_any_spread() -> None:
    person, item = np.divmod(np.arange(30), 3)
    table = rating_table(person, item, np.array([5.0, 3.0, 3.0])[item])
    scores = opinion_score_sets(table)["d0"]
    assert sorted(scores.different) == [(0, 1), (0, 2)]  # ten of ten: a sign test has p = 2 / 2^10
    assert [set(pair) for pair in scores.similar] == [{1, 2}]


@pytest.fixture
def ratings(tmp_path: Path) -> Path:
    """Ratings of six conditions on two datasets by seven people who disagree by a grade."""
    path = tmp_path / "ratings.csv"
    rows = [
        f"p{person},{dataset},{name},{1 + (index * 4 + person % 3 + person % 2) / 6:.3f}"
        for person in range(7)
        for dataset in ("ball", "box")
        for index, name in enumerate(CONDITIONS)
    ]
    path.write_text("\n".join(["participant,dataset,condition,rating", *rows, ""]), encoding="utf-8")
    return path


@pytest.mark.slow
def test_measures_are_compared_with_opinion_scores_in_grades(ratings: Path, tmp_path: Path) -> None:
    measures = tmp_path / "measures.csv"
    rows = [f"{dataset},c{index},{index**3},{7 - index}" for dataset in ("ball", "box") for index in range(6)]
    measures.write_text("\n".join(["dataset,item,right,wrong", *rows, "box,c9,1,1", ""]), encoding="utf-8")
    analysis = analyse_ratings_file(ratings, tmp_path / "out", measures=measures)
    overall = {row["measure"]: row for row in analysis["measures"] if row["dataset"] == "all"}
    assert overall["right"]["spearman"] == pytest.approx(1)
    assert overall["wrong"]["spearman"] == pytest.approx(-1)
    assert (overall["right"]["n"], overall["right"]["n_conditions"]) == (12, 6)
    (compared,) = analysis["measure_comparisons"]
    assert {compared["measure_a"], compared["measure_b"]} == {"right", "wrong"}
    assert "measures: box/c9 not among the ratings and left out" in analysis["warnings"]
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Do objective measures predict the scores?" in report
    assert "RMSE is in grades" in report
    assert "score (grades), relative to the dataset's mean" in report.replace("’", "'").replace("&#39;", "'")


@pytest.mark.parametrize(("high", "unit"), [(3, "grades"), (100, "points")])
def test_the_unit_of_scores_is_that_of_the_scale(high: float, unit: str) -> None:
    person, a, b = np.array([0, 1]), np.array([0, 0]), np.array([1, 1])
    compared = ComparisonTable(("p0", "p1"), (("d", "x"), ("d", "y")), person, a, b, np.ones(2), a == 0, high)
    for tables in (
        analyse_comparisons(compared),
        analyse_ratings(rating_table([0, 0, 1, 1], [0, 1, 0, 1], [3, 1, 3, 2], scale=(0, high))),
    ):
        assert score_unit({"scores": [], **tables}) == unit


@pytest.mark.slow
def test_measures_are_compared_with_scores_of_comparison_ratings(tmp_path: Path) -> None:
    pairs = [(a, b) for a in range(5) for b in range(5) if a != b]
    rows = [f"p{person},ball,c{a},c{b},{(b - a) * 3 / 4:g}" for person in range(3) for a, b in pairs]
    path, measures = tmp_path / "ratings.csv", tmp_path / "measures.csv"
    path.write_text("\n".join(["participant,dataset,item_a,item_b,rating", *rows, ""]), encoding="utf-8")
    measures.write_text("dataset,item,right\n" + "".join(f"ball,c{i},{i}\n" for i in range(5)), encoding="utf-8")
    (row,) = analyse_ratings_file(path, tmp_path / "out", measures=measures)["measures"]
    assert row["pearson"] == pytest.approx(1)
    assert (tmp_path / "out" / "figures" / "measure_right.svg").exists()


def test_measures_of_other_items_are_refused_with_both_names(ratings: Path, tmp_path: Path) -> None:
    measures = tmp_path / "measures.csv"
    measures.write_text("dataset,item,psnr\nstatue,x,1\nstatue,y,2\n", encoding="utf-8")
    with pytest.raises(VotesError, match=r"measures statue/x, statue/y; the ratings are on c0, c1, .* in ball, box"):
        analyse_ratings_file(ratings, tmp_path / "out", measures=measures)
    assert not (tmp_path / "out").exists()

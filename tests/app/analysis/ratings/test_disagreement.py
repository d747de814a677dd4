"""Whether people who rate disagree, and who of them is unlike the others."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from app.analysis.findings.ratings import rating_findings
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.disagreement import rating_disagreement
from app.analysis.ratings.outliers import correlations_with_others, false_alarms
from app.analysis.ratings.table import RatingTable
from tests.app.analysis.ratings.rated_tables import rating_table

QUALITIES = np.array([1.0, 0.4, -0.4, -1.0])
CAMPS = np.where(np.arange(20) % 2 == 0, 1.0, -1.0)


def ratings_of(tastes: np.ndarray, n_datasets: int = 4, seed: int = 1, clickers: int = 0) -> RatingTable:
    """Return ratings in whole grades of people who like the first conditions (1), or the last (-1), or neither (0)."""
    rng = np.random.default_rng(seed)
    noise = 0.6 * rng.standard_normal((len(tastes), 4 * n_datasets))
    ratings = np.clip(np.rint(3 + tastes[:, None] * np.tile(QUALITIES, n_datasets) + noise), 1, 5)
    if clickers:
        ratings[-clickers:] = rng.integers(1, 6, (clickers, ratings.shape[1]))
    person, item = np.indices(ratings.shape)
    return rating_table(person.ravel(), item.ravel(), ratings.ravel(), n_datasets=n_datasets)


def said(table: RatingTable, about: str) -> str:
    return " ".join(row["text"] for row in rating_findings(analyse_ratings(table)) if row["about"] == about)


def test_two_camps_are_found_with_the_right_people_and_nobody_stands_out() -> None:
    tested = rating_disagreement(ratings_of(CAMPS))
    assert tested is not None
    camps = tested["camps"]
    assert {frozenset(names) for names in camps["participants"]} == {
        frozenset(f"p{person}" for person in range(start, 20, 2)) for start in (0, 1)
    }
    assert {camps["item_first"], camps["item_second"]} == {"c0", "c3"}
    assert camps["differences"] == pytest.approx([2.0, -2.0], abs=0.5)
    text = said(ratings_of(CAMPS), "disagreement")
    assert "two camps of 10 and 10 people" in text
    assert text.endswith("What holds over all describes neither camp.")
    assert said(ratings_of(CAMPS), "participants").startswith("Nobody of 20 stands out.")


def test_camps_differ_in_the_unit_of_the_scale() -> None:
    assert re.search(r"is \d\.\d\d grades in the one", said(ratings_of(CAMPS), "disagreement"))
    assert re.search(r"is \d\.\d\d points in the one", said(replace(ratings_of(CAMPS), high=100.0), "disagreement"))


def test_noise_is_no_disagreement() -> None:
    tested = [rating_disagreement(ratings_of(np.ones(12), seed=seed)) for seed in range(20)]
    assert sum(row is not None and row["p_value"] < 0.05 for row in tested) <= 3
    assert not any(row is not None and row["camps"] for row in tested)


def test_people_who_click_are_no_camp() -> None:
    tested = rating_disagreement(ratings_of(np.ones(20), clickers=6))
    assert tested is not None
    assert tested["camps"] is None


def test_an_opinion_on_one_dataset_cannot_be_told_from_noise() -> None:
    assert rating_disagreement(ratings_of(np.ones(12), n_datasets=1)) is None
    assert said(ratings_of(np.ones(12), n_datasets=1), "disagreement") == ""


def test_camps_are_found_where_ratings_are_missing() -> None:
    whole = ratings_of(CAMPS, n_datasets=8)
    kept = np.random.default_rng(3).random(len(whole)) < 0.6
    part = replace(whole, person=whole.person[kept], item=whole.item[kept], rating=whole.rating[kept])
    tested = rating_disagreement(part)
    assert tested is not None
    assert tested["camps"] is not None


def test_honest_people_hardly_ever_stand_out_where_conditions_look_alike() -> None:
    tables = [ratings_of(np.full(14, 0.3), seed=seed) for seed in range(20)]
    alarms = [false_alarms(correlations_with_others(table)) for table in tables]
    assert sum(value is not None and value < 0.05 for study in alarms for value in study) <= 3
    assert all(not row["flags"] for row in analyse_ratings(tables[0])["raters"])


def test_who_clicks_stands_out_with_the_evidence() -> None:
    table = ratings_of(np.ones(20), n_datasets=8, clickers=2)
    assert [row["participant"] for row in analyse_ratings(table)["raters"] if row["flags"]] == ["p18", "p19"]
    text = said(table, "participants")
    assert "The ratings of p18 correlate with the others' means by" in text
    assert "among 20 honest people" in text


def test_one_grade_throughout_stands_out() -> None:
    table = ratings_of(np.ones(8))
    table = replace(table, rating=np.where(table.person == 2, 4.0, table.rating))
    assert [row["flags"] for row in analyse_ratings(table)["raters"]][2] == ["the same rating throughout"]


def test_several_far_below_do_not_hide_each_other() -> None:
    alarms = false_alarms([0.8, 0.75, 0.82, 0.78, 0.81, 0.79, 0.77, 0.83, 0.0, 0.05, None])
    assert [value is not None and value < 0.05 for value in alarms] == [False] * 8 + [True, True, False]
    assert false_alarms([0.8, 0.1]) == [None, None]


def test_a_correlation_with_the_others_leaves_ones_own_ratings_out() -> None:
    table = ratings_of(np.ones(3))
    values = table.rating.reshape(3, -1)
    expected = [np.corrcoef(values[j], np.delete(values, j, axis=0).mean(axis=0))[0, 1] for j in range(3)]
    assert correlations_with_others(table) == pytest.approx(expected)

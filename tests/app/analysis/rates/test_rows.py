"""Scores against sizes in a whole analysis: tables, intervals over participants, the figure and its section."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.analysis import AnalysisSettings, analyse, votes_from_rows
from app.analysis.comparisons.comparison import compare
from app.analysis.rates.rows import rate_differences, rate_rows
from app.analysis.report.rate_charts import rates_chart
from app.analysis.report.write import write_analysis

METHODS = {"old": 0.0, "new": 0.8}
LEVELS = {"0.25": -1.0, "0.5": 0.0, "1": 0.5}
ITEMS = {f"{method}_{level}": (method, level) for method in METHODS for level in LEVELS}
SIZES = {item: 1e6 * float(level) * (1.5 if method == "new" else 1) for item, (method, level) in ITEMS.items()}
FACTORS = {
    "method": {item: method for item, (method, _) in ITEMS.items()},
    "share": {item: level for item, (_, level) in ITEMS.items()},
}


def votes(n_participants: int, seed: int = 0, datasets: tuple[str, ...] = ("ball", "box")) -> list[dict[str, Any]]:
    rng = np.random.default_rng(seed)
    strength = {item: METHODS[method] + LEVELS[level] for item, (method, level) in ITEMS.items()}
    names = list(ITEMS)
    rows = []
    for person in range(n_participants):
        taste = rng.normal(scale=0.4)  # for one of the methods
        for dataset in datasets:
            for i, a in enumerate(names):
                for b in names[i + 1 :]:
                    ahead = strength[a] - strength[b] + taste * (a.startswith("new") - float(b.startswith("new")))
                    choice = "a" if rng.random() < 1 / (1 + np.exp(-ahead)) else "b"
                    row = {"participant": f"P{person}", "dataset": dataset, "item_a": a, "item_b": b}
                    rows.append(row | {"choice": choice})
    return rows


def settings(**changes: Any) -> AnalysisSettings:
    sizes = {"ball": SIZES, "box": {item: 4 * size for item, size in SIZES.items()}}
    return AnalysisSettings(factors=FACTORS, measures={"bytes": sizes}, better={"bytes": "lower"}, **changes)


@pytest.fixture(scope="module")
def analysis() -> dict[str, Any]:
    return analyse(votes_from_rows(votes(24)), settings())


def test_every_condition_has_its_size_and_score_on_each_dataset_and_on_all(analysis: dict[str, Any]) -> None:
    rows = analysis["rates"]
    assert [row["dataset"] for row in rows] == ["ball"] * 6 + ["box"] * 6 + ["all"] * 6
    (pooled,) = [row for row in rows if row["dataset"] == "all" and row["item"] == "new_0.5"]
    assert pooled["bytes"] == pytest.approx(2 * SIZES["new_0.5"])
    assert (pooled["method"], pooled["level"]) == ("new", 0.5)
    (score,) = [
        row
        for row in analysis["scores"]
        if (row["comparison"], row["dataset"], row["item"]) == ("all", "all", "new_0.5")
    ]
    assert [pooled[name] for name in ("score", "ci_low", "ci_high")] == [
        score[name] for name in ("score", "ci_low", "ci_high")
    ]
    front = [row["item"] for row in rows if row["dataset"] == "all" and row["is_on_front"]]
    assert "old_0.25" in front
    assert "new_1" in front


def test_a_condition_whose_size_is_unknown_on_a_dataset_has_none_over_all() -> None:
    sizes = {"ball": SIZES, "box": {item: 4 * size for item, size in SIZES.items() if item != "new_1"}}
    scores = [{"dataset": "all", "item": item, "score": 0.0} for item in ITEMS]
    rows = rate_rows(scores, {"measures": {"bytes": sizes}, "factors": FACTORS})
    assert {row["item"] for row in rows} == set(ITEMS) - {"new_1"}


def test_replicates_of_people_who_voted_alike_give_no_interval() -> None:
    alike = [row | {"participant": f"P{person}"} for person in range(14) for row in votes(1)]
    options = settings(bootstrap=200)
    rows = rate_differences(list(compare(votes_from_rows(alike), options)), options.as_dict())
    assert rows
    assert {row["ci_low"] for row in rows} == {None}


def test_size_is_no_measure_that_should_predict_the_scores(analysis: dict[str, Any]) -> None:
    assert analysis["measures"] == []
    assert not [warning for warning in analysis["warnings"] if "bytes" in warning]


def test_methods_are_compared_at_equal_size_with_intervals(analysis: dict[str, Any]) -> None:
    assert [(row["dataset"], row["method_a"], row["method_b"]) for row in analysis["rate_differences"]] == [
        (dataset, "old", "new") for dataset in ("ball", "box", "all")
    ]
    for row in analysis["rate_differences"]:
        assert row["ci_low"] < row["difference"] < row["ci_high"]
        assert row["difference"] == pytest.approx(-0.4, abs=0.3)  # 0.8 better, of which 1.5 times the bytes pay a part
        assert row["bytes_high"] / row["bytes_low"] == pytest.approx(1 / 0.25 / 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("bootstrap", [0, 400])
def test_intervals_hold_for_other_participants(bootstrap: int) -> None:
    """Of studies of 20 people each, nearly all intervals hold the difference that many people have."""
    (everybody,) = [r for r in analysed(200, 999, 0)["rate_differences"] if r["dataset"] == "all"]
    held = []
    for seed in range(12):
        (row,) = [row for row in analysed(20, seed, bootstrap)["rate_differences"] if row["dataset"] == "all"]
        held.append(row["ci_low"] <= everybody["difference"] <= row["ci_high"])
    assert sum(held) >= 9


def analysed(n_participants: int, seed: int, bootstrap: int) -> dict[str, Any]:
    table = votes_from_rows(votes(n_participants, seed, ("ball",)))
    return analyse(table, settings(by_dataset=False, bootstrap=bootstrap))


@pytest.mark.slow
def test_results_hold_the_tables_the_figure_and_its_section(analysis: dict[str, Any], tmp_path: Path) -> None:
    write_analysis(analysis, tmp_path)
    assert (tmp_path / "rates.csv").read_text().startswith("dataset,item,method,level,bytes,score,ci_low")
    assert (tmp_path / "rate_differences.csv").read_text().count("\n") == 4
    assert (tmp_path / "figures/rates.svg").stat().st_size > 5000
    report = (tmp_path / "report.html").read_text()
    assert "What does a better score cost in bytes?" in report
    assert "Methods at equal size" in report


def test_nothing_is_drawn_where_sizes_are_not_known() -> None:
    plain = analyse(votes_from_rows(votes(6)), AnalysisSettings(factors=FACTORS))
    assert (plain["rates"], plain["rate_differences"]) == ([], [])
    assert rates_chart(plain) is None

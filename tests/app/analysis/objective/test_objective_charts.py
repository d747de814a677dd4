"""The figures of measures: every name whole, no two on one place, the best measure first."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from app.analysis import AnalysisSettings, analyse
from app.analysis.charts import chart_svg
from app.analysis.objective.charts import LETTER_WIDTH, Box, _labels, _places, measure_chart, ranking_chart
from app.analysis.power import StudyPlan, simulate_votes

LONG = "a_measure_with_a_name_that_is_long_enough_to_be_cut_by_a_chart"


@pytest.fixture(scope="module")
def analysis() -> dict[str, Any]:
    """Of votes on six items and two datasets, with a good measure, a poor one, and one without direction."""
    abilities, rng = np.linspace(-1, 1, 6), np.random.default_rng(3)
    votes = simulate_votes(StudyPlan(6, 2, 12), abilities, rng)

    def measure(noise: float, sign: float) -> dict[str, dict[str, float]]:
        return {
            dataset: {item: sign * abilities[int(item)] + noise * rng.normal() for item in votes.items}
            for dataset in votes.datasets
        }

    measures = {"poor": measure(9.0, 1.0), LONG: measure(0.1, -1.0), "unknown": measure(2.0, 1.0)}
    return analyse(votes, AnalysisSettings(measures=measures, better={"poor": "higher", LONG: "lower"}))


def test_the_ranking_names_every_measure_whole_the_best_first(analysis: dict[str, Any]) -> None:
    svg = chart_svg(ranking_chart(analysis))
    assert svg.count(f">{LONG}<") == 1
    assert svg.index(f">{LONG}<") < svg.index(">poor<")
    assert ">unknown *<" in svg
    assert "no stated direction" in svg
    assert "…" not in svg


def test_the_ranking_turns_a_measure_whose_less_is_better(analysis: dict[str, Any]) -> None:
    row = next(row for row in analysis["measures"][::-1] if row["measure"] == LONG)
    panel = ranking_chart(analysis).hconcat[1]
    (drawn,) = (value for value in panel.layer[2].data.values if value["measure"] == LONG)
    assert drawn["value"] == -row["spearman"] > 0.9
    assert (drawn["low"], drawn["high"]) == (-row["spearman_low"], -row["spearman_high"])


def test_a_measures_figure_has_all_its_points_the_curve_and_the_numbers(analysis: dict[str, Any]) -> None:
    chart = measure_chart(analysis, LONG)
    points = chart.layer[2].data.values
    assert len(points) == 12
    for dataset in ("0", "1"):
        assert sum(point["x"] for point in points if point["dataset"] == dataset) == pytest.approx(0)
    heights = [value["y"] for value in chart.layer[0].data.values]
    assert heights == sorted(heights, reverse=True)
    svg = chart_svg(chart)
    assert "lower should be better" in svg
    assert "PLCC −0.9" in svg or "PLCC −1.0" in svg


def test_a_figure_of_an_unknown_measure_is_none(analysis: dict[str, Any]) -> None:
    assert measure_chart(analysis, "absent") is None
    assert ranking_chart(analysis | {"measures": []}) is None


def test_labels_stand_apart_from_each_other_and_inside_the_figure() -> None:
    rng = np.random.default_rng(1)
    points = [
        {"item": f"method_{k}", "x": float(x), "y": float(y), "low": float(y), "high": float(y)}
        for k, (x, y) in enumerate(rng.uniform(0, 1, (40, 2)))
    ]
    boxes = []
    for layer in _labels(points, [0.0, 1.0], [0.0, 1.0]):
        side = "right" if layer.mark.align == "left" else "left" if layer.mark.align == "right" else layer.mark.baseline
        place = {"bottom": "above", "top": "below"}.get(side, side)
        boxes += [
            _places(point["x"] * 420, (1 - point["y"]) * 300, len(point["item"]) * LETTER_WIDTH)[place]
            for point in layer.data.values
        ]
    assert 5 < len(boxes) < 40
    assert not any(a.meets(b) for a, b in combinations(boxes, 2))
    assert all(box.left >= 0 and box.right <= 420 and box.top >= 0 and box.bottom <= 300 for box in boxes)


def test_boxes_meet_where_they_overlap() -> None:
    box = Box(0, 0, 10, 10)
    assert box.meets(Box(9, 9, 20, 20))
    assert not box.meets(Box(10, 0, 20, 10))

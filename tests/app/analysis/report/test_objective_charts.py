"""The figures of measures: every name whole, no two on one place, the best measure first."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from app.analysis import AnalysisSettings, analyse
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.drawing.charts_in_common import chart_svg, labels_of, text_width
from app.analysis.objective.labels import LABEL_SIZE, LETTER_HEIGHT, Box, Frame, place_names
from app.analysis.report.objective_charts import measure_chart, ranking_chart

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
    lines = labels_of([LONG]).lines[LONG]
    assert "".join(lines) == LONG
    assert all(svg.count(f">{line}<") == 1 for line in lines)
    assert svg.index(f">{lines[0]}<") < svg.index(">poor<")
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


def test_predicted_and_voted_jod_stand_in_one_unit(analysis: dict[str, Any]) -> None:
    name = analysis["measures"][0]["measure"]
    renamed = {
        **analysis,
        "settings": {**analysis["settings"], "measures": {"cvvdp": analysis["settings"]["measures"][name]}},
        "measures": [{**row, "measure": "cvvdp"} for row in analysis["measures"] if row["measure"] == name],
    }
    plain, in_jod = (measure_chart(each, key).to_dict() for each, key in ((analysis, name), (renamed, "cvvdp")))
    points = [
        [row["y"] for layer in chart["layer"] for row in layer["data"]["values"] if "item" in row]
        for chart in (plain, in_jod)
    ]
    assert np.allclose(np.array(points[0]) / np.log(3), points[1])
    assert "score (JOD)" in str(in_jod)
    assert len(in_jod["layer"]) == len(plain["layer"]) + 1  # the line of equal differences


def test_a_figure_of_an_unknown_measure_is_none(analysis: dict[str, Any]) -> None:
    assert measure_chart(analysis, "absent") is None
    assert ranking_chart(analysis | {"measures": []}) is None


@pytest.mark.parametrize("name", ["m{}", "a method with a long name, number {}"])
def test_labels_stand_apart_inside_the_figure_and_are_numbers_where_names_have_no_room(name: str) -> None:
    rng = np.random.default_rng(1)
    points = [
        {"item": name.format(k), "x": float(x), "y": float(y), "low": float(y), "high": float(y)}
        for k, (x, y) in enumerate(rng.uniform(0, 1, (30, 2)))
    ]
    frame = Frame([0.0, 1.0], [0.0, 1.0], 420, 300)
    labels, numbered = place_names(points, frame)
    assert len(labels) == 30
    best_first = [point["item"] for point in sorted(points, key=lambda point: -point["y"])]
    assert numbered == ([] if name == "m{}" else best_first)
    boxes = []
    for label, point in zip(labels, points, strict=True):
        assert label["text"] == (str(numbered.index(point["item"]) + 1) if numbered else point["item"])
        half, (x, y) = text_width(label["text"], LABEL_SIZE) / 2, frame.pixel(label["label_x"], label["label_y"])
        boxes.append(Box(x - half, y - LETTER_HEIGHT / 2, x + half, y + LETTER_HEIGHT / 2))
    tolerance = 1e-9
    assert not any(a.meets(b._replace(left=b.left + tolerance)) and b.meets(a) for a, b in combinations(boxes, 2))
    assert all(
        box.left >= -tolerance
        and box.right <= 420 + tolerance
        and box.top >= -tolerance
        and box.bottom <= 300 + tolerance
        for box in boxes
    )


def test_a_measures_figure_lists_the_names_that_have_no_room_at_their_points(analysis: dict[str, Any]) -> None:
    items = {str(k): f"a reconstruction whose name takes half of a figure, the one with number {k}" for k in range(6)}
    renamed = analysis | {
        "scores": [row | {"item": items[row["item"]]} for row in analysis["scores"]],
        "settings": analysis["settings"]
        | {
            "measures": {
                LONG: {
                    dataset: {items[item]: value for item, value in values.items()}
                    for dataset, values in analysis["settings"]["measures"][LONG].items()
                }
            }
        },
    }
    svg = chart_svg(measure_chart(renamed, LONG, 420))
    assert all(svg.count(f">{place}. a reconstruction") == 1 for place in range(1, 7))
    assert all(f"number {item}<" in svg for item in items)


def test_boxes_meet_where_they_overlap() -> None:
    box = Box(0, 0, 10, 10)
    assert box.meets(Box(9, 9, 20, 20))
    assert not box.meets(Box(10, 0, 20, 10))

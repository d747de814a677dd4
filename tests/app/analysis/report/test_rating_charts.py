"""The figures of ratings: every item and participant drawn, with the ends of its interval."""

from __future__ import annotations

import numpy as np
import pytest

from app.analysis.drawing.charts_in_common import chart_svg
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.report.rating_charts import (
    alignment_chart,
    differential_chart,
    opinion_chart,
    raters_chart,
    rating_charts,
)
from tests.app.analysis.ratings.rated_tables import known_table, rating_table, simulated


def test_every_item_is_drawn_with_both_estimates_and_intervals() -> None:
    table, _ = simulated(np.random.default_rng(2), 30, 6, n_datasets=2)
    tables = analyse_ratings(table)
    panels = opinion_chart(tables)["hconcat"]
    assert [panel["title"] for panel in panels] == ["d0", "d1"]
    drawn = [value for panel in panels for value in panel["data"]["values"]]
    expected = [(row["dataset"], row["ci_low"], row["ci_high"]) for row in tables["rating_items"]]
    assert [(v["dataset"], v["low"], v["high"]) for v in drawn if v["estimate"] == "mean"] == expected
    assert sum(value["estimate"] == "subject model, these people" for value in drawn) == 6


def test_the_reference_is_marked_and_left_out_of_the_differences() -> None:
    rating = np.array([3, 5, 2, 5, 4, 4, 3, 4, 2, 5, 1, 4], float)
    table = rating_table(np.repeat(range(6), 2), [0, 1] * 6, rating, protocol="acr-hr", references=(1,))
    tables = analyse_ratings(table)
    assert ">c1 (ref.)<" in chart_svg(opinion_chart(tables))
    svg = chart_svg(differential_chart(tables))
    assert ">c0<" in svg
    assert "c1" not in svg


def test_participants_are_ordered_by_inconsistency_and_who_stands_out_is_filled() -> None:
    tables = analyse_ratings(known_table())
    next(row for row in tables["raters"] if row["participant"] == "p7")["flags"].append("ratings unlike the others'")
    chart = raters_chart(tables)
    values = chart.hconcat[1].data.values
    named = {value["participant"] for value in values if value["named"] == "stands out"}
    assert named == {"p7"}
    svg = chart_svg(chart)
    assert svg.index(">p4<") < svg.index(">p7<")


@pytest.mark.parametrize("tables", [{}, {"rating_items": [], "rating_model": [], "raters": []}])
def test_there_is_nothing_to_draw_without_ratings(tables: dict[str, list[object]]) -> None:
    assert [chart for _, _, chart in rating_charts(tables)] == [None] * 5


def test_the_caption_of_qualities_promises_no_intervals_where_there_are_none() -> None:
    row = {"dataset": "", "condition": "c0", "quality": 3.0, "quality_low": None, "quality_high": None}
    analysis = {"alignment_items": [row, row | {"condition": "c1"}]}
    captions = {name: caption for name, caption, chart in rating_charts(analysis) if chart is not None}
    assert captions == {"alignment": "Qualities from ratings and votes together without intervals (there are none)."}


def test_a_panel_of_ratings_without_a_dataset_is_not_that_of_all_datasets() -> None:
    row = {"dataset": "", "condition": "c0", "quality": 3.0, "quality_low": 2.0, "quality_high": 4.0}
    assert "all datasets" not in chart_svg(alignment_chart({"alignment_items": [row]}))

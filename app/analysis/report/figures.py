"""Draw every figure of an analysis, with the caption that says what it shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from app.analysis.drawing.charts_in_common import (
    FULL,
    chart_svg,
    drawn_width,
    intervals_shown,
    letters_without_font,
)
from app.analysis.drawing.figure_code import figure_code, level_rows, names_by_file
from app.analysis.objective.prediction import measures_by_rank
from app.analysis.reading.votes_table import ALL
from app.analysis.report.objective_charts import measure_chart, ranking_chart
from app.analysis.report.rate_charts import rates_chart
from app.analysis.report.rating_charts import rating_charts
from app.analysis.report.score_charts import groups_chart, levels_chart, scores_chart
from app.analysis.report.vote_charts import preference_chart, residual_chart, response_chart, triads_chart

Row = Mapping[str, Any]

WIDE = 0.8  # of two columns
NAMING = ("scores", "groups", "measures", "observers", "rating_items", "raters", "comparison_items")  # tables
NAMES = ("item", "condition", "dataset", "group", "measure", "participant")  # columns that figures write out


@dataclass(frozen=True)
class Figure:
    """A figure that was drawn: its file's name, its caption, its SVG, and by language the code that draws it anew."""

    name: str
    caption: str
    svg: str
    code: Mapping[str, str]

    @property
    def is_wide(self) -> bool:
        """Does the figure fill most of two columns?"""
        return drawn_width(self.svg) > WIDE * FULL


def drawn_figures(analysis: Mapping[str, Any], width: int = FULL) -> Iterator[Figure]:
    """Draw every figure that there is something in, so many pixels wide."""
    for name, caption, chart in named_charts(analysis, width):
        if chart is not None:
            yield Figure(name, caption, chart_svg(chart, width), figure_code(name, analysis))


def named_charts(analysis: Mapping[str, Any], width: int = FULL) -> Iterator[tuple[str, str, Any]]:
    """Yield every figure's name, caption and chart; the chart is None where there is nothing to draw.

    Parameters
    ----------
    analysis : the content of analysis.json
    width : of the figures, in pixels
    """
    for name, comparison in names_by_file(analysis["scores"], "comparison").items():
        rows = [row for row in analysis["scores"] if row["comparison"] == comparison]
        if comparison == ALL:
            yield "scores", f"Scores of all conditions {_ends(rows)}", scores_chart(analysis, comparison, width)
            continue
        levels = level_rows(analysis, comparison)
        what = "Effects of {}, all else equal," if any("effect" in row for row in levels) else "Scores by {}"
        chart = levels_chart(analysis, comparison, width)
        yield (
            f"levels_{name}",
            f"{what.format(comparison)} on each dataset {intervals_shown(levels)}.{_together(rows)}",
            chart,
        )
        what = f"Scores by {comparison}, from pairs that differ in nothing else,"
        yield f"scores_{name}", f"{what} {_ends(rows)}", scores_chart(analysis, comparison, width)
    preferences = "Votes for the row's condition against the column's; columns have the numbers of the rows."
    yield "preferences", preferences, preference_chart(analysis, width=width)
    yield "residuals", "Where the model and the votes differ.", residual_chart(analysis, width=width)
    yield from rating_charts(analysis, width)
    yield "measures", "How well each measure predicts the scores.", ranking_chart(analysis, width)
    files = {measure: name for name, measure in names_by_file(analysis["measures"], "measure").items()}
    for measure in measures_by_rank(analysis["measures"]):
        yield f"measure_{files[measure]}", f"Score against {measure}.", measure_chart(analysis, measure, width)
    yield (
        "rates",
        f"Score against the size of the models, {intervals_shown(analysis.get('rates', []))}.",
        rates_chart(analysis, width),
    )
    for name, grouping in names_by_file(analysis["groups"], "grouping").items():
        rows = [row for row in analysis["groups"] if row["grouping"] == grouping]
        caption = f"Scores by {grouping}, all votes together, {intervals_shown(rows)}."
        yield f"group_{name}", caption, groups_chart(analysis, grouping, width)
    yield "response_times", "Response times of each participant.", response_chart(analysis, width)
    yield "triads", "Circular triads of each participant over all datasets.", triads_chart(analysis, width)


def _ends(rows: Sequence[Row]) -> str:
    """End a caption: are there intervals, letters and penalised estimates, and what are the panels?"""
    letters = (
        " Conditions that share a letter are not told apart (Holm over all pairs; of datasets, over all of them, which "
        "is cautious)."
        if any(row["letters"] for row in rows)
        else ""
    )
    penalised = " Hollow points are penalised estimates." if any(row["penalty"] for row in rows) else ""
    return f"{intervals_shown(rows)}.{penalised}{letters}{_together(rows)}"


def _together(rows: Sequence[Row]) -> str:
    """Say in which order datasets stand, and that all votes together are one fit, not a mean."""
    if len({row["dataset"] for row in rows} - {ALL}) < 2:
        return ""
    return " All votes together: one fit to them, not the mean of the datasets. Datasets in alphabetical order."


def font_warnings(analysis: Mapping[str, Any]) -> Iterator[str]:
    """Yield a warning if no font of this machine draws some letters of the names."""
    rows = (row for table in NAMING for row in analysis.get(table, ()))
    if missing := letters_without_font(row[column] for row in rows for column in NAMES if column in row):
        yield (
            f"figures: no font of this machine has the letters {missing[:20]}; they are boxes in PNG and PDF until a "
            "font that has them is installed, such as Noto Sans CJK"
        )

"""Draw objective measures against the scores: a chart for each measure, and one that ranks them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt
import numpy as np

from app.analysis.drawing.charts_in_common import (
    FULL,
    GAP,
    INK,
    LINE,
    MARGIN,
    PALETTE,
    colour_by,
    dashed_line,
    labels_of,
    shape_by,
    text_width,
    wrapped,
)
from app.analysis.model.scales import LOG_ODDS_PER_JOD
from app.analysis.objective.against_scores import compared_scores, score_unit
from app.analysis.objective.labels import LABEL_SIZE, Frame, place_names
from app.analysis.objective.logistic import Logistic
from app.analysis.objective.prediction import SHARES, directed, measures_by_rank
from app.analysis.reading.phrases import with_interval
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]

HEIGHT = 300  # pixels
AXIS = 60  # pixels of the vertical axis with its title
AROUND = 0.08  # of the range, around the points
CURVE_STEPS = 80
INDENT = 16  # pixels, of a name's further lines
ROW_HEIGHT = 17  # pixels of a measure in the ranking
PREDICTS_JOD = "cvvdp"  # a measure in the unit that scores have, too: its figure compares both in JOD
RANKED = (  # column, title, what a measure without information gets
    ("pearson_logistic", "PLCC, logistic fit", 0.0),
    ("spearman", "SROCC", 0.0),
    ("auc_better_worse", "AUC, better or worse", 0.5),
)


def measure_chart(analysis: Mapping[str, Any], measure: str, width: int = FULL) -> Any:
    """Draw the scores with their intervals against a measure, with the logistic curve; colour and shape tell datasets
    apart. With several datasets, both are relative to the dataset's mean, as they are analysed. The items' names stand
    at the points, or, where there is no room for them all, numbers, with a list of the names below.

    Parameters
    ----------
    analysis : the content of analysis.json
    measure : its name
    width : of the figure, in pixels

    Returns
    -------
    altair chart, or None if no item has both a score and a value
    """
    rows = _points(analysis, measure)
    if not rows:
        return None
    overall = [row for row in analysis["measures"] if row["measure"] == measure][-1]
    names = list(dict.fromkeys(row["dataset"] for row in rows))
    relative = ", relative to the dataset's mean" if len(names) > 1 else ""
    x_domain, y_domain = _domain([row["x"] for row in rows]), _domain([row[k] for row in rows for k in ("low", "high")])
    x = alt.X(
        "x:Q", title=f"{measure}{relative}", scale=alt.Scale(domain=x_domain, nice=False), axis=alt.Axis(tickCount=6)
    )
    in_jod = _per_unit(analysis, measure) != 1
    y_title = f"score ({'JOD' if in_jod else score_unit(analysis)}){relative}"
    y_scale = alt.Scale(domain=y_domain, nice=False)
    y_axis = alt.Axis(titlePadding=10)
    color, shape = colour_by("dataset", "dataset", names, width), shape_by("dataset", "dataset", names, width)
    base = alt.Chart(alt.Data(values=rows)).encode(x=x)
    bars = base.mark_rule(opacity=0.45).encode(
        y=alt.Y("low:Q", title=y_title, scale=y_scale, axis=y_axis), y2=alt.Y2("high:Q"), color=color
    )
    points = base.mark_point(size=60, filled=True, opacity=1).encode(
        y=alt.Y("y:Q", title=y_title, scale=y_scale, axis=y_axis), color=color, shape=shape
    )
    across = width - AXIS - MARGIN
    labels, numbered = place_names(rows, Frame(x_domain, y_domain, across, HEIGHT))
    curve = _curve(overall, rows, x_domain, _per_unit(analysis, measure))
    layers = [*([_one_to_one(rows, x_domain)] if in_jod else []), *curve, bars, points, *_label_layers(labels)]
    title = alt.TitleParams(f"Score against {measure}", subtitle=_subtitle(overall))
    drawn = alt.layer(*layers).properties(width=across, height=HEIGHT, title=title)
    if not numbered:
        return drawn
    return alt.vconcat(drawn, _key(numbered, across)).resolve_scale(color="independent", shape="independent")


def _points(analysis: Mapping[str, Any], measure: str) -> list[dict[str, Any]]:
    """Return the points that were compared, relative to their dataset's mean if there are several datasets."""
    values = analysis["settings"]["measures"].get(measure, {})
    compared = [row["dataset"] for row in analysis["measures"] if row["measure"] == measure]
    single = [name for name in compared if name != ALL] or compared
    points, per_unit = [], _per_unit(analysis, measure)
    for name in single:
        rows = [
            row
            for row in compared_scores(analysis)
            if row["dataset"] == name and row["score"] is not None and row["item"] in values.get(name, {})
        ]
        means = [0.0, 0.0]
        if len(single) > 1 and rows:
            means = [
                float(np.mean([values[name][row["item"]] for row in rows])),
                float(np.mean([r["score"] for r in rows])),
            ]
        for row in rows:
            low, high = (row["score"] if row[end] is None else row[end] for end in ("ci_low", "ci_high"))
            place = {"dataset": name, "item": row["item"], "x": values[name][row["item"]] - means[0]}
            ends = {"y": row["score"], "low": low, "high": high}
            points.append(place | {key: (value - means[1]) / per_unit for key, value in ends.items()})
    return points


def _per_unit(analysis: Mapping[str, Any], measure: str) -> float:
    """Return how many of the scores' units the figure's has: log-odds in a JOD where the measure predicts JOD."""
    return LOG_ODDS_PER_JOD if measure == PREDICTS_JOD and analysis["scores"] else 1.0


def _one_to_one(points: Sequence[Row], domain: Sequence[float]) -> Any:
    """Draw the line on which scores differ by as much as the measure predicts."""
    means = [float(np.mean([point[side] for point in points])) for side in ("x", "y")]
    values = [{"x": x, "y": x - means[0] + means[1]} for x in domain]
    line = alt.Chart(alt.Data(values=values)).mark_line(color="#777777", strokeDash=[4, 3], strokeWidth=1, clip=True)
    return line.encode(x=alt.X("x:Q"), y=alt.Y("y:Q"))


def _domain(values: Sequence[float]) -> list[float]:
    low, high = min(values), max(values)
    margin = (high - low) * AROUND or abs(high) * AROUND or 1.0
    return [low - margin, high + margin]


def _curve(row: Row, points: Sequence[Row], domain: Sequence[float], per_unit: float) -> list[Any]:
    """Return the layer of the logistic curve, none where there is no fit; the fit is in the scores' unit."""
    if row["logistic_bottom"] is None:
        return []
    bottom, top, middle, width = (row[f"logistic_{name}"] for name in ("bottom", "top", "middle", "width"))
    fit = Logistic(bottom, top, middle, width, correlation=row["pearson_logistic"], status=row["logistic_status"])
    x = np.linspace(domain[0], domain[1], CURVE_STEPS)
    # The fit is to values and scores less their means, also where a single dataset is drawn as it is.
    means = [float(np.mean([point[side] for point in points])) for side in ("x", "y")]
    y = fit(x - means[0]) / per_unit + means[1]
    values = [{"x": float(a), "y": float(b)} for a, b in zip(x, y, strict=True)]
    return [
        alt.Chart(alt.Data(values=values))
        .mark_line(color="#777777", strokeWidth=1.4, clip=True)
        .encode(x=alt.X("x:Q"), y=alt.Y("y:Q"))
    ]


def _label_layers(labels: Sequence[Row]) -> list[Any]:
    """Return the layers of placed labels, and of lines to those that stand farther off."""
    texts = alt.Chart(alt.Data(values=labels)).mark_text(fontSize=LABEL_SIZE, color=INK, limit=0, baseline="middle")
    far = [label for label in labels if label["is_far"]]
    lines = alt.Chart(alt.Data(values=far)).mark_rule(color="#999999", strokeWidth=0.7)
    return [
        *([lines.encode(x=alt.X("x:Q"), y=alt.Y("y:Q"), x2=alt.X2("near_x:Q"), y2=alt.Y2("near_y:Q"))] if far else []),
        *([texts.encode(x=alt.X("label_x:Q"), y=alt.Y("label_y:Q"), text=alt.Text("text:N"))] if labels else []),
    ]


def _key(items: Sequence[str], width: float) -> Any:
    """Return the list of items with their numbers, in columns below a figure of a width in pixels."""
    entries = [f"{number}. {item}" for number, item in enumerate(items, start=1)]
    longest = max(text_width(entry, LABEL_SIZE) for entry in entries) + GAP
    n_columns = max(1, int(width // longest))
    lines = [  # several of a name only where there is a single column
        (line, INDENT * bool(number)) for entry in entries for number, line in enumerate(wrapped(entry, width - INDENT))
    ]
    n_rows = -(-len(lines) // n_columns)
    values = [
        {"line": line, "x": place // n_rows * width / n_columns + indent, "y": place % n_rows * LINE}
        for place, (line, indent) in enumerate(lines)
    ]
    chart = alt.Chart(alt.Data(values=values), view=alt.ViewBackground(stroke=None), width=width, height=n_rows * LINE)
    return chart.mark_text(fontSize=LABEL_SIZE, color=INK, limit=0, align="left", baseline="top").encode(
        x=alt.X("x:Q", axis=None, scale=alt.Scale(domain=[0, width], nice=False)),
        y=alt.Y("y:Q", axis=None, scale=alt.Scale(domain=[n_rows * LINE, 0], nice=False)),
        text=alt.Text("line:N"),
    )


def _subtitle(row: Row) -> list[str]:
    numbers = [
        f"{name} {with_interval(row, key, key)}"
        for name, key in (("PLCC", "pearson_logistic"), ("SROCC", "spearman"))
        if row[key] is not None
    ]
    better = f"{row['better']} should be better" if row["better"] else "no stated direction"
    return [", ".join(numbers) or "too few points for a correlation", better]


def ranking_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw how well each measure predicts the scores over all datasets, with 95 % intervals, the best first.

    Correlations are positive where a measure predicts in the direction that it states. Points are filled where the
    interval excludes what a measure without information gets.

    Parameters
    ----------
    analysis : the content of analysis.json
    width : of the figure, in pixels

    Returns
    -------
    altair chart, or None without measures that can be compared
    """
    last = measures_by_rank(analysis["measures"])
    names = [name for name, row in last.items() if row["spearman"] is not None]
    if not names:
        return None
    labels = [name if last[name]["better"] else f"{name} *" for name in names]
    panels: list[Any] = []
    shown = [ranked for ranked in RANKED if any(last[name][ranked[0]] is not None for name in names)]
    axes = labels_of(labels, width)
    panel_width = (width - axes.extent - MARGIN - GAP * (len(shown) - 1)) / len(shown)
    for column, title, neutral in shown:
        rows = [
            _ranked(last[name], column, neutral) | {"measure": label} for name, label in zip(names, labels, strict=True)
        ]
        panel = _ranking_panel(rows, axes.axis(is_shown=not panels), labels, title, neutral)
        panels.append(panel.properties(width=panel_width, height=alt.Step(axes.step(ROW_HEIGHT))))
    subtitle = ["line: 95 % interval; filled: it excludes what a measure", "without information gets (dashed)"]
    if any(not last[name]["better"] for name in names):
        subtitle.append("* no stated direction: taken from the votes, which flatters the measure")
    heading = alt.TitleParams("How well each measure predicts the scores", subtitle=subtitle)
    return alt.hconcat(*panels, spacing=GAP).properties(title=heading)


def _ranked(row: Row, column: str, neutral: float) -> dict[str, Any]:
    """Return a value with its interval, turned to the direction that should be better; shares in order are already."""
    names = column, f"{column}_low", f"{column}_high"
    value, low, high = (row[name] if column in SHARES else directed(row, name) for name in names)
    is_clear = low is not None and high is not None and not min(low, high) <= neutral <= max(low, high)
    return {"value": value, "low": low, "high": high, "chance": "excluded" if is_clear else "possible"}


def _ranking_panel(rows: Sequence[Row], axis: alt.Axis, names: Sequence[str], title: str, neutral: float) -> Any:
    there = [row for row in rows if row["value"] is not None]
    y = alt.Y("measure:N", sort=None, scale=alt.Scale(domain=list(names)), title=None, axis=axis)
    scale = alt.Scale(domain=[0, 1] if neutral else [-1, 1], nice=False)
    base = alt.Chart(alt.Data(values=there))
    bars = base.mark_rule(strokeWidth=1.6, color=INK).encode(
        y=y, x=alt.X("low:Q", title=title, scale=scale), x2=alt.X2("high:Q")
    )
    fill = alt.Fill(
        "chance:N", scale=alt.Scale(domain=["excluded", "possible"], range=[PALETTE[1], "#ffffff"]), legend=None
    )
    points = base.mark_point(size=46, opacity=1, strokeWidth=1.6, color=INK).encode(
        y=y, x=alt.X("value:Q", title=title, scale=scale), fill=fill
    )
    return alt.layer(dashed_line("x", neutral), bars, points)

"""Draw the charts of an analysis in Vega-Lite: scores, preferences, residuals, triads, response times. They
stay readable in print, without colour, and for colour-blind readers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt
import vl_convert

Row = Mapping[str, Any]

# Okabe and Ito (2008), "Color universal design"; black first, yellow left out (too pale on white).
PALETTE = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DIVERGING = ["#b35806", "#f7f7f7", "#2166ac"]  # of a matrix
INK, FAINT = "#222222", "#d9d9d9"
FONT = "Liberation Sans, Arial, sans-serif"
COLUMNS = 3  # panels in a row
MOST_ITEMS_IN_A_MATRIX = 40  # labels of more cannot be read
MOST_PARTICIPANTS_IN_A_CHART = 80
PNG_SCALE = 2.0


def scores_chart(analysis: Mapping[str, Any], comparison: str = "all") -> Any:
    """Draw the scores with their intervals, a panel per dataset, items ordered by their overall score.

    Returns
    -------
    altair chart, or None if no dataset has scores
    """
    rows = [row for row in analysis["scores"] if row["comparison"] == comparison and row["score"] is not None]
    if not rows:
        return None
    items = _by_score(rows)
    panels = [_scores_panel([row for row in rows if row["dataset"] == name], items, name) for name in _datasets(rows)]
    return arranged(panels)


def _scores_panel(rows: Sequence[Row], items: Sequence[str], dataset: str) -> Any:
    values = [dict(row) | {"estimate": "penalised" if row["penalty"] else "maximum likelihood"} for row in rows]
    base = alt.Chart(alt.Data(values=values))
    y = alt.Y("item:N", sort=list(items), title=None, axis=alt.Axis(grid=True, gridColor=FAINT))
    x = alt.X("score:Q", title="score (log-odds)", scale=alt.Scale(nice=True, zero=True))
    bars = base.mark_rule(strokeWidth=1.6, color=INK).encode(
        y=y, x=alt.X("ci_low:Q", title="score (log-odds)"), x2="ci_high:Q"
    )
    points = base.mark_point(size=52, opacity=1, strokeWidth=1.6, color=INK).encode(
        y=y,
        x=x,
        fill=alt.Fill(
            "estimate:N",
            scale=alt.Scale(domain=["maximum likelihood", "penalised"], range=[PALETTE[1], "#ffffff"]),
            legend=None,
        ),
    )
    zero = alt.Chart(alt.Data(values=[{"zero": 0}])).mark_rule(strokeDash=[4, 3], color="#777777").encode(x="zero:Q")
    title = "all datasets" if dataset == "all" else dataset
    return alt.layer(zero, bars, points).properties(width=210, height=alt.Step(22), title=title)


def groups_chart(analysis: Mapping[str, Any], grouping: str) -> Any:
    """Draw the scores of groups of participants over all datasets, told apart by colour and shape.

    Returns
    -------
    altair chart, or None if no group has scores
    """
    rows = [
        row
        for row in analysis["groups"]
        if row["grouping"] == grouping and row["dataset"] == "all" and row["score"] is not None
    ]
    if not rows:
        return None
    groups = list(dict.fromkeys(row["group"] for row in rows))
    base = alt.Chart(alt.Data(values=[dict(row) for row in rows])).encode(
        y=alt.Y("item:N", sort=_by_score(rows), title=None, axis=alt.Axis(grid=True, gridColor=FAINT)),
        yOffset=alt.YOffset("group:N", sort=groups),
    )
    color = alt.Color("group:N", title=grouping, sort=groups, scale=alt.Scale(range=list(PALETTE)))
    bars = base.mark_rule(strokeWidth=1.6).encode(
        color=color.legend(None), x=alt.X("ci_low:Q", title="score (log-odds)"), x2="ci_high:Q"
    )
    points = base.mark_point(size=52, opacity=1, filled=True).encode(
        x=alt.X("score:Q", title="score (log-odds)", scale=alt.Scale(nice=True, zero=True)),
        color=color,
        shape=alt.Shape("group:N", title=grouping, sort=groups),
    )
    return arranged([alt.layer(bars, points).properties(width=320, height=alt.Step(14), title="all datasets")])


def preference_chart(analysis: Mapping[str, Any], dataset: str = "all") -> Any:
    """Draw how often the row's item was preferred to the column's, with the counts; a tie counts half for each.

    Returns
    -------
    altair chart, or None if there are no votes or too many items to read
    """
    pairs = [row for row in analysis["pairs"] if row["comparison"] == "all" and row["dataset"] == dataset]
    scores = [row for row in analysis["scores"] if row["comparison"] == "all" and row["dataset"] == dataset]
    if not pairs or len(scores) > MOST_ITEMS_IN_A_MATRIX:
        return None
    color = alt.Color(
        "share:Q",
        title=["share", "preferred"],
        scale=alt.Scale(domain=[0, 0.5, 1], range=DIVERGING),
        legend=alt.Legend(format="%"),
    )
    title = alt.TitleParams(
        "Preferences" if dataset == "all" else f"Preferences, {dataset}",
        subtitle="number of votes for the row's item; the colour counts ties half",
    )
    values = [cell for row in pairs for cell in _cells(row)]
    return _matrix(values, _by_score(scores), color, "label:N", "abs(datum.share - 0.5) > 0.3").properties(title=title)


def _matrix(values: Sequence[Row], items: Sequence[str], color: alt.Color, text: str | alt.Text, is_dark: str) -> Any:
    """Draw a coloured cell with a text for each pair of items; the text is white where `is_dark` holds."""
    base = alt.Chart(alt.Data(values=values)).encode(
        x=alt.X("other:N", sort=items, title="… than", axis=alt.Axis(orient="top", labelAngle=-40, labelOverlap=False)),
        y=alt.Y("item:N", sort=items, title="preferred …"),
    )
    cells = base.mark_rect(stroke="#ffffff").encode(color=color)
    texts = base.mark_text(fontSize=11).encode(
        text=text, color=alt.condition(is_dark, alt.value("#ffffff"), alt.value(INK))
    )
    return (cells + texts).properties(width=alt.Step(46), height=alt.Step(30))


def _cells(row: Row) -> list[dict[str, Any]]:
    total = row["a"] + row["b"] + row["none"]
    share = (row["a"] + row["none"] / 2) / total
    return [
        {"item": row["item_a"], "other": row["item_b"], "share": share, "label": f"{row['a']:g}"},
        {"item": row["item_b"], "other": row["item_a"], "share": 1 - share, "label": f"{row['b']:g}"},
    ]


def residual_chart(analysis: Mapping[str, Any], dataset: str = "all") -> Any:
    """Draw the standardised residuals of the pairs: where the model predicts too many or too few wins.

    Returns
    -------
    altair chart or None
    """
    pairs = [
        row
        for row in analysis["pairs"]
        if row["comparison"] == "all" and row["dataset"] == dataset and row["expected_a"] is not None
    ]
    scores = [row for row in analysis["scores"] if row["comparison"] == "all" and row["dataset"] == dataset]
    if not pairs or len(scores) > MOST_ITEMS_IN_A_MATRIX:
        return None
    color = alt.Color(
        "residual:Q", title="residual (sd)", scale=alt.Scale(domain=[-3, 0, 3], range=DIVERGING, clamp=True)
    )
    title = alt.TitleParams(
        "Residuals of the model",
        subtitle=["standard deviations by which the row's item was", "preferred more often than its score says"],
    )
    values, text = [cell for row in pairs for cell in _residuals(row)], alt.Text("residual:Q", format="+.1f")
    return _matrix(values, _by_score(scores), color, text, "abs(datum.residual) > 1.8").properties(title=title)


def _residuals(row: Row) -> list[dict[str, Any]]:
    """Return (observed - expected) wins in units of their standard deviation, for both items of a pair."""
    total = row["a"] + row["b"] + row["none"]
    cells = []
    for item, other, side in ((row["item_a"], row["item_b"], "a"), (row["item_b"], row["item_a"], "b")):
        expected = row[f"expected_{side}"]
        deviation = (expected * (1 - expected / total)) ** 0.5
        cells.append({"item": item, "other": other, "residual": (row[side] - expected) / max(deviation, 1e-9)})
    return cells


def triads_chart(analysis: Mapping[str, Any]) -> Any:
    """Draw each participant's circular triads over all datasets beside the number that random votes would give.

    Returns
    -------
    altair chart or None
    """
    expected: dict[str, float] = {}
    for row in analysis["triads"]:
        n = row["n_items"]
        if row["complete"]:
            chance = n * (n - 1) * (n - 2) / 24
            expected[row["participant"]] = expected.get(row["participant"], 0.0) + chance
    values = [dict(row) | {"chance": expected.get(row["participant"])} for row in analysis["triads_pooled"]]
    if not values or len(values) > MOST_PARTICIPANTS_IN_A_CHART:
        return None
    base = alt.Chart(alt.Data(values=values))
    y = alt.Y("participant:N", title=None, sort=None)
    strict = base.mark_bar(color=PALETTE[1], height=8).encode(y=y, x=alt.X("circular:Q", title="circular triads"))
    ties = base.mark_tick(color=INK, thickness=2, size=12).encode(y=y, x="circular_expected_ties:Q")
    chance = base.mark_point(shape="diamond", size=36, color=PALETTE[2], filled=True).encode(y=y, x="chance:Q")
    title = alt.TitleParams(
        "Contradictory preferences",
        subtitle=["bar: strict cycles; tick: expected if ties are broken", "at random; diamond: random votes"],
    )
    return (strict + ties + chance).properties(width=320, height=alt.Step(15), title=title)


def response_chart(analysis: Mapping[str, Any]) -> Any:
    """Draw each participant's response times: the median, and a line down to the fastest tenth.

    Returns
    -------
    altair chart, or None without recorded times or with too many participants
    """
    values = [row for row in analysis["observers"] if row["median_response_ms"] is not None]
    if not values or len(values) > MOST_PARTICIPANTS_IN_A_CHART:
        return None
    base = alt.Chart(alt.Data(values=[{k: v for k, v in row.items() if k != "flags"} for row in values]))
    y = alt.Y("participant:N", title=None, sort=None)
    x = alt.X("fastest_decile_ms:Q", title="response time (ms)", scale=alt.Scale(zero=True))
    reach = base.mark_rule(strokeWidth=1.6, color=INK).encode(y=y, x=x, x2="median_response_ms:Q")
    median = base.mark_point(filled=True, size=48, opacity=1, color=PALETTE[1]).encode(y=y, x="median_response_ms:Q")
    title = alt.TitleParams("Response times", subtitle="point: median; line: down to the fastest tenth")
    return (reach + median).properties(width=320, height=alt.Step(15), title=title)


def chart_svg(chart: Any) -> str:
    """Return the chart as SVG text."""
    return str(vl_convert.vegalite_to_svg(_spec(chart)))


def chart_png(chart: Any) -> bytes:
    """Return the chart as PNG."""
    return bytes(vl_convert.vegalite_to_png(_spec(chart), scale=PNG_SCALE))


def chart_pdf(chart: Any) -> bytes:
    """Return the chart as PDF."""
    return bytes(vl_convert.vegalite_to_pdf(_spec(chart)))


def chart_vega(chart: Any) -> str:
    """Return the chart as a Vega specification in JSON, which a browser draws."""
    return json.dumps(vl_convert.vegalite_to_vega(_spec(chart)))


def _spec(chart: Any) -> str:
    spec = json.loads(chart.to_json())
    spec["config"] = {
        "font": FONT,
        "background": "#ffffff",
        "view": {"stroke": "#bbbbbb"},
        "title": {"fontSize": 13, "anchor": "start", "color": INK, "subtitleFontSize": 11, "subtitleColor": "#555555"},
        "axis": {
            "labelFontSize": 11,
            "titleFontSize": 11,
            "titleFontWeight": "normal",
            "labelColor": INK,
            "labelLimit": 160,
            "labelFlush": False,
        },
        "legend": {"labelFontSize": 11, "titleFontSize": 11, "titleFontWeight": "normal"},
    }
    return json.dumps(spec)


def _by_score(rows: Sequence[Row]) -> list[str]:
    """Return the items from best to worst by the pooled score, or by the datasets' scores without one."""
    pooled = [row for row in rows if row["dataset"] == "all"] or rows
    known = sorted(pooled, key=lambda row: -(row["score"] if row["score"] is not None else 0))
    names = dict.fromkeys(row["item"] for row in known)
    return list(names | dict.fromkeys(row["item"] for row in rows))


def _datasets(rows: Sequence[Row]) -> list[str]:
    names = list(dict.fromkeys(row["dataset"] for row in rows))
    return [*(name for name in names if name != "all"), *(name for name in names if name == "all")]


def arranged(panels: Sequence[Any]) -> Any:
    """Return panels in rows of three, which share their horizontal axis."""
    rows = [
        alt.hconcat(*panels[start : start + COLUMNS]).resolve_scale(x="shared")
        for start in range(0, len(panels), COLUMNS)
    ]
    return alt.vconcat(*rows).resolve_scale(x="shared") if len(rows) > 1 else rows[0]

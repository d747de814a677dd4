"""Draw the votes of an analysis in Vega-Lite: preferences, residuals, triads, response times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from app.analysis.drawing.charts_in_common import (
    DIVERGING,
    FONT_SIZE,
    FULL,
    INK,
    MARGIN,
    PALETTE,
    Labels,
    labels_of,
    panel_layout,
)
from app.analysis.findings.ranking import overall
from app.analysis.report.score_charts import by_score

Row = Mapping[str, Any]

MOST_ITEMS_IN_A_MATRIX = 40  # labels of more cannot be read
MOST_PARTICIPANTS_IN_A_CHART = 80
SMALLEST_CELL_WITH_TEXT = 15  # pixels of a matrix's cell
LARGEST_CELL = 46
AXIS_TITLE = 16  # pixels


def preference_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw how often the row's condition was preferred to the column's on all datasets, with the counts; a tie counts
    half for each.

    Parameters
    ----------
    analysis : the content of analysis.json
    width : of the figure, in pixels

    Returns
    -------
    altair chart, or None if there are no votes or too many items to read
    """
    pairs, items = _pairs_and_items(analysis)
    if not pairs:
        return None
    color = alt.Color(
        "share:Q",
        title="share preferred",
        scale=alt.Scale(domain=[0, 0.5, 1], range=DIVERGING),
        legend=alt.Legend(format="%", orient="bottom", gradientLength=110, values=[0, 0.5, 1]),
    )
    title = alt.TitleParams(
        "Preferences",
        subtitle=["number of votes for the row's condition over the", "column's; the colour counts ties half"],
    )
    values = [cell for row in pairs for cell in _cells(row)]
    dark = "abs(datum.share - 0.5) > 0.3"
    return _matrix(values, items, color, alt.Text("label:N"), dark, width).properties(title=title)


def _pairs_and_items(analysis: Mapping[str, Any]) -> tuple[list[Row], list[str]]:
    """Return the pairs of all conditions, and the conditions, best first; none if too many to read."""
    pairs, scores = (overall(analysis[table]) for table in ("pairs", "scores"))
    return ([], []) if len(scores) > MOST_ITEMS_IN_A_MATRIX else (_unordered(pairs), by_score(scores))


def _unordered(pairs: Sequence[Row]) -> list[Row]:
    """Add up the rows of a pair that was counted in both orders of showing, as an order effect needs."""
    summed: dict[frozenset[str], dict[str, Any]] = {}
    for row in pairs:
        key = frozenset((row["item_a"], row["item_b"]))
        if key not in summed:
            summed[key] = dict(row)
            continue
        kept = summed[key]
        sides = {"a": "a", "b": "b"} if kept["item_a"] == row["item_a"] else {"a": "b", "b": "a"}
        for name, other in (sides | {"none": "none"}).items():
            kept[name] += row[other]
            expected = f"expected_{name}"
            kept[expected] = None if kept[expected] is None else kept[expected] + row[f"expected_{other}"]
    return list(summed.values())


def _matrix(
    values: Sequence[Row], items: Sequence[str], color: alt.Color, text: alt.Text, is_dark: str, width: int
) -> Any:
    """Draw a coloured cell with a text for each pair of conditions; the text is white where `is_dark` holds.

    Columns have the numbers of the rows: names at the top of narrow columns could not be read.
    """
    numbers = {name: str(place) for place, name in enumerate(items, start=1)}
    rows = {name: f"{name}  {numbers[name]}" for name in items}
    labels = labels_of(rows.values(), width)
    cell = min(LARGEST_CELL, (width - labels.extent - MARGIN - AXIS_TITLE) / len(items))
    cells_values = [dict(value) | {"row": rows[value["item"]], "column": numbers[value["other"]]} for value in values]
    top = alt.Axis(orient="top", labelAngle=0 if cell > 2 * FONT_SIZE - 4 else -90, labelOverlap=False, labelLimit=0)
    base = alt.Chart(alt.Data(values=cells_values)).encode(
        x=alt.X("column:N", scale=alt.Scale(domain=list(numbers.values())), sort=None, title="… than", axis=top),
        y=alt.Y(
            "row:N",
            scale=alt.Scale(domain=list(rows.values())),
            sort=None,
            title="preferred …",
            axis=labels.axis(has_grid=False),
        ),
    )
    cells = base.mark_rect(stroke="#ffffff").encode(
        color=color, tooltip=[alt.Tooltip("item:N"), alt.Tooltip("other:N"), text]
    )
    texts = base.mark_text(fontSize=min(11, cell * 0.55)).encode(
        text=text, color=alt.condition(is_dark, alt.value("#ffffff"), alt.value(INK))
    )
    drawn = cells + texts if cell >= SMALLEST_CELL_WITH_TEXT else alt.layer(cells)
    return drawn.properties(width=cell * len(items), height=alt.Step(max(labels.step(18), min(cell, 30))))


def _cells(row: Row) -> list[dict[str, Any]]:
    total = row["a"] + row["b"] + row["none"]
    share = (row["a"] + row["none"] / 2) / total
    return [
        {"item": row["item_a"], "other": row["item_b"], "share": share, "label": f"{row['a']:g}"},
        {"item": row["item_b"], "other": row["item_a"], "share": 1 - share, "label": f"{row['b']:g}"},
    ]


def residual_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw the standardised residuals of the pairs: where the model predicts too many or too few wins.

    Parameters
    ----------
    analysis, width : as in `preference_chart`

    Returns
    -------
    altair chart or None
    """
    pairs, items = _pairs_and_items(analysis)
    if not pairs or any(row["expected_a"] is None for row in pairs):
        return None
    color = alt.Color(
        "residual:Q",
        title="residual (sd)",
        legend=alt.Legend(orient="bottom", gradientLength=110),
        scale=alt.Scale(domain=[-3, 0, 3], range=DIVERGING, clamp=True),
    )
    title = alt.TitleParams(
        "Residuals of the model",
        subtitle=["standard deviations by which the row's condition was", "preferred more often than its score says"],
    )
    values, text = [cell for row in pairs for cell in _residuals(row)], alt.Text("residual:Q", format="+.1f")
    dark = "abs(datum.residual) > 1.8"
    return _matrix(values, items, color, text, dark, width).properties(title=title)


def _residuals(row: Row) -> list[dict[str, Any]]:
    """Return (observed - expected) wins in units of their standard deviation, for both items of a pair."""
    total = row["a"] + row["b"] + row["none"]
    cells = []
    for item, other, side in ((row["item_a"], row["item_b"], "a"), (row["item_b"], row["item_a"], "b")):
        expected = row[f"expected_{side}"]
        deviation = (expected * (1 - expected / total)) ** 0.5
        cells.append({"item": item, "other": other, "residual": (row[side] - expected) / max(deviation, 1e-9)})
    return cells


def triads_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw each participant's circular triads over all datasets beside the number that random votes would give.

    Returns
    -------
    altair chart or None
    """
    values = analysis["triads_pooled"]
    if not values or len(values) > MOST_PARTICIPANTS_IN_A_CHART:
        return None
    base = alt.Chart(alt.Data(values=values))
    labels = labels_of((row["participant"] for row in values), width)
    y = alt.Y("participant:N", title=None, sort=None, axis=labels.axis())
    strict = base.mark_bar(color=PALETTE[1], height=8).encode(y=y, x=alt.X("circular:Q", title="circular triads"))
    chance = base.mark_point(shape="diamond", size=36, color=PALETTE[2], filled=True, opacity=1).encode(
        y=y, x=alt.X("strict_by_chance:Q")
    )
    title = alt.TitleParams(
        "Contradictory preferences",
        subtitle=["bar: circular triads; diamond: expected from votes", "at random with the same ties"],
    )
    return (strict + chance).properties(width=_panel_width(labels, width), height=alt.Step(15), title=title)


def response_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw each participant's response times: the median, and a line down to the fastest tenth.

    Returns
    -------
    altair chart, or None without recorded times or with too many participants
    """
    values = [row for row in analysis["observers"] if row["median_response_ms"] is not None]
    if not values or len(values) > MOST_PARTICIPANTS_IN_A_CHART:
        return None
    base = alt.Chart(alt.Data(values=[{k: v for k, v in row.items() if k != "flags"} for row in values]))
    labels = labels_of((row["participant"] for row in values), width)
    y = alt.Y("participant:N", title=None, sort=None, axis=labels.axis())
    axis = alt.Axis(tickCount=4, labelOverlap=True)
    x = alt.X("fastest_decile_ms:Q", title="response time (ms)", scale=alt.Scale(zero=True), axis=axis)
    reach = base.mark_rule(strokeWidth=1.6, color=INK).encode(y=y, x=x, x2=alt.X2("median_response_ms:Q"))
    median = base.mark_point(filled=True, size=48, opacity=1, color=PALETTE[1]).encode(
        y=y, x=alt.X("median_response_ms:Q")
    )
    title = alt.TitleParams("Response times", subtitle="point: median; line: down to the fastest tenth")
    return (reach + median).properties(width=_panel_width(labels, width), height=alt.Step(15), title=title)


def _panel_width(labels: Labels, width: int) -> float:
    """Return the width of a single panel; participants need no more than half a page."""
    return min(panel_layout(1, labels, width)[1], FULL / 2)

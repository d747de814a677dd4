"""Draw the charts of an analysis in Vega-Lite: scores, preferences, residuals, triads, response times. They
stay readable in print, without colour, and for colour-blind readers.
"""

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
    colour_by,
    dashed_line,
    labels_of,
    panel_layout,
    panels_in_rows,
    shape_by,
    text_width,
)
from app.analysis.drawing.figure_code import level_rows
from app.analysis.findings.ranking import overall
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]

MOST_ITEMS_IN_A_MATRIX = 40  # labels of more cannot be read
MOST_PARTICIPANTS_IN_A_CHART = 80
SMALLEST_CELL_WITH_TEXT = 15  # pixels of a matrix's cell
LARGEST_CELL = 46
AXIS_TITLE = 16  # pixels


def scores_chart(analysis: Mapping[str, Any], comparison: str = ALL, width: int = FULL) -> Any:
    """Draw the scores with their intervals and letters, a panel per dataset, conditions ordered by their overall score.

    Parameters
    ----------
    analysis : the content of analysis.json
    comparison : all conditions, or a factor
    width : of the figure, in pixels

    Returns
    -------
    altair chart, or None if no dataset has scores
    """
    rows = [row for row in analysis["scores"] if row["comparison"] == comparison and row["score"] is not None]
    if not rows:
        return None
    items = _by_score(rows)
    labels = labels_of(items, width)
    title = title_of if analysis["votes"]["datasets"] else lambda _: ""
    panels = [(title(name), [row for row in rows if row["dataset"] == name]) for name in _datasets(analysis, rows)]
    reach = _reach([row for _, part in panels for row in part])
    points = {name: [_drawn(row, reach) for row in part] for name, part in panels}
    kinds = [kind for kind in KINDS if any(row["kind"] == kind for part in points.values() for row in part)]
    letters = max((text_width(row["letters"]) for part in points.values() for row in part), default=0.0)

    def panel(axis: alt.Axis, panel_width: float) -> Any:
        chart = _scores_panel(axis, alt.Scale(domain=items), kinds, _room(reach, letters, panel_width), panel_width)
        return chart.properties(height=alt.Step(labels.step(18)))

    return panels_in_rows(list(points.items()), labels, width, panel)


def title_of(dataset: str) -> str:
    """Return the title of a panel for a dataset, or for one fit to the votes on all of them."""
    return "all votes together" if dataset == ALL else dataset


def _is_open(row: Row) -> bool:
    """Do the votes set a score neither a limit nor an interval within a group?"""
    return bool(row.get("no_limit")) and row["ci_low"] is None


def _reach(rows: Sequence[Row]) -> tuple[float, float]:
    """Return the ends of the axis: zero, all scores and intervals, and room for arrows of what has no limit."""
    finite = [row for row in rows if not _is_open(row)]
    ends = [0.0, *(row[name] for row in finite for name in ("score", "ci_low", "ci_high") if row[name] is not None)]
    sides = {row["no_limit"] for row in rows if _is_open(row)}
    size = max(ends) - min(ends) or 1.0
    below, above = ((ARROW if side in sides else 0.0) + 0.05 for side in ("below", "above"))
    return min(ends) - below * size, max(ends) + above * size


def _room(reach: tuple[float, float], letters: float, panel_width: float) -> tuple[float, float]:
    """Return the ends of an axis with room for letters of a width in pixels."""
    low, high = reach
    share = min(0.4, (letters + 10) / panel_width) if letters else 0.0
    return low, high + (high - low) * share / (1 - share)


def _drawn(row: Row, reach: tuple[float, float]) -> dict[str, Any]:
    """Return what is drawn of a score: a point with its interval; an arrow where the votes set it no limit."""
    drawn = {name: row[name] for name in ("item", "score", "ci_low", "ci_high")} | {"letters": row["letters"] or ""}
    if not _is_open(row):
        kind = PENALISED if row["penalty"] else MAXIMUM
        return drawn | {"x": row["score"], "low": row["ci_low"], "high": row["ci_high"], "kind": kind}
    is_above, length = row["no_limit"] == "above", ARROW * (reach[1] - reach[0])
    end = reach[1] - 0.15 * length if is_above else reach[0] + 0.15 * length
    tail = end - length if is_above else end + length
    return drawn | {"x": end, "low": tail, "high": end, "kind": ABOVE if is_above else BELOW}


def _scores_panel(
    axis: alt.Axis, conditions: alt.Scale, kinds: Sequence[str], ends: tuple[float, float], panel_width: float
) -> Any:
    """Return a panel without its data, the rows of `_drawn`."""
    base = alt.Chart().encode(y=alt.Y("item:N", scale=conditions, sort=None, title=None, axis=axis))
    scale = alt.Scale(domain=list(ends), nice=False, zero=False)
    x, low = (alt.X(f"{name}:Q", title=SCORE, scale=scale, axis=FEW_TICKS) for name in ("x", "low"))
    bars = base.mark_rule(strokeWidth=1.6, color=INK).encode(x=low, x2=alt.X2("high:Q"))
    legend = alt.Legend(orient="bottom", title=None, columns=1, labelLimit=0) if kinds != [MAXIMUM] else None
    looks = {"fill": [KINDS[kind][0] for kind in kinds], "shape": [KINDS[kind][1] for kind in kinds]}
    colours, shapes = (alt.Scale(domain=list(kinds), range=look) for look in looks.values())
    points = base.mark_point(size=46, opacity=1, strokeWidth=1.6, color=INK).encode(
        x=x,
        fill=alt.Fill("kind:N", scale=colours, legend=legend),
        shape=alt.Shape("kind:N", scale=shapes, legend=legend),
        tooltip=[
            alt.Tooltip("item:N"),
            *(alt.Tooltip(f"{name}:Q", format="+.2f") for name in ("score", "ci_low", "ci_high")),
        ],
    )
    letters = base.mark_text(align="right", fontSize=FONT_SIZE, color=INK)
    return alt.layer(
        dashed_line("x", 0), bars, points, letters.encode(x=alt.XValue(panel_width - 5), text=alt.Text("letters:N"))
    )


ARROW = 0.12  # of the axis, the length of an arrow
MAXIMUM, PENALISED = "maximum likelihood", "penalised, as some votes all go one way"
ABOVE, BELOW = "no upper limit: all decided votes are for it", "no lower limit: all decided votes are against it"
KINDS = {  # what a point is -> its fill and its shape
    MAXIMUM: (PALETTE[1], "circle"),
    PENALISED: ("#ffffff", "circle"),
    ABOVE: (INK, "triangle-right"),
    BELOW: (INK, "triangle-left"),
}
SCORE = "score (log-odds)"
FEW_TICKS = alt.Axis(tickCount=4)


def levels_chart(analysis: Mapping[str, Any], factor: str, width: int = FULL) -> Any:
    """Draw the levels of a factor side by side on each dataset, as figures 7 and 8 of the paper do: their effects, all
    else equal, from the fit that tells which of them differ; or their scores where there are no effects.

    Parameters
    ----------
    analysis, width : as in `scores_chart`
    factor : its name

    Returns
    -------
    altair chart, or None if no dataset has scores
    """
    rows = level_rows(analysis, factor)
    if not rows:
        return None
    levels = _by_score(rows)
    names = _datasets(analysis, rows)
    datasets = [title_of(name) for name in names]
    values = [dict(row) | {"dataset": title_of(row["dataset"])} for row in rows if row["dataset"] in names]
    is_turned = any(text_width(name) > (width - 60) / len(datasets) for name in datasets)
    base = alt.Chart(alt.Data(values=values)).encode(
        x=alt.X(
            "dataset:N",
            scale=alt.Scale(domain=datasets),
            sort=None,
            title=None,
            axis=alt.Axis(labelAngle=-60 if is_turned else 0, labelLimit=0, labelOverlap=False),
        ),
        xOffset=alt.XOffset("item:N", sort=levels, scale=alt.Scale(paddingOuter=0.5)),
        color=colour_by("item", factor, levels, width),
    )
    title = f"effect of {factor} (log-odds)" if "effect" in rows[0] else SCORE
    bars = base.mark_rule(strokeWidth=1.6).encode(y=alt.Y("ci_low:Q", title=title), y2=alt.Y2("ci_high:Q"))
    points = base.mark_point(size=52, opacity=1, filled=True).encode(
        y=alt.Y("score:Q", title=title, scale=alt.Scale(nice=True, zero=True)),
        shape=shape_by("item", factor, levels, width),
    )
    return alt.layer(dashed_line("y", 0), bars, points).properties(width=width - MARGIN - 35, height=230)


def groups_chart(analysis: Mapping[str, Any], grouping: str, width: int = FULL) -> Any:
    """Draw the scores of groups of participants over all datasets, told apart by colour and shape.

    Parameters
    ----------
    analysis, width : as in `scores_chart`
    grouping : its name

    Returns
    -------
    altair chart, or None if no group has scores
    """
    rows = [
        row
        for row in analysis["groups"]
        if row["grouping"] == grouping and row["dataset"] == ALL and row["score"] is not None
    ]
    if not rows:
        return None
    groups = list(dict.fromkeys(row["group"] for row in rows))
    items = _by_score(rows)
    labels = labels_of(items, width)
    base = alt.Chart(alt.Data(values=[dict(row) for row in rows])).encode(
        y=alt.Y("item:N", scale=alt.Scale(domain=items), sort=None, title=None, axis=labels.axis()),
        yOffset=alt.YOffset("group:N", sort=groups),
        color=colour_by("group", grouping, groups, width),
    )
    bars = base.mark_rule(strokeWidth=1.6).encode(x=alt.X("ci_low:Q", title=SCORE), x2=alt.X2("ci_high:Q"))
    points = base.mark_point(size=46, opacity=1, filled=True).encode(
        x=alt.X("score:Q", title=SCORE, scale=alt.Scale(nice=True, zero=True)),
        shape=shape_by("group", grouping, groups, width),
    )
    height = alt.Step(max(labels.step(18) / len(groups), 13))
    _, panel_width = panel_layout(1, labels, width)
    return alt.layer(bars, points).properties(width=panel_width, height=height, title=title_of(ALL))


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
    return ([], []) if len(scores) > MOST_ITEMS_IN_A_MATRIX else (_unordered(pairs), _by_score(scores))


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
    x = alt.X("fastest_decile_ms:Q", title="response time (ms)", scale=alt.Scale(zero=True))
    reach = base.mark_rule(strokeWidth=1.6, color=INK).encode(y=y, x=x, x2=alt.X2("median_response_ms:Q"))
    median = base.mark_point(filled=True, size=48, opacity=1, color=PALETTE[1]).encode(
        y=y, x=alt.X("median_response_ms:Q")
    )
    title = alt.TitleParams("Response times", subtitle="point: median; line: down to the fastest tenth")
    return (reach + median).properties(width=_panel_width(labels, width), height=alt.Step(15), title=title)


def _panel_width(labels: Labels, width: int) -> float:
    """Return the width of a single panel; participants need no more than half a page."""
    return min(panel_layout(1, labels, width)[1], FULL / 2)


def _by_score(rows: Sequence[Row]) -> list[str]:
    """Return the items from best to worst by the pooled score, or by the datasets' scores without one."""
    pooled = [row for row in rows if row["dataset"] == ALL] or rows
    known = sorted(pooled, key=lambda row: -(row["score"] if row["score"] is not None else 0))
    names = dict.fromkeys(row["item"] for row in known)
    return list(names | dict.fromkeys(row["item"] for row in rows))


def _datasets(analysis: Mapping[str, Any], rows: Sequence[Row]) -> list[str]:
    """Return the datasets of rows and then all together, where they are several."""
    if len({row["dataset"] for row in analysis["scores"]} - {ALL}) == 1:
        rows = [row for row in rows if row["dataset"] != ALL] or rows
    names = list(dict.fromkeys(row["dataset"] for row in rows))
    return [*(name for name in names if name != ALL), *(name for name in names if name == ALL)]

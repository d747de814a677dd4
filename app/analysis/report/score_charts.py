"""Draw the scores of an analysis in Vega-Lite: of conditions, of a factor's levels, of groups. Charts stay readable in
print, without colour, and for colour-blind readers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from app.analysis.drawing.charts_in_common import (
    FONT_SIZE,
    FULL,
    INK,
    MARGIN,
    PALETTE,
    colour_by,
    dashed_line,
    labels_of,
    panel_layout,
    panels_in_rows,
    shape_by,
    text_width,
)
from app.analysis.drawing.figure_code import level_rows
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]


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
    items = by_score(rows)
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
    levels = by_score(rows)
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
    items = by_score(rows)
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


def by_score(rows: Sequence[Row]) -> list[str]:
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

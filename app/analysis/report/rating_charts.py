"""Draw ratings: mean opinion scores, participants, the scale shared with pair votes, comparison scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import altair as alt
import numpy as np

from app.analysis.comparisons.comparison import natural_order
from app.analysis.drawing.charts_in_common import (
    FULL,
    INK,
    PALETTE,
    Labels,
    dashed_line,
    intervals_shown,
    labels_of,
    panel_layout,
    panels_in_rows,
)
from app.analysis.reading.votes_table import ALL
from app.analysis.report.vote_charts import MOST_PARTICIPANTS_IN_A_CHART

Row = Mapping[str, Any]

MARGIN = 0.08  # of the range, beside the intervals
ESTIMATES = ("mean", "subject model, these people")


def rating_charts(analysis: Mapping[str, Any], width: int = FULL) -> Iterator[tuple[str, str, Any]]:
    """Yield name, caption and chart of every figure of ratings; the chart is None where there is nothing to draw."""
    items, raters = analysis.get("rating_items", []), analysis.get("raters", [])
    aligned, compared = analysis.get("alignment_items", []), analysis.get("comparison_items", [])
    differences = [row for row in items if row["dmos"] is not None]
    yield "opinion_scores", f"Mean opinion scores {intervals_shown(items)}.", opinion_chart(analysis, width)
    yield (
        "differential_scores",
        f"Differential scores to the reference {intervals_shown(differences, 'dmos_low')}.",
        differential_chart(analysis, width),
    )
    yield (
        "raters",
        f"Bias and inconsistency of each participant {intervals_shown(raters, 'bias_low')}.",
        raters_chart(analysis, width),
    )
    yield (
        "alignment",
        f"Qualities from ratings and votes together {intervals_shown(aligned, 'quality_low')}.",
        alignment_chart(analysis, width),
    )
    yield (
        "comparison_scores",
        f"Scores from comparison ratings {intervals_shown(compared)}.",
        comparison_chart(analysis, width),
    )


def opinion_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw the mean opinion score of every item beside its quality by the subject model, a panel per dataset.

    Returns
    -------
    altair chart, or None without ratings
    """
    rows = analysis.get("rating_items", [])
    values = [
        _point(row, value, ends) | {"estimate": estimate}
        for row in rows
        for estimate, (value, ends) in zip(ESTIMATES, (("mos", "ci"), ("quality", "quality")), strict=True)
        if row[value] is not None
    ]
    return _panels(values, "rating", width, estimates=[name for name in ESTIMATES if _has(values, name)])


def differential_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw the differential scores to the hidden reference, a panel per dataset.

    Returns
    -------
    altair chart, or None without a hidden reference
    """
    model = analysis.get("rating_model")
    if not model or model[0]["protocol"] == "dcr":
        return None
    rows = [row for row in analysis["rating_items"] if row["dmos"] is not None]
    return _panels([_point(row, "dmos", "dmos") for row in rows], "differential score", width, line=model[0]["high"])


def alignment_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw the qualities from ratings and votes together, a panel per dataset.

    Returns
    -------
    altair chart, or None without them
    """
    rows = analysis.get("alignment_items", [])
    return _panels([_point(row, "quality", "quality") for row in rows], "quality (rating scale)", width)


def comparison_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw the scores from comparison ratings, a panel per dataset.

    Returns
    -------
    altair chart, or None without them
    """
    rows = analysis.get("comparison_items", [])
    return _panels([_point(row, "score", "ci") for row in rows], "score (units of the scale)", width, line=0.0)


def _has(values: Sequence[Row], estimate: str) -> bool:
    return any(value["estimate"] == estimate for value in values)


def _point(row: Row, value: str, ends: str) -> dict[str, Any]:
    """Return what is drawn of a row; without an interval it has no length."""
    low, high = (row[value] if row[f"{ends}_{end}"] is None else row[f"{ends}_{end}"] for end in ("low", "high"))
    name = f"{row['condition']} (ref.)" if row.get("is_reference") else row["condition"]
    return {
        "dataset": row["dataset"] or ALL,
        "condition": name,
        "value": row[value],
        "low": low,
        "high": high,
        "estimate": ESTIMATES[0],
    }


def _panels(
    values: Sequence[Row], title: str, width: int, *, line: float | None = None, estimates: Sequence[str] = ()
) -> Any:
    """Return a panel per dataset with the conditions ordered by their mean value; None without values."""
    if not values:
        return None
    by_condition: dict[str, list[float]] = {}
    for row in values:
        by_condition.setdefault(row["condition"], []).append(row["value"])
    order = sorted(by_condition, key=lambda name: -float(np.mean(by_condition[name])))
    ends = [row[end] for row in values for end in ("low", "high")] + ([] if line is None else [line])
    margin = MARGIN * (max(ends) - min(ends)) or 0.5
    scale = alt.Scale(domain=[min(ends) - margin, max(ends) + margin], zero=False, nice=False)
    several = list(estimates) if len(estimates) > 1 else []
    datasets = natural_order({row["dataset"] for row in values} - {ALL})
    names = [*datasets, ALL] if any(row["dataset"] == ALL for row in values) else datasets
    labels = labels_of(order, width)
    horizontal = {"title": title, "scale": scale, "axis": alt.Axis(tickCount=4)}

    def panel(axis: alt.Axis, _width: float) -> Any:
        y = alt.Y("condition:N", scale=alt.Scale(domain=order), sort=None, title=None, axis=axis)
        return _panel(y, horizontal, line, several).properties(height=_height(labels, len(several)))

    titles = {name: name for name in datasets} | {ALL: "all datasets" if datasets else ""}
    panels = [(titles[name], [row for row in values if row["dataset"] == name]) for name in names]
    return panels_in_rows(panels, labels, width, panel)


def _height(labels: Labels, n_estimates: int) -> alt.Step:
    return alt.Step(max(labels.step(18) / n_estimates, 13)) if n_estimates else alt.Step(labels.step(18))


def _panel(y: alt.Y, horizontal: Mapping[str, Any], line: float | None, several: Sequence[str]) -> Any:
    """Return a panel without its data."""
    base = alt.Chart().encode(y=y)
    if several:
        base = base.encode(yOffset=alt.YOffset("estimate:N", sort=list(several)))
    low, x = (alt.X(f"{end}:Q", **horizontal) for end in ("low", "value"))
    bars = base.mark_rule(strokeWidth=1.6, color=INK).encode(x=low, x2=alt.X2("high:Q"))
    points = base.mark_point(size=46, opacity=1, filled=True, color=PALETTE[1]).encode(x=x)
    if several:
        names = alt.Scale(domain=list(several), range=[PALETTE[1], PALETTE[2]])
        shapes = alt.Scale(domain=list(several), range=["circle", "diamond"])
        points = points.encode(
            color=alt.Color("estimate:N", title=None, scale=names, legend=alt.Legend(orient="bottom")),
            shape=alt.Shape("estimate:N", title=None, scale=shapes, legend=alt.Legend(orient="bottom")),
        )
    return alt.layer(*([bars, points] if line is None else [dashed_line("x", line), bars, points]))


def raters_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw bias and inconsistency of each participant, ordered by inconsistency; who stands out is filled.

    Returns
    -------
    altair chart, or None without estimates or with too many participants
    """
    rows = [row for row in analysis.get("raters", []) if row["bias"] is not None]
    if not rows or len(rows) > MOST_PARTICIPANTS_IN_A_CHART:
        return None
    order = [row["participant"] for row in sorted(rows, key=lambda row: row["inconsistency"])]
    labels = labels_of(order, width)
    _, panel_width = panel_layout(2, labels, width)
    panels: list[Any] = []
    for name, line in (("bias", 0.0), ("inconsistency", None)):
        values = [
            {
                "participant": row["participant"],
                "value": row[name],
                "low": row[name] if row[f"{name}_low"] is None else row[f"{name}_low"],
                "high": row[name] if row[f"{name}_high"] is None else row[f"{name}_high"],
                "named": "stands out" if row["flags"] else "no",
            }
            for row in rows
        ]
        axis = labels.axis(is_shown=not panels)
        base = alt.Chart(alt.Data(values=values)).encode(
            y=alt.Y("participant:N", sort=order, title=None, axis=axis),
        )
        ticks = alt.Axis(tickCount=5, title=f"{name} (units of the scale)")
        x, low = (alt.X(f"{end}:Q", axis=ticks) for end in ("value", "low"))
        bars = base.mark_rule(strokeWidth=1.6, color=INK).encode(x=low, x2=alt.X2("high:Q"))
        fill = alt.Fill(
            "named:N", scale=alt.Scale(domain=["stands out", "no"], range=[PALETTE[2], "#ffffff"]), legend=None
        )
        points = base.mark_point(size=46, opacity=1, strokeWidth=1.6, color=INK).encode(x=x, fill=fill)
        layers = [bars, points] if line is None else [dashed_line("x", line), bars, points]
        panels.append(alt.layer(*layers).properties(width=panel_width, height=alt.Step(15)))
    title = alt.TitleParams(
        "Participants", subtitle="line: 95 % interval; filled: to look at, by the rules of the text"
    )
    return alt.hconcat(*panels, spacing=14).properties(title=title)

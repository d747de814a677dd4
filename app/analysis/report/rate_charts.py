"""Draw scores against the size of models, a line for each method, with the front of those that none beats at its
size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from app.analysis.drawing.charts_in_common import FULL, GAP, INK, MARGIN, colour_by, shape_by
from app.analysis.objective.against_scores import score_unit
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]

HEIGHT = 220  # pixels
AXIS = 60  # pixels of the vertical axis with its title
IN_A_ROW = 3
AROUND = 1.25  # times the largest size, and the same below the smallest
UNITS = ((1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "bytes"))
RING = 190  # square pixels of the ring around a point of the front


def rates_chart(analysis: Mapping[str, Any], width: int = FULL) -> Any:
    """Draw each dataset's scores with their intervals against the size of the models, all together last.

    Parameters
    ----------
    analysis : the content of analysis.json
    width : of the figure, in pixels

    Returns
    -------
    altair chart, or None where sizes or scores are not known
    """
    rows = analysis.get("rates", [])
    datasets = list(dict.fromkeys(row["dataset"] for row in rows))
    if not datasets or len({row["bytes"] for row in rows}) < 2:
        return None
    if len(datasets) == 2 and ALL in datasets:  # the only dataset is all of them
        datasets.remove(ALL)
    methods = list(dict.fromkeys(row["method"] for row in rows))
    in_a_row = min(IN_A_ROW, len(datasets))
    across = (width - AXIS - MARGIN - GAP * (in_a_row - 1)) / in_a_row
    sizes = [row["bytes"] for row in rows]
    scale, unit = next((scale, unit) for scale, unit in UNITS if min(sizes) >= scale or scale == 1)
    x_domain = [min(sizes) / AROUND / scale, max(sizes) * AROUND / scale]
    shades = (colour_by("method", "method", methods, width), shape_by("method", "method", methods, width))
    panels = [
        _panel(
            [row for row in rows if row["dataset"] == name], name, (x_domain, scale, unit), shades, score_unit(analysis)
        ).properties(width=across, height=HEIGHT)
        for name in datasets
    ]
    lines = [alt.hconcat(*panels[start : start + in_a_row], spacing=GAP) for start in range(0, len(panels), in_a_row)]
    title = alt.TitleParams(
        "Score against size", subtitle="bars: 95 % interval; ringed: no other condition is as small and scores as high"
    )
    return alt.vconcat(*lines).properties(title=title)


def _panel(
    rows: Sequence[Row],
    dataset: str,
    size: tuple[Sequence[float], float, str],
    shades: tuple[alt.Color, alt.Shape],
    unit: str,
) -> Any:
    domain, scale, size_unit = size
    values = [
        {
            **{name: row[name] for name in ("item", "method", "score", "is_on_front")},
            "size": row["bytes"] / scale,
            "low": row["score"] if row["ci_low"] is None else row["ci_low"],
            "high": row["score"] if row["ci_high"] is None else row["ci_high"],
        }
        for row in sorted(rows, key=lambda row: row["bytes"])
    ]
    x = alt.X(
        "size:Q",
        title=f"size of the model ({size_unit})",
        scale=alt.Scale(type="log", domain=list(domain), nice=False),
        axis=alt.Axis(tickCount=4, format="~g", labelOverlap=True),
    )
    title = f"score ({unit})"
    base = alt.Chart(alt.Data(values=values)).encode(x=x)
    front = alt.Chart(alt.Data(values=[value for value in values if value["is_on_front"]]))
    y = alt.Y("score:Q", title=title, scale=alt.Scale(zero=False))
    rings = front.mark_point(size=RING, color=INK, filled=False, strokeWidth=0.8, opacity=1).encode(x=x, y=y)
    curves = base.mark_line(strokeWidth=1.2, opacity=0.6).encode(y=y, color=shades[0])
    bars = base.mark_rule(opacity=0.5).encode(
        y=alt.Y("low:Q", title=title, scale=alt.Scale(zero=False)), y2=alt.Y2("high:Q"), color=shades[0]
    )
    points = base.mark_point(size=50, filled=True, opacity=1).encode(y=y, color=shades[0], shape=shades[1])
    return alt.layer(curves, bars, points, rings).properties(title="all datasets" if dataset == ALL else dataset)

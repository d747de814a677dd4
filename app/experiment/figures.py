"""Draw figures 6 to 8 in the paper's form: a curve of inliers, and bars of scores, each with its intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from app.analysis.drawing.charts_in_common import FULL, INK, MARGIN, PALETTE, colours_of
from app.analysis.reading.votes_table import ALL

LARGEST_MM = 100.0  # of the axis of figure 6
PUBLISHED, HERE = "published", "here"


def inlier_chart(curve: Sequence[Mapping[str, Any]], published: Mapping[str, float]) -> Any:
    """Draw figure 6: the share of inliers of the combined clouds against the threshold, beside the published points.

    Parameters
    ----------
    curve : rows of the combined clouds, of a sphere's report
    published : per cent by threshold in mm
    """
    ours = [
        {"source": HERE, "mm": row["threshold_mm"]}
        | {name: None if row[name] is None else 100 * row[name] for name in ("inliers", "ci_low", "ci_high")}
        for row in curve
    ]
    theirs = [{"source": PUBLISHED, "mm": float(mm), "inliers": share} for mm, share in published.items()]
    x = alt.X("mm:Q", title="threshold t, ± mm", scale=alt.Scale(domain=[0, LARGEST_MM]))
    y = alt.Y("inliers:Q", title="inliers, %", scale=alt.Scale(domain=[0, 100]))
    sources = alt.Scale(domain=[HERE, PUBLISHED], range=[PALETTE[1], PALETTE[2]])
    colour = alt.Color("source:N", title=None, scale=sources)
    base = alt.Chart(alt.Data(values=ours))
    band = base.mark_area(opacity=0.25, color=PALETTE[1]).encode(x=x, y=alt.Y("ci_low:Q", title=""), y2="ci_high:Q")
    line = base.mark_line().encode(x=x, y=y, color=colour)
    points = alt.Chart(alt.Data(values=theirs)).mark_point(size=80, filled=True, opacity=1, shape="diamond")
    return alt.layer(band, line, points.encode(x=x, y=y, color=colour)).properties(
        width=FULL - MARGIN - 130, height=260
    )


def levels_bars(rows: Sequence[Mapping[str, Any]], datasets: Sequence[str]) -> Any:
    """Draw figure 7 or 8: bars of the scores of a factor's levels, a group for each dataset, with 95 % intervals.

    Parameters
    ----------
    rows : `dataset`, `item` (a level), `score`, `ci_low` and `ci_high`
    datasets : from left to right; all of them together stand last
    """
    overall = sorted((row for row in rows if row["dataset"] == ALL), key=lambda row: row["score"])
    levels = [row["item"] for row in overall]
    base = alt.Chart(alt.Data(values=list(rows))).encode(
        x=alt.X("dataset:N", sort=[*datasets, ALL], title=None, axis=alt.Axis(labelAngle=0)),
        xOffset=alt.XOffset("item:N", sort=levels),
    )
    score = alt.Y("score:Q", title="score, log-odds", scale=alt.Scale(zero=True, nice=True))
    scale = alt.Scale(domain=levels, range=colours_of(len(levels) + 1)[1:])
    bars = base.mark_bar(opacity=0.85).encode(y=score, color=alt.Color("item:N", title=None, scale=scale))
    whiskers = base.mark_errorbar(ticks=True, color=INK).encode(
        y=alt.Y("ci_low:Q", title="score, log-odds"), y2="ci_high:Q"
    )
    return alt.layer(bars, whiskers).properties(width=FULL - MARGIN - 90, height=240)

"""Draw objective measures against the scores: a chart for each measure, and one that ranks them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import altair as alt
import numpy as np

from app.analysis.charts import FAINT, INK, PALETTE
from app.analysis.objective.logistic import Logistic
from app.analysis.objective.prediction import ALL, directed, measures_by_rank

Row = Mapping[str, Any]

WIDTH, HEIGHT = 420, 300  # pixels
MARGIN = 0.08  # of the range, around the points
SHAPES = ["circle", "square", "triangle-up", "diamond", "cross", "triangle-down"]
CURVE_STEPS = 80
LETTER_WIDTH, LETTER_HEIGHT = 5.6, 11.0  # pixels of a label's letters
GAP = 7.0  # pixels between a point and its label
ROW_HEIGHT = 17  # pixels of a measure in the ranking
RANKED = (  # column, title, what a measure without information gets
    ("pearson_logistic", "PLCC, logistic fit", 0.0),
    ("spearman", "SROCC", 0.0),
    ("auc_better_worse", "AUC, better or worse", 0.5),
)


class Box(NamedTuple):
    """A rectangle in pixels."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Box) -> bool:
        """Do the two overlap?"""
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )


def measure_chart(analysis: Mapping[str, Any], measure: str) -> Any:
    """Draw the scores with their intervals against a measure, with the logistic curve; colour and shape tell datasets
    apart. With several datasets, both are relative to the dataset's mean, as they are analysed.

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
    y_title, y_scale = f"score (log-odds){relative}", alt.Scale(domain=y_domain, nice=False)
    colors, legend = alt.Scale(domain=names, range=[*PALETTE] * len(names)), alt.Legend(symbolOpacity=1)
    y_axis = alt.Axis(titlePadding=10)
    color = alt.Color("dataset:N", sort=names, scale=colors, legend=legend)
    shape = alt.Shape("dataset:N", sort=names, scale=alt.Scale(domain=names, range=SHAPES * len(names)))
    base = alt.Chart(alt.Data(values=rows)).encode(x=x)
    bars = base.mark_rule(opacity=0.45).encode(
        y=alt.Y("low:Q", title=y_title, scale=y_scale, axis=y_axis), y2="high:Q", color=color
    )
    points = base.mark_point(size=60, filled=True, opacity=1).encode(
        y=alt.Y("y:Q", title=y_title, scale=y_scale, axis=y_axis), color=color, shape=shape
    )
    layers = [*_curve(overall, rows, x_domain), bars, points, *_labels(rows, x_domain, y_domain)]
    title = alt.TitleParams(f"Score against {measure}", subtitle=_subtitle(overall))
    return alt.layer(*layers).properties(width=WIDTH, height=HEIGHT, title=title)


def _points(analysis: Mapping[str, Any], measure: str) -> list[dict[str, Any]]:
    """Return the points that were compared, relative to their dataset's mean if there are several datasets."""
    values = analysis["settings"]["measures"].get(measure, {})
    compared = [row["dataset"] for row in analysis["measures"] if row["measure"] == measure]
    single = [name for name in compared if name != ALL] or compared
    points = []
    for name in single:
        rows = [
            row
            for row in analysis["scores"]
            if row["comparison"] == ALL and row["dataset"] == name and row["score"] is not None
            and row["item"] in values.get(name, {})
        ]  # fmt: skip
        means = [0.0, 0.0]
        if len(single) > 1 and rows:
            means = [
                float(np.mean([values[name][row["item"]] for row in rows])),
                float(np.mean([r["score"] for r in rows])),
            ]
        for row in rows:
            low, high = (row["score"] if row[end] is None else row[end] for end in ("ci_low", "ci_high"))
            x, y = values[name][row["item"]] - means[0], row["score"] - means[1]
            place = {"dataset": name, "item": row["item"], "x": x, "y": y}
            points.append(place | {"low": low - means[1], "high": high - means[1]})
    return points


def _domain(values: Sequence[float]) -> list[float]:
    low, high = min(values), max(values)
    margin = (high - low) * MARGIN or abs(high) * MARGIN or 1.0
    return [low - margin, high + margin]


def _curve(row: Row, points: Sequence[Row], domain: Sequence[float]) -> list[Any]:
    """Return the layer of the logistic curve, none where there is no fit."""
    if row["logistic_bottom"] is None:
        return []
    bottom, top, middle, width = (row[f"logistic_{name}"] for name in ("bottom", "top", "middle", "width"))
    fit = Logistic(bottom, top, middle, width, correlation=row["pearson_logistic"], status=row["logistic_status"])
    x = np.linspace(domain[0], domain[1], CURVE_STEPS)
    # The fit is to values and scores less their means, also where a single dataset is drawn as it is.
    means = [float(np.mean([point[side] for point in points])) for side in ("x", "y")]
    y = fit(x - means[0]) + means[1]
    values = [{"x": float(a), "y": float(b)} for a, b in zip(x, y, strict=True)]
    return [alt.Chart(alt.Data(values=values)).mark_line(color="#777777", strokeWidth=1.4).encode(x="x:Q", y="y:Q")]


def _labels(points: Sequence[Row], x_domain: Sequence[float], y_domain: Sequence[float]) -> list[Any]:
    """Return a layer for each side of the points with the names that have room there; names without room are left
    out.
    """
    across, down = WIDTH / (x_domain[1] - x_domain[0]), HEIGHT / (y_domain[1] - y_domain[0])
    centres = [((point["x"] - x_domain[0]) * across, (y_domain[1] - point["y"]) * down) for point in points]
    taken = [Box(x - GAP / 2, y - GAP / 2, x + GAP / 2, y + GAP / 2) for x, y in centres]
    taken += [  # the intervals
        Box(x - 1, (y_domain[1] - point["high"]) * down, x + 1, (y_domain[1] - point["low"]) * down)
        for point, (x, _) in zip(points, centres, strict=True)
    ]
    sides: dict[str, list[Row]] = {}
    for point, (x, y) in zip(points, centres, strict=True):
        for side, box in _places(x, y, len(point["item"]) * LETTER_WIDTH).items():
            is_inside = box.left >= 0 and box.right <= WIDTH and box.top >= 0 and box.bottom <= HEIGHT
            if is_inside and not any(box.meets(other) for other in taken):
                taken.append(box)
                sides.setdefault(side, []).append(point)
                break
    return [
        alt.Chart(alt.Data(values=there))
        .mark_text(fontSize=10, color=INK, limit=0, **PLACED[side])
        .encode(x="x:Q", y="y:Q", text="item:N")
        for side, there in sides.items()
    ]


PLACED: dict[str, dict[str, Any]] = {
    "right": {"align": "left", "baseline": "middle", "dx": GAP},
    "left": {"align": "right", "baseline": "middle", "dx": -GAP},
    "above": {"align": "center", "baseline": "bottom", "dy": -GAP},
    "below": {"align": "center", "baseline": "top", "dy": GAP},
}


def _places(x: float, y: float, width: float) -> dict[str, Box]:
    """Return where a label of this width may stand beside a point."""
    half, middle = LETTER_HEIGHT / 2, width / 2
    return {
        "right": Box(x + GAP, y - half, x + GAP + width, y + half),
        "left": Box(x - GAP - width, y - half, x - GAP, y + half),
        "above": Box(x - middle, y - GAP - LETTER_HEIGHT, x + middle, y - GAP),
        "below": Box(x - middle, y + GAP, x + middle, y + GAP + LETTER_HEIGHT),
    }


def _subtitle(row: Row) -> list[str]:
    numbers = [
        f"{name} {_signed(row[key])}" + ("" if row[f"{key}_low"] is None else
        f" [{_signed(row[f'{key}_low'])}, {_signed(row[f'{key}_high'])}]")
        for name, key in (("PLCC", "pearson_logistic"), ("SROCC", "spearman"))
        if row[key] is not None
    ]  # fmt: skip
    better = f"{row['better']} should be better" if row["better"] else "no stated direction"
    return [", ".join(numbers) or "too few points for a correlation", better]


def _signed(value: float) -> str:
    return f"{value:.2f}".replace("-", "−")


def ranking_chart(analysis: Mapping[str, Any]) -> Any:
    """Draw how well each measure predicts the scores over all datasets, with 95 % intervals, the best first.

    Correlations are positive where a measure predicts in the direction that it states. Points are filled where the
    interval excludes what a measure without information gets.

    Returns
    -------
    altair chart, or None without measures that can be compared
    """
    last = {row["measure"]: row for row in analysis["measures"]}
    names = [name for name in measures_by_rank(analysis["measures"]) if last[name]["spearman"] is not None]
    if not names:
        return None
    labels = [name if last[name]["better"] else f"{name} *" for name in names]
    panels: list[Any] = []
    for column, title, neutral in RANKED:
        if all(last[name][column] is None for name in names):
            continue
        rows = [_ranked(last[name], column) | {"measure": label} for name, label in zip(names, labels, strict=True)]
        panels.append(_ranking_panel(rows, labels, title, neutral, has_names=not panels))
    subtitle = ["line: 95 % interval; filled: it excludes what a measure without information gets (dashed)"]
    if any(not last[name]["better"] for name in names):
        subtitle.append("* no stated direction: taken from the votes, which flatters the measure")
    heading = alt.TitleParams("How well each measure predicts the scores", subtitle=subtitle)
    return alt.hconcat(*panels, spacing=14).properties(title=heading)


def _ranked(row: Row, column: str) -> dict[str, Any]:
    """Return a value with its interval, turned to the direction that should be better."""
    value, low, high = row[column], row[f"{column}_low"], row[f"{column}_high"]
    if not column.startswith("auc"):
        value, low, high = (directed(row, name) for name in (column, f"{column}_low", f"{column}_high"))
    neutral = 0.5 if column.startswith("auc") else 0.0
    is_clear = low is not None and high is not None and not min(low, high) <= neutral <= max(low, high)
    return {"value": value, "low": low, "high": high, "chance": "excluded" if is_clear else "possible"}


def _ranking_panel(rows: Sequence[Row], names: Sequence[str], title: str, neutral: float, *, has_names: bool) -> Any:
    there = [row for row in rows if row["value"] is not None]
    # A browser's letters may be wider than those that the space was measured with.
    extent = 1.2 * LETTER_WIDTH * max(len(name) for name in names) if has_names else 0
    axis = alt.Axis(
        grid=True, gridColor=FAINT, labels=has_names, ticks=has_names, labelLimit=0, minExtent=extent, maxExtent=extent
    )
    y = alt.Y("measure:N", sort=list(names), scale=alt.Scale(domain=list(names)), title=None, axis=axis)
    scale = alt.Scale(domain=[0, 1] if neutral else [-1, 1], nice=False)
    base = alt.Chart(alt.Data(values=there))
    bars = base.mark_rule(strokeWidth=1.6, color=INK).encode(
        y=y, x=alt.X("low:Q", title=title, scale=scale), x2="high:Q"
    )
    fill = alt.Fill(
        "chance:N", scale=alt.Scale(domain=["excluded", "possible"], range=[PALETTE[1], "#ffffff"]), legend=None
    )
    points = base.mark_point(size=46, opacity=1, strokeWidth=1.6, color=INK).encode(
        y=y, x=alt.X("value:Q", title=title, scale=scale), fill=fill
    )
    zero = (
        alt.Chart(alt.Data(values=[{"zero": neutral}])).mark_rule(strokeDash=[4, 3], color="#777777").encode(x="zero:Q")
    )
    return alt.layer(zero, bars, points).properties(width=190, height=alt.Step(ROW_HEIGHT))

"""Give the rows of analysis.json behind a figure, and the code, in Python and in R, that draws it anew from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain, count
from typing import Any

from app.analysis.reading.votes_table import ALL


@dataclass(frozen=True)
class Drawn:
    """What a figure draws: a table of analysis.json, the rows of it, and their columns.

    Parameters
    ----------
    table : its name
    rows : column -> value of the rows that are drawn
    y : column of the names; empty if the figure draws more than a column's values
    x : column of the values
    ends : columns of the limits of the intervals, if it draws any
    panels : column that gives each panel its name, empty for a single panel
    """

    table: str
    rows: Mapping[str, str]
    y: str = ""
    x: str = ""
    ends: tuple[str, str] | None = None
    panels: str = ""


def figure_rows(name: str, analysis: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the rows that a figure draws.

    Parameters
    ----------
    name, analysis : as in `figure_code`
    """
    drawn = _drawn(name, analysis)
    if drawn.table == "effects":
        return level_rows(analysis, drawn.rows["factor"])
    return [row for row in analysis[drawn.table] if drawn.rows.items() <= row.items()]


def level_rows(analysis: Mapping[str, Any], factor: str) -> list[Mapping[str, Any]]:
    """Return the effects of a factor's levels, all else equal, as rows of scores; its scores where there are none."""
    effects = [row for row in analysis["effects"] if row["factor"] == factor]
    return [{**row, "item": row["level"], "score": row["effect"]} for row in effects] or [
        row for row in analysis["scores"] if row["comparison"] == factor and row["score"] is not None
    ]


def figure_code(name: str, analysis: Mapping[str, Any]) -> dict[str, str]:
    """Return the code of a figure by its language; empty for one that no single table draws.

    The file analysis.json lies beside the report, and a server gives it at `/api/v1/studies/STUDY/analysis`.

    Parameters
    ----------
    name : of the figure
    analysis : the content of analysis.json
    """
    drawn = _drawn(name, analysis)
    return {"Python": _python(drawn), "R": _r(drawn)} if drawn.y else {}


def _drawn(name: str, analysis: Mapping[str, Any]) -> Drawn:
    ends = ("ci_low", "ci_high")
    kind, _, which = name.partition("_")
    if kind in ("scores", "levels"):
        comparison = names_by_file(analysis["scores"], "comparison").get(which, ALL)
        if kind == "levels" and any(row["factor"] == comparison for row in analysis["effects"]):
            return Drawn("effects", {"factor": comparison}, "level", "effect", ends, "dataset")
        return Drawn("scores", {"comparison": comparison}, "item", "score", ends, "dataset")
    if kind == "group":
        grouping = names_by_file(analysis["groups"], "grouping")[which]
        return Drawn("groups", {"grouping": grouping, "dataset": ALL}, "item", "score", ends, "group")
    if kind == "measure":
        return Drawn("measures", {"measure": names_by_file(analysis["measures"], "measure")[which]})
    return FIGURES[name]


FIGURES = {
    "preferences": Drawn("pairs", {"comparison": ALL, "dataset": ALL}, "item_a", "a", panels="item_b"),
    "residuals": Drawn("pairs", {"comparison": ALL, "dataset": ALL}),
    "measures": Drawn("measures", {}),
    "rates": Drawn("rates", {}, "item", "score", ("ci_low", "ci_high"), "dataset"),
    "triads": Drawn("triads_pooled", {}, "participant", "circular"),
    "response_times": Drawn("observers", {}, "participant", "median_response_ms"),
    "opinion_scores": Drawn("rating_items", {}, "condition", "mos", ("ci_low", "ci_high"), "dataset"),
    "differential_scores": Drawn("rating_items", {}, "condition", "dmos", ("dmos_low", "dmos_high"), "dataset"),
    "raters": Drawn("raters", {}, "participant", "bias", ("bias_low", "bias_high")),
    "alignment": Drawn("alignment_items", {}, "condition", "quality", ("quality_low", "quality_high"), "dataset"),
    "comparison_scores": Drawn("comparison_items", {}, "condition", "score", ("ci_low", "ci_high"), "dataset"),
}


def names_by_file(rows: Iterable[Mapping[str, Any]], column: str) -> dict[str, str]:
    """Return the names in a column by the part of a figure's file name that stands for them.

    Other signs than letters and digits become underscores; names that would share a file are numbered.
    """
    names: dict[str, str] = {}
    taken: set[str] = set()  # in small letters, which some file systems do not tell from capitals
    for name in dict.fromkeys(row[column] for row in rows):
        plain = "".join(character if character.isalnum() else "_" for character in name)
        candidates = chain([plain], (f"{plain}_{number}" for number in count(2)))
        file = next(candidate for candidate in candidates if candidate.casefold() not in taken)
        taken.add(file.casefold())
        names[file] = name
    return names


def _python(drawn: Drawn) -> str:
    rows = "".join(f"rows = rows[rows[{column!r}] == {value!r}]\n" for column, value in drawn.rows.items())
    interval = ""
    if drawn.ends:
        interval = f' + points.mark_rule().encode(x="{drawn.ends[0]}:Q", x2="{drawn.ends[1]}:Q")'
    panels = f'.facet("{drawn.panels}:N", columns=3)' if drawn.panels else ""
    return (
        "import json\nfrom pathlib import Path\n\nimport altair as alt\nimport pandas as pd\n\n"
        'analysis = json.loads(Path("analysis.json").read_text(encoding="utf-8"))\n'
        f'rows = pd.DataFrame(analysis["{drawn.table}"])\n{rows}'
        f'points = alt.Chart(rows).mark_point().encode(x="{drawn.x}:Q", y=alt.Y("{drawn.y}:N", sort="-x"))\n'
        f'chart = (points{interval}){panels}\nchart.save("figure.svg")\n'
    )


def _r(drawn: Drawn) -> str:
    rows = "".join(f"rows <- rows[rows${column} == {_quoted(value)}, ]\n" for column, value in drawn.rows.items())
    ends = f", xmin = {drawn.ends[0]}, xmax = {drawn.ends[1]}" if drawn.ends else ""
    mark = "geom_pointrange" if drawn.ends else "geom_point"
    panels = f" + facet_wrap(~{drawn.panels})" if drawn.panels else ""
    return (
        "library(ggplot2)\nlibrary(jsonlite)\n\n"
        f'rows <- fromJSON("analysis.json")${drawn.table}\n{rows}'
        f"ggplot(rows, aes({drawn.x}, reorder({drawn.y}, {drawn.x}){ends})) +\n  {mark}(){panels}\n"
        'ggsave("figure.png", width = 181, height = 120, units = "mm")\n'
    )


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

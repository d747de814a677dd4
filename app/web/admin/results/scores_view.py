"""Prepare an analysis for the results page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from fastapi import Request

from app.web.admin.listing import listed

MINUS = "−"
NOTHING = "–"
OF_MEASURES = "measures, "  # begins warnings that the page of measures against scores shows
# Findings that everybody needs. What is told apart is among them: without a difference, it is the result.
LEADING = (
    "interim",
    "ranking",
    "best",
    "worst",
    "difference",
    "told apart",
    "limits",
    "missing",
    "disagreement",
)

TRIADS_SORTABLE = ("participant", "circular", "p_value", "n_flags")

Row = Mapping[str, Any]


def results_view(request: Request, analysis: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the results page shows besides the rows of analysis.json."""
    from app.analysis.model.contrasts import SIGNIFICANT
    from app.analysis.report.sections import clearest_contrasts
    from app.analysis.report.tables import best_share, ranks

    pairs, triads = clearest_contrasts(analysis), _triads(analysis)
    return {
        "leading": [row["text"] for row in analysis["findings"] if row["about"] in LEADING],
        "findings": [row["text"] for row in analysis["findings"] if row["about"] not in (*LEADING, "settings")],
        "settings": [row["text"] for row in analysis["findings"] if row["about"] == "settings"],
        "pairs": listed(request, pairs, prefix="pairs_"),
        "n_pairs": len(pairs),
        "n_differing": sum(row["p_holm"] < SIGNIFICANT for row in pairs),
        "tests": [row for row in analysis["tests"] if row["dataset"] == "all"],
        "fits": [row for row in analysis["models"] if row["comparison"] == "all" and row["p_value"] is not None],
        "triads": listed(request, triads, TRIADS_SORTABLE, prefix="triads_"),
        "n_circular": sum(row["circular"] for row in triads),
        "n_with_circular": sum(row["circular"] > 0 for row in triads),
        "n_triads": len(triads),
        "outstanding": [row for row in triads if row["flags"]],
        "comparisons": scores_by_comparison(analysis),
        "datasets": unique(row["dataset"] for row in analysis["triads"]),
        "circular": {(row["participant"], row["dataset"]): row["circular"] for row in analysis["triads"]},
        "tables": _tables(analysis),
        "decimal": decimal,
        "ranks": ranks,
        "best_share": best_share,
        "p_value": p_value,
    }


def _triads(analysis: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return each participant's circular triads with what is unusual about the participant, most triads first."""
    flags = {row["participant"]: row["flags"] for row in analysis["observers"]}
    rows = [dict(row) | {"flags": flags.get(row["participant"], [])} for row in analysis["triads_pooled"]]
    return sorted((row | {"n_flags": len(row["flags"])} for row in rows), key=lambda row: -row["circular"])


def _tables(analysis: Mapping[str, Any]) -> list[str]:
    """Return the names of the tables to download, without empty ones."""
    shown = {
        "scores": analysis["scores"],
        "ratings": analysis.get("rating_items"),
        "comparisons": analysis.get("comparison_items"),
        "triads": analysis["triads"],
    }
    return ["votes", "trials", *(name for name, rows in shown.items() if rows), "observers", "validation"]


def scores_by_comparison(analysis: Mapping[str, Any]) -> dict[str, dict[str, list[Row]]]:
    """Return comparison -> dataset -> rows, best first."""
    grouped: dict[str, list[Row]] = {}
    for row in analysis["scores"]:
        grouped.setdefault(row["comparison"], []).append(row)
    return {comparison: by_dataset(rows) for comparison, rows in grouped.items()}


def by_dataset(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Return dataset -> rows, the best score first; all datasets together, then each by the alphabet."""

    def place(row: Row) -> tuple[bool, str, bool, float]:
        return row["dataset"] != "all", row["dataset"], row["score"] is None, -(row["score"] or 0.0)

    parts: dict[str, list[Row]] = {}
    for row in sorted(rows, key=place):
        parts.setdefault(row["dataset"], []).append(row)
    return parts


def groups_view(analysis: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return each grouping: its groups with their size, a test of their difference, and each item's score in them."""
    from app.analysis.drawing.figure_code import names_by_file

    return [_grouping(analysis, name, file) for file, name in names_by_file(analysis["groups"], "grouping").items()]


def _grouping(analysis: Mapping[str, Any], name: str, file: str) -> dict[str, Any]:
    from app.analysis.reading.phrases import with_interval

    datasets = unique(row["dataset"] for row in analysis["groups"])
    dataset = "all" if "all" in datasets else datasets[0]
    rows = [row for row in analysis["groups"] if row["grouping"] == name and row["dataset"] == dataset]
    groups = {row["group"]: row["n_participants"] for row in rows}
    cells = {(row["item"], row["group"]): with_interval(row, "score", "ci") or NOTHING for row in rows}
    items = unique(row["item"] for row in sorted(rows, key=lambda row: -(row["score"] or 0)))
    tests = [row for row in analysis["tests"] if row["name"] == f"group {name}" and row["dataset"] == dataset]
    return {
        "name": name,
        "figure": f"group_{file}",
        "groups": list(groups.items()),
        "p_value": p_value(tests[0]["p_holm"] if tests else None),
        "rows": [(item, *(cells.get((item, group), NOTHING) for group in groups)) for item in items],
    }


def decimal(value: float | None) -> str:
    """Format a number with two decimals and a true minus sign; None as a dash."""
    return NOTHING if value is None else f"{value:z.2f}".replace("-", MINUS)  # z: no negative zero


def p_value(value: float | None) -> str:
    if value is None:
        return NOTHING
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))

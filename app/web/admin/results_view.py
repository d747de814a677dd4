"""Prepare an analysis for the results page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

MINUS = "−"
NOTHING = "–"

Row = Mapping[str, Any]


def results_view(analysis: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the results page shows besides the rows of analysis.json."""
    return {
        "comparisons": scores_by_comparison(analysis),
        "datasets": unique(row["dataset"] for row in analysis["triads"]),
        "circular": {(row["participant"], row["dataset"]): row["circular"] for row in analysis["triads"]},
        "tables": _tables(analysis),
        "decimal": decimal,
        "p_value": p_value,
    }


def _tables(analysis: Mapping[str, Any]) -> list[str]:
    """Return the tables that there is something in, to be downloaded."""
    shown = {
        "scores": analysis["scores"],
        "ratings": analysis.get("rating_items"),
        "comparisons": analysis.get("comparison_items"),
        "triads": analysis["triads"],
    }
    return ["votes", "trials", *(name for name, rows in shown.items() if rows), "observers", "validation"]


def scores_by_comparison(analysis: Mapping[str, Any]) -> dict[str, dict[str, list[Row]]]:
    """Return comparison -> dataset -> rows, best first."""
    grouped: dict[str, dict[str, list[Row]]] = {}
    # All datasets together first: most readers look for them.
    for row in sorted(analysis["scores"], key=lambda row: bool(row["dataset"] != "all")):
        grouped.setdefault(row["comparison"], {}).setdefault(row["dataset"], []).append(row)
    for by_dataset in grouped.values():
        for rows in by_dataset.values():
            rows.sort(key=lambda row: -(row["score"] if row["score"] is not None else float("-inf")))
    return grouped


def groups_view(analysis: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return each grouping: its groups with their size, a test of their difference, and their scores over all datasets
    in rows of an item and its score in each group.
    """
    return [_grouping(analysis, name) for name in unique(row["grouping"] for row in analysis["groups"])]


def _grouping(analysis: Mapping[str, Any], name: str) -> dict[str, Any]:
    datasets = unique(row["dataset"] for row in analysis["groups"])
    dataset = "all" if "all" in datasets else datasets[0]
    rows = [row for row in analysis["groups"] if row["grouping"] == name and row["dataset"] == dataset]
    groups = {row["group"]: row["n_participants"] for row in rows}
    cells = {(row["item"], row["group"]): with_interval(row, "score", "ci") for row in rows}
    items = unique(row["item"] for row in rows)
    tests = [row for row in analysis["tests"] if row["name"] == f"group {name}" and row["dataset"] == dataset]
    return {
        "name": name,
        "figure": f"group_{''.join(character if character.isalnum() else '_' for character in name)}",
        "groups": list(groups.items()),
        "p_value": p_value(tests[0]["p_holm"] if tests else None),
        "rows": [(item, *(cells.get((item, group), NOTHING) for group in groups)) for item in items],
    }


def with_interval(row: Row, name: str, limits: str) -> str:
    """Format a value with its interval, whose columns begin with `limits`."""
    low, high = row.get(f"{limits}_low"), row.get(f"{limits}_high")
    interval = "" if low is None else f" ({decimal(low)} to {decimal(high)})"
    return f"{decimal(row[name])}{interval}"


def decimal(value: float | None, digits: int = 2) -> str:
    """Format a number with a true minus sign; None as a dash."""
    return NOTHING if value is None else f"{value:.{digits}f}".replace("-", MINUS)


def p_value(value: float | None) -> str:
    if value is None:
        return NOTHING
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))

"""Turn contrasts so that a condition of interest stands first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

Row = Mapping[str, Any]


def better_first(rows: Iterable[Row]) -> list[Row]:
    """Return contrasts with the better condition first, the clearest difference first."""
    turned = [row if row["difference"] >= 0 else _turned(row) for row in rows]
    return sorted(turned, key=lambda row: (row["p_holm"], -row["difference"]))


def contrast_between(rows: Iterable[Row], first: str, second: str) -> Row | None:
    """Return the contrast of two conditions; None if there is none.

    Parameters
    ----------
    rows : contrasts
    first, second : the conditions, in the order of the result
    """
    row = next((row for row in rows if {row["item_a"], row["item_b"]} == {first, second}), None)
    return row if row is None or row["item_a"] == first else _turned(row)


def _turned_ends(row: Row, name: str) -> dict[str, float | None]:
    """Return limits exchanged and with the other sign; none where the row has none."""
    if f"{name}_low" not in row:
        return {}
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return {f"{name}_low": None if high is None else -high, f"{name}_high": None if low is None else -low}


def _turned(row: Row) -> Row:
    """Return a contrast with its conditions exchanged."""
    people = {}
    if "people_preferring" in row:
        people = {
            "people_preferring": 1 - row["people_preferring"],
            "people_low": 1 - row["people_high"],
            "people_high": 1 - row["people_low"],
        }
    return {
        **row,
        **people,
        "item_a": row["item_b"],
        "item_b": row["item_a"],
        "difference": -row["difference"],
        "ci_low": None if row["ci_high"] is None else -row["ci_high"],
        "ci_high": None if row["ci_low"] is None else -row["ci_low"],
        **_turned_ends(row, "ci_simultaneous"),
    }

"""Make tables of ratings from the votes of a study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.ratings.table import ComparisonTable, RatingTable

Row = Mapping[str, Any]


def counted_ratings(rows: Iterable[Row]) -> list[Row]:
    """Return the votes that count: no practice, no exclusion, no check of the participant."""
    return [row for row in rows if row["role"] == "main" and not (row["practice"] or row["excluded"])]


def rating_table(rows: Iterable[Row], protocol: str, scale: tuple[float, float]) -> RatingTable:
    """Return the ratings of single stimuli; each is of `item_b`.

    Parameters
    ----------
    rows : counted votes, as a study's table of votes has them
    protocol : ACR, ACR-HR or DCR
    scale : its ends, worst and best
    """
    rows = list(rows)
    participants, person = _numbered(row["participant"] for row in rows)
    items, item = _numbered((row["dataset"], row["item_b"]) for row in rows)
    is_reference = np.zeros(len(items), bool)
    is_reference[item] = [row["reference"] for row in rows]
    rating = np.array([row["rating"] for row in rows], np.float64)
    return RatingTable(participants, items, person, item, rating, is_reference, protocol.lower(), *scale)


def comparison_table(rows: Iterable[Row]) -> ComparisonTable:
    """Return the comparisons of two stimuli (CCR).

    Parameters
    ----------
    rows : counted votes, as a study's table of votes has them
    """
    rows = list(rows)
    participants, person = _numbered(row["participant"] for row in rows)
    items, both = _numbered((row["dataset"], row[name]) for row in rows for name in ("item_a", "item_b"))
    rating = np.array([row["rating"] for row in rows], np.float64)
    a_first = np.array([row["first_shown"] == row["item_a"] for row in rows], bool)
    return ComparisonTable(participants, items, person, both[::2], both[1::2], rating, a_first)


def _numbered(values: Iterable[Any]) -> tuple[tuple[Any, ...], NDArray[np.intp]]:
    """Return the different values in order of appearance, and each value's index (N,)."""
    known: dict[Any, int] = {}
    index = np.array([known.setdefault(value, len(known)) for value in values], np.intp)
    return tuple(known), index

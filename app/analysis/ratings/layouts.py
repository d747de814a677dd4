"""Recognise tables of ratings in the words and shapes of other tools."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.layouts import SYNONYMS, plain, recognise
from app.analysis.reading.tabular import numbers, refuse, shown, texts
from app.analysis.reading.votes_table import VotesError

# Names in lower case, without spaces, points, hyphens and underscores.
WORDS = {
    "participant": SYNONYMS["participant"],
    "dataset": SYNONYMS["dataset"],
    "condition": (
        *("conditionid", "item", "itemid", "stimulus", "stimulusid", "pvs", "hrc", "method", "model", "system"),
        *("algorithm", "film", "video", "file", "filename"),
    ),
    "rating": ("score", "opinion", "opinionscore", "grade", "mark"),
}
NAMES = ("participant", "dataset", "condition")
FEWEST_COLUMNS = 2  # of ratings in a wide table; a single one may be anything


@dataclass(frozen=True)
class _Wide:
    """A table with ratings in many columns: what its rows and its columns are, and the columns of either kind."""

    rows: str
    columns: str
    rated: list[str]


def one_rating_a_row(frame: pd.DataFrame, scale: tuple[float, float]) -> tuple[pd.DataFrame, str]:
    """Return the table with one rating a row under our names, and what was recognised.

    A wide table has a row for each participant and a column for each condition, or the other way round; an empty cell
    is no rating. Any other table comes back as it is, with an empty note.

    Parameters
    ----------
    frame : as read
    scale : its ends

    Raises
    ------
    VotesError
        Naming the row and column of a cell of a wide table that is no rating.
    """
    given, theirs = _renamed(frame)
    notes = [f"{ours} is the column {shown(name)}" for ours, name in theirs.items() if ours != name]
    if {"participant", "condition", "rating"} <= set(given.columns):
        return given, "; ".join(notes)
    if wide := _wide(given):
        shape = f"a row for each {wide.rows}, a column for each of {len(wide.rated)} {wide.columns}s"
        return _long(given, wide, scale), "; ".join([shape, *notes])
    return frame, ""


def is_of_ratings(frame: pd.DataFrame) -> bool:
    """Does a table hold ratings, in any of the shapes that are read?"""
    if "rating" in frame.columns:  # a study's table of choices has the column, too, and it is empty
        return "condition" in frame.columns or bool((texts(frame["rating"]) != "").any())
    given, _ = _renamed(frame)
    return {"participant", "condition", "rating"} <= set(given.columns) or _wide(given) is not None


def _renamed(frame: pd.DataFrame) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return the table with our names where its own are recognised, and our names -> theirs."""
    theirs = _recognised(list(map(str, frame.columns)))
    return frame.rename(columns={name: ours for ours, name in theirs.items()}), theirs


def _recognised(names: Sequence[str]) -> dict[str, str]:
    """Return our names -> theirs; none for tables that compare two items."""
    known: dict[str, str] = {}
    if _compares(names):
        return known
    for ours, others in WORDS.items():
        alike = [name for name in names if plain(name) in (ours, *others)]
        if alike:
            known[ours] = ours if ours in names else alike[0]
    return known


def _compares(names: Sequence[str]) -> bool:
    """Does a table name two items, or a winner and a loser?"""
    known = {*names, *recognise(names).columns}
    return {"item_a", "item_b"} <= set(names) or {"item_a", "item_b", "choice"} <= known or "loser" in names


def _wide(frame: pd.DataFrame) -> _Wide | None:
    """Return how a wide table is laid out; None for any other, and for matrices of win counts."""
    named = [name for name in ("participant", "condition") if name in frame.columns]
    rated = [str(name) for name in frame.columns if name not in NAMES]
    if len(named) != 1 or len(rated) < FEWEST_COLUMNS or _compares(rated) or "rating" in frame.columns:
        return None
    if set(texts(frame[named[0]])) == set(rated) or not all(_is_numeric(frame[name]) for name in rated):
        return None
    return _Wide(named[0], "condition" if named[0] == "participant" else "participant", rated)


def _is_numeric(column: pd.Series) -> bool:
    """Does a column hold numbers and empty cells only?"""
    try:
        numbers(texts(column), "", may_be_negative=True)
    except VotesError:
        return False
    return True


def _long(frame: pd.DataFrame, wide: _Wide, scale: tuple[float, float]) -> pd.DataFrame:
    for name in wide.rated:
        _check_scale(name, numbers(texts(frame[name]), "", may_be_negative=True), scale)
    kept = [name for name in NAMES if name in frame.columns]
    long = frame.melt(id_vars=kept, value_vars=wide.rated, var_name=wide.columns, value_name="rating")
    long["rating"] = texts(long["rating"])
    return long.query("rating != ''")


def _check_scale(name: str, ratings: NDArray[np.float64], scale: tuple[float, float]) -> None:
    low, high = scale
    refuse(
        (ratings < low) | (ratings > high),
        lambda row: (
            f"the column {shown(name)} is {ratings[row]:g}, expected {low:g} to {high:g} (--scale names another scale; "
            "leave columns out that hold no ratings)"
        ),
    )

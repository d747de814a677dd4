"""Turn tables with a column for each pair, and matrices of win counts, into one vote a row."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.layouts import SYNONYMS, plain
from app.analysis.reading.tabular import named, numbers, refuse, shown, texts
from app.analysis.reading.votes_table import VotesError

PAIR = re.compile(r"^(.+?)\s+(?:vs\.?|versus|-|–|:|\|)\s+(.+)$", re.IGNORECASE)
WHO_AND_WHAT = {"participant", "dataset"}
FEWEST_PAIRS = 2  # columns; a single one may be anything


def one_vote_a_row(frame: pd.DataFrame, columns: Mapping[str, str]) -> tuple[pd.DataFrame, str]:
    """Return the table with one vote a row, and what was recognised; any other table as it is, with an empty note.

    A matrix of win counts has the same names in its first column and its header: a cell counts the votes for the row's
    item over the column's. A wide table has a row for each participant (and dataset) and a column for each pair, named
    "x vs y"; a cell names the preferred item, and an empty cell is no vote. `columns` are our names of columns ->
    the table's, as told.

    Raises
    ------
    VotesError
        Naming the row and column of a cell that is no count, or the columns of which one may name the participants.
    """
    if not set(columns) <= WHO_AND_WHAT:
        return frame, ""
    names = [str(name).strip() for name in frame.columns]
    first = [str(value).strip() for value in frame.iloc[:, 0]] if len(names) else []
    if len(names) > 2 and len(first) > 1 and set(first) == set(names[1:]) and len(first) == len(names) - 1:
        return _from_matrix(frame, first, names[1:]), f"a matrix of win counts of {len(first)} items"
    pairs = {name: match for name in names if (match := PAIR.match(name))}
    others = [name for name in names if name not in pairs]
    if len(pairs) < FEWEST_PAIRS or any(_is_one_of(("item_a", "item_b"), name) for name in others):
        return frame, ""
    if others and not any(name in columns.values() or _is_one_of(WHO_AND_WHAT, name) for name in others):
        raise VotesError(
            f"has a column for each of {len(pairs)} pairs, beside {named(others)}; "
            "say which column names the participants, e.g. --columns participant=judge"
        )
    return _from_wide(frame, pairs, others), f"a wide table with a column for each of {len(pairs)} pairs"


def _is_one_of(ours: Iterable[str], name: str) -> bool:
    return any(plain(name) in (plain(known), *SYNONYMS[known]) for known in ours)


def _from_matrix(frame: pd.DataFrame, rows: list[str], columns: list[str]) -> pd.DataFrame:
    votes = []
    for place, other in enumerate(columns, start=1):
        counts = _counts(frame.iloc[:, place], f"the column {shown(other)}")
        votes += [
            {"item_a": item, "item_b": other, "choice": "a", "count": int(count)}
            for item, count in zip(rows, counts, strict=True)
            if item != other and count > 0
        ]
    return pd.DataFrame(votes, columns=["item_a", "item_b", "choice", "count"], dtype=object)


def _counts(column: pd.Series, name: str) -> NDArray[np.float64]:
    """Return a column's numbers of wins, float64 (N,), NaN where empty."""
    cells = texts(column)
    counts = numbers(cells, name)
    refuse(counts % 1 > 0, lambda row: f"{name} is {shown(cells[row])}, expected a whole number of wins")
    return counts


def _from_wide(frame: pd.DataFrame, pairs: dict[str, re.Match[str]], others: list[str]) -> pd.DataFrame:
    given = frame.set_axis([str(name).strip() for name in frame.columns], axis=1)
    parts: list[pd.DataFrame] = []
    for name, match in pairs.items():
        part = given[others].copy()
        part["item_a"], part["item_b"], part["choice"] = match[1].strip(), match[2].strip(), given[name]
        parts.append(part.loc[texts(given[name]) != ""])
    together: pd.DataFrame = pd.concat(parts, ignore_index=True)
    return together

"""Bring a table of any described layout to one vote or rating a row, under our names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import (
    Column,
    Problems,
    Table,
    column_of,
    number_or_nan,
    numbered_names,
    same,
    shown,
)
from app.analysis.reading.description import JOIN, Description
from app.analysis.reading.votes_table import UNRECORDED, VotesError, unrecorded
from app.analysis.reading.words import OPTIONAL, RATING_OPTIONAL, TRUE_FALSE


@dataclass(frozen=True)
class LongTable(Table):
    """A table with one vote or rating a row, under our names.

    Parameters
    ----------
    origin : the column of the file that each row's choice or rating is from, for a wide table
    theirs : our name -> theirs, for messages
    """

    origin: Column | None = None
    theirs: Mapping[str, str] = field(default_factory=dict)

    def where(self, rows: NDArray[np.bool_]) -> Self:
        """Return the table with some rows, bool (N,), which keep their numbers in the file."""
        kept = super().where(rows)
        return kept if self.origin is None else replace(kept, origin=self.origin.where(rows))

    def cell(self, role: str, row: int) -> str:
        """Name a cell for a message: "rating", or the column of the file where that has another name."""
        if self.origin is not None and role in ("choice", "rating"):
            return f"the column {shown(self.origin.words[self.origin.codes[row]])}"
        theirs = self.theirs.get(role, role)
        return role if theirs == role else f"{role} (the column {shown(theirs)})"

    def wrong(self, role: str, row: int, expected: str) -> str:
        """Say what is wrong with a cell.

        Parameters
        ----------
        role : of its column
        row : counted from 0
        expected : in words
        """
        may_be_left = role in (*OPTIONAL, *RATING_OPTIONAL)
        instead = f" (--columns {role}=- if the column is something else)" if may_be_left else ""
        return f"{self.cell(role, row)} is {shown(self.columns[role].text(row))}, expected {expected}{instead}"

    def recorded(
        self,
        role: str,
        understand: Callable[[str], Any],
        expected: str,
        problems: Problems,
        *,
        may_be_empty: bool = True,
    ) -> NDArray[Any]:
        """Return what the cells of an optional column mean, (N,); without the column, and where empty, as unrecorded.

        Parameters
        ----------
        role : of the column
        understand : what a text means; None if nothing
        expected : in words
        problems : get what means nothing
        may_be_empty : else an empty cell is a problem
        """
        absent = unrecorded(role, len(self))
        if (column := self.columns.get(role)) is None:
            return absent
        empty = UNRECORDED.get(role, np.False_)
        meanings = [empty if may_be_empty and not word else understand(word) for word in column.words]
        is_bad = np.array([meaning is None for meaning in meanings], bool)[column.codes]
        problems.add(is_bad, lambda row: self.wrong(role, row, expected))
        return np.array([0 if meaning is None else meaning for meaning in meanings], absent.dtype)[column.codes]


def flags(rows: LongTable, role: str, problems: Problems) -> NDArray[Any]:
    """Return a column of true and false, (N,).

    Parameters
    ----------
    rows : one vote or rating a row
    role : of the column
    problems : get what is neither
    """
    return rows.recorded(role, lambda word: TRUE_FALSE.get(word.lower()), "true or false", problems)


def joined_column(table: Table, names: Sequence[str]) -> Column:
    """Return a column, or the texts of several with spaces between: a type and its level."""
    if len(names) == 1:
        return table.columns[names[0]]
    cells = zip(*(table.columns[name].texts for name in names), strict=True)
    return column_of(" ".join(filter(None, row)) for row in cells)


def rows_of(table: Table, description: Description) -> LongTable:
    """Return a table with one vote or rating a row, as its description says."""
    if description.without:
        table = table.where(~np.isin(np.arange(len(table)), description.without))
    if description.layout in SEVERAL_VOTES:
        return _of_votes(table, description, SEVERAL_VOTES[description.layout](table, description))
    return {"rows": _plain, "wide": _wide, "won": _won}[description.layout](table, description)


def _plain(table: Table, description: Description) -> LongTable:
    columns = {role: joined_column(table, names) for role, names in description.columns.items()}
    theirs = {role: JOIN.join(names) for role, names in description.columns.items()}
    return LongTable(columns, table.how, table.rows, theirs=theirs)


def _won(table: Table, description: Description) -> LongTable:
    rows = _plain(table, description)
    return replace(rows, columns={**rows.columns, "choice": same("a", len(table))})


def _wide(table: Table, description: Description) -> LongTable:
    """Stack the columns of a wide table; an empty cell is no vote or rating."""
    kept = {role: joined_column(table, names) for role, names in description.columns.items()}
    filled = [np.flatnonzero(table.columns[name].meaning(bool, bool)) for name in description.spread]
    place = np.concatenate([np.array([], np.intp), *filled])
    which = np.repeat(np.arange(len(filled), dtype=np.int32), [len(rows) for rows in filled])
    columns = {role: column.where(place) for role, column in kept.items()}
    value = "rating" if description.holds != "votes" else "choice"
    columns[value] = stacked(
        [table.columns[name].where(rows) for name, rows in zip(description.spread, filled, strict=True)]
    )
    labels = list(description.spread.values())
    origin = Column(which, tuple(description.spread))
    if description.spread_role == "pair":
        for side, role in enumerate(("item_a", "item_b")):
            columns[role] = origin.mapped(label[side] for label in labels)
    else:
        columns[description.spread_role] = origin.mapped(label[0] for label in labels)
    return LongTable(columns, table.how, table.numbers[place], origin=origin)


def stacked(columns: Sequence[Column]) -> Column:
    """Return columns one below the other."""
    known: dict[str, int] = {}
    codes = [numbered_names(column.words, known, np.int32)[column.codes] for column in columns]
    return Column(np.concatenate([np.array([], np.int32), *codes]), tuple(known))


Vote = tuple[int, str, str, str, int]  # row of the table, item_a, item_b, choice, count
Votes = Callable[[Table, Description], Iterator[Vote]]


WHO = ("participant", "dataset", "practice", "excluded", "reason")


def _of_votes(table: Table, description: Description, votes: Iterator[Vote]) -> LongTable:
    """Make rows of the votes that a row of the table, or several, give, with its columns on who and what."""
    made = list(votes)
    place = np.array([vote[0] for vote in made], np.intp)
    kept = {role: joined_column(table, names) for role, names in description.columns.items() if role in WHO}
    columns = {role: column.where(place) for role, column in kept.items()}
    for position, role in enumerate(("item_a", "item_b", "choice", "count"), start=1):
        columns[role] = column_of(vote[position] for vote in made)
    return LongTable(columns, table.how, table.numbers[place])


def _matrix(table: Table, description: Description) -> Iterator[Vote]:
    """Count the votes for a row's item over a column's."""
    items = table.columns[description.columns["item_a"][0]].texts
    for name, (other,) in description.spread.items():
        for row in range(len(table)):
            count = _count(table, row, name)
            if items[row] != other and count:
                yield row, items[row], other, "a", count


def _count(table: Table, row: int, name: str) -> int:
    """Return a cell's number of wins, 0 where it is empty."""
    cell = table.columns[name].text(row)
    count = number_or_nan(cell or "0")
    if not (count >= 0 and count == int(count)):
        raise VotesError(
            f"row {table.row(row)}: the column {shown(name)} is {shown(cell)}, expected a whole number of wins"
        )
    return int(count)


def _wins(table: Table, description: Description) -> Iterator[Vote]:
    """Count the wins of either item, and the ties."""
    counts = {"wins_a": "a", "wins_b": "b", "ties": "none"}
    names = [(description.columns[role][0], choice) for role, choice in counts.items() if role in description.columns]
    item_a, item_b = (joined_column(table, description.columns[role]).texts for role in ("item_a", "item_b"))
    for row in range(len(table)):
        for name, choice in names:
            if count := _count(table, row, name):
                yield row, item_a[row], item_b[row], choice, count


Ranked = tuple[int, list[tuple[float, str]]]  # row of the table, and ranks with their items


def _ranking(table: Table, description: Description) -> Iterator[Ranked]:
    """Yield the rankings of a table with a rank in each row: those of a participant, dataset and trial."""
    roles = [role for role in ("participant", "dataset", "trial") if role in description.columns]
    keys = [joined_column(table, description.columns[role]).texts for role in roles]
    groups: dict[tuple[str, ...], list[int]] = {}
    for row in range(len(table)):
        groups.setdefault(tuple(key[row] for key in keys), []).append(row)
    rank, items = description.columns["rank"][0], joined_column(table, description.columns["condition"]).texts
    for rows in groups.values():
        yield rows[0], [(_rank(table, row, rank), items[row]) for row in rows]


def _ranked(table: Table, description: Description) -> Iterator[Ranked]:
    """Yield the rankings of a table with a column for each place."""
    for row in range(len(table)):
        cells = [(float(place), table.columns[name].text(row)) for name, (place,) in description.spread.items()]
        yield row, [(place, item) for place, item in cells if item]


def _ranks(table: Table, description: Description) -> Iterator[Ranked]:
    """Yield the rankings of a table with a column for each item."""
    for row in range(len(table)):
        names = [name for name in description.spread if table.columns[name].text(row)]
        yield row, [(_rank(table, row, name), description.spread[name][0]) for name in names]


def _rank(table: Table, row: int, name: str) -> float:
    cell = table.columns[name].text(row)
    rank = number_or_nan(cell)
    if not rank > 0:
        raise VotesError(f"row {table.row(row)}: {name} is {shown(cell)}, expected a rank: 1 is best")
    return rank


def _pairs_of(rankings: Callable[[Table, Description], Iterator[Ranked]]) -> Votes:
    """Make a vote of every two items of a ranking; the same rank is no preference."""

    def votes(table: Table, description: Description) -> Iterator[Vote]:
        for row, places in rankings(table, description):
            for (rank, item), (other_rank, other) in combinations(places, 2):
                if item == other:
                    raise VotesError(f"row {table.row(row)}: {shown(item)} is ranked twice")
                choice = "none" if rank == other_rank else "a" if rank < other_rank else "b"
                yield row, item, other, choice, 1

    return votes


def _best_worst(table: Table, description: Description) -> Iterator[Vote]:
    """Prefer the best to all others of a row, and all others to the worst."""
    best, worst = (joined_column(table, description.columns[role]).texts for role in ("best", "worst"))
    options = [table.columns[name].texts for name in description.columns["options"]]
    for row in range(len(table)):
        cells = [texts[row] for texts in options if texts[row]]
        items = re.split(r"\s*[;|,]\s*", cells[0]) if len(options) == 1 and cells else cells
        for role, item in (("best", best[row]), ("worst", worst[row])):
            if item not in items:
                known = ", ".join(map(shown, items))
                raise VotesError(f"row {table.row(row)}: {role} is {shown(item)}, which is none of {known}")
        if best[row] == worst[row]:
            raise VotesError(f"row {table.row(row)}: {shown(best[row])} is the best and the worst")
        yield from ((row, best[row], item, "a", 1) for item in items if item != best[row])
        yield from ((row, item, worst[row], "a", 1) for item in items if item not in (best[row], worst[row]))


# Layouts whose rows, or several of them, give more than a vote.
SEVERAL_VOTES: dict[str, Votes] = {
    "matrix": _matrix,
    "wins": _wins,
    "ranking": _pairs_of(_ranking),
    "ranked": _pairs_of(_ranked),
    "ranks": _pairs_of(_ranks),
    "best-worst": _best_worst,
}

"""Bring a table of any described layout to one vote or rating a row, under our names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Self

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import Column, Table, column_of, number_or_nan, same, shown
from app.analysis.reading.description import Description
from app.analysis.reading.votes_table import VotesError


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


def joined_column(table: Table, names: Sequence[str]) -> Column:
    """Return a column, or the texts of several with spaces between: a type and its level."""
    if len(names) == 1:
        return table.columns[names[0]]
    cells = zip(*(table.columns[name].texts for name in names), strict=True)
    return column_of(" ".join(filter(None, row)) for row in cells)


def rows_of(table: Table, description: Description) -> LongTable:
    """Return a table with one vote or rating a row, as its description says."""
    kept = table
    if description.without:
        kept = table.where(~np.isin(np.arange(len(table)), description.without))
    return LAYOUTS[description.layout](kept, description)


def _plain(table: Table, description: Description) -> LongTable:
    columns = {role: joined_column(table, names) for role, names in description.columns.items()}
    return LongTable(
        columns, table.how, table.rows, theirs={r: "+".join(names) for r, names in description.columns.items()}
    )


def _won(table: Table, description: Description) -> LongTable:
    rows = _plain(table, description)
    return LongTable({**rows.columns, "choice": same("a", len(table))}, rows.how, rows.rows, theirs=rows.theirs)


def _wide(table: Table, description: Description) -> LongTable:
    """Stack the columns of a wide table; an empty cell is no vote or rating."""
    kept = {role: joined_column(table, names) for role, names in description.columns.items()}
    filled = [np.flatnonzero(table.columns[name].meaning(bool, bool)) for name in description.spread]
    place = np.concatenate([np.array([], np.intp), *filled])
    which = np.repeat(np.arange(len(filled), dtype=np.int32), [len(rows) for rows in filled])
    columns = {role: column.where(place) for role, column in kept.items()}
    value = "rating" if description.holds != "votes" else "choice"
    columns[value] = _stacked(
        [table.columns[name].where(rows) for name, rows in zip(description.spread, filled, strict=True)]
    )
    labels = list(description.spread.values())
    if description.spread_role == "pair":
        for side, role in enumerate(("item_a", "item_b")):
            columns[role] = _labelled([label[side] for label in labels], which)
    else:
        columns[description.spread_role] = _labelled([label[0] for label in labels], which)
    origin = Column(which, tuple(description.spread))
    return LongTable(columns, table.how, table.numbers[place], origin=origin)


def _labelled(labels: Sequence[str], which: NDArray[np.int32]) -> Column:
    place = {label: code for code, label in enumerate(dict.fromkeys(labels))}
    return Column(np.array([place[label] for label in labels], np.int32)[which], tuple(place))


def _stacked(columns: Sequence[Column]) -> Column:
    """Return columns one below the other."""
    known: dict[str, int] = {}
    codes = [
        np.array([known.setdefault(word, len(known)) for word in column.words], np.int32)[column.codes]
        for column in columns
    ]
    return Column(np.concatenate([np.array([], np.int32), *codes]), tuple(known))


Vote = tuple[int, str, str, str, int]  # row of the table, item_a, item_b, choice, count


def _of_votes(table: Table, description: Description, votes: Iterator[Vote], roles: Sequence[str]) -> LongTable:
    """Make rows of votes that several cells of a row of the table give, with its columns of these roles."""
    made = list(votes)
    place = np.array([vote[0] for vote in made], np.intp)
    kept = {role: joined_column(table, names) for role, names in description.columns.items() if role in roles}
    columns = {role: column.where(place) for role, column in kept.items()}
    for position, role in enumerate(("item_a", "item_b", "choice", "count"), start=1):
        columns[role] = column_of(vote[position] for vote in made)
    return LongTable(columns, table.how, table.numbers[place])


WHO = ("participant", "dataset", "practice", "excluded", "reason")


def _matrix(table: Table, description: Description) -> LongTable:
    """Count the votes for a row's item over a column's."""
    items = table.columns[description.columns["item_a"][0]].texts

    def votes() -> Iterator[Vote]:
        for name, (other,) in description.spread.items():
            for row, cell in enumerate(table.columns[name].texts):
                count = _count(table, row, name, cell)
                if items[row] != other and count:
                    yield row, items[row], other, "a", count

    return _of_votes(table, description, votes(), ())


def _count(table: Table, row: int, name: str, cell: str) -> int:
    """Return a cell's number of wins, 0 where it is empty."""
    count = number_or_nan(cell) if cell else 0.0
    if not (count >= 0 and count == int(count)):
        raise VotesError(
            f"row {table.row(row)}: the column {shown(name)} is {shown(cell)}, expected a whole number of wins"
        )
    return int(count)


def _wins(table: Table, description: Description) -> LongTable:
    names = {role: theirs[0] for role, theirs in description.columns.items() if role in ("wins_a", "wins_b", "ties")}
    item_a, item_b = (joined_column(table, description.columns[role]).texts for role in ("item_a", "item_b"))

    def votes() -> Iterator[Vote]:
        for row in range(len(table)):
            for role, choice in (("wins_a", "a"), ("wins_b", "b"), ("ties", "none")):
                if role in names:
                    cell = table.columns[names[role]].texts[row]
                    if count := _count(table, row, names[role], cell):
                        yield row, item_a[row], item_b[row], choice, count

    return _of_votes(table, description, votes(), WHO)


def _ranking(table: Table, description: Description) -> LongTable:
    """Make a vote of every two items of a ranking; the same rank is no preference."""
    if description.spread:
        cells = {int(place): table.columns[name].texts for name, (place,) in description.spread.items()}
        ranked = [
            (row, [(float(place), texts[row]) for place, texts in cells.items() if texts[row]])
            for row in range(len(table))
        ]
    else:
        ranked = list(_grouped(table, description))
    return _of_votes(table, description, _pairs_of(table, ranked), WHO)


def _grouped(table: Table, description: Description) -> Iterator[tuple[int, list[tuple[float, str]]]]:
    """Yield the rankings of a table with a rank in each row: those of a participant, dataset and trial."""
    keys = [
        joined_column(table, description.columns[role]).texts
        for role in ("participant", "dataset", "trial")
        if role in description.columns
    ]
    groups: dict[tuple[str, ...], list[int]] = {}
    for row in range(len(table)):
        groups.setdefault(tuple(key[row] for key in keys), []).append(row)
    rank_name, items = description.columns["rank"][0], joined_column(table, description.columns["condition"]).texts
    ranks = table.columns[rank_name].texts
    for rows in groups.values():
        yield rows[0], [(_rank(table, row, rank_name, ranks[row]), items[row]) for row in rows]


def _ranks(table: Table, description: Description) -> LongTable:
    ranked = []
    for row in range(len(table)):
        cells = {item: table.columns[name].texts[row] for name, (item,) in description.spread.items()}
        ranked.append((row, [(_rank(table, row, item, cell), item) for item, cell in cells.items() if cell]))
    return _of_votes(table, description, _pairs_of(table, ranked), WHO)


def _rank(table: Table, row: int, name: str, cell: str) -> float:
    rank = number_or_nan(cell)
    if not rank > 0:
        raise VotesError(f"row {table.row(row)}: {name} is {shown(cell)}, expected a rank: 1 is best")
    return rank


def _pairs_of(table: Table, ranked: Sequence[tuple[int, list[tuple[float, str]]]]) -> Iterator[Vote]:
    for row, places in ranked:
        for (rank, item), (other_rank, other) in combinations(places, 2):
            if item == other:
                raise VotesError(f"row {table.row(row)}: {shown(item)} is ranked twice")
            choice = "none" if rank == other_rank else "a" if rank < other_rank else "b"
            yield row, item, other, choice, 1


def _best_worst(table: Table, description: Description) -> LongTable:
    """Prefer the best to all others of a row, and all others to the worst."""
    best, worst = (joined_column(table, description.columns[role]).texts for role in ("best", "worst"))
    options = [table.columns[name].texts for name in description.columns["options"]]

    def votes() -> Iterator[Vote]:
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

    return _of_votes(table, description, votes(), WHO)


LAYOUTS: dict[str, Callable[[Table, Description], LongTable]] = {
    "rows": _plain,
    "wide": _wide,
    "won": _won,
    "matrix": _matrix,
    "wins": _wins,
    "ranking": _ranking,
    "ranks": _ranks,
    "best-worst": _best_worst,
}

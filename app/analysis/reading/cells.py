"""Hold a table as columns of few different texts, and name the cells of it that are wrong."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.votes_table import VotesError

LONGEST_VALUE = 80  # letters of a file that a message repeats
MOST_NAMED = 40  # columns that it names
DECIMAL_COMMA = re.compile(r"[+-]?(?!\d{1,3}(,\d{3})+$)\d+,\d+|[+-]?0,\d+")  # 1,5 and 0,125; 1,234 may be thousands
LARGEST_COUNT = 1e12  # of a row; sums of millions of such rows are whole numbers still
FLAGS = {"": 0, "0": 0, "false": 0, "no": 0, "1": 1, "true": 1, "yes": 1}  # in lower case


@dataclass(frozen=True)
class Column:
    """A column of texts; each cell points into the list of different ones, so that these are understood once.

    Parameters
    ----------
    codes : int32 (N,), index of each cell's text
    words : the different texts, without spaces around; "" where a cell is empty
    missing : bool (N,), cells that are not there at all; none by default
    """

    codes: NDArray[np.int32]
    words: tuple[str, ...]
    missing: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.codes)

    @cached_property
    def texts(self) -> NDArray[np.object_]:
        """Return the cells' texts, object (N,)."""
        return np.array(self.words, object)[self.codes] if self.words else np.array([], object)

    def text(self, row: int) -> str:
        """Return the text of one cell."""
        return self.words[int(self.codes[row])]

    @cached_property
    def seen(self) -> tuple[str, ...]:
        """Return the texts that some cell has, in order of the list."""
        is_seen = np.zeros(len(self.words), bool)
        is_seen[self.codes] = True
        return tuple(word for word, there in zip(self.words, is_seen, strict=True) if there)

    @cached_property
    def filled(self) -> tuple[str, ...]:
        """Return the texts of cells that are not empty."""
        return tuple(word for word in self.seen if word)

    def meaning(self, understand: Callable[[str], Any], kind: type[Any]) -> NDArray[Any]:
        """Return what each cell means, (N,): each different text is asked for once."""
        return np.array([understand(word) for word in self.words], kind)[self.codes]

    def where(self, rows: NDArray[np.bool_] | NDArray[np.integer[Any]]) -> Column:
        """Return some cells, which are bool (N,) or int (M,)."""
        return Column(self.codes[rows], self.words, None if self.missing is None else self.missing[rows])


def column_of(cells: Iterable[Any]) -> Column:
    """Make a column of any cells; numbers, dates and None become texts as `texts` says."""
    values = list(cells)
    known: dict[str, int] = {}
    codes = np.array([known.setdefault(_text(value), len(known)) for value in values], np.int32)
    missing = np.array([value is None or _is_nan(value) for value in values], bool)
    return Column(codes, tuple(known), missing if missing.any() else None)


def _column_of_series(series: pd.Series) -> Column:
    """Make a column of one of pandas; where its cells are all of a kind, each different one is looked at once."""
    if pd.api.types.infer_dtype(series, skipna=True) not in ("string", "integer", "floating", "boolean"):
        return column_of(series.tolist())
    codes, different = pd.factorize(series)
    known: dict[str, int] = {}
    index = [known.setdefault(_text(value), len(known)) for value in different.tolist()]
    missing = codes < 0
    if missing.any():
        index.append(known.setdefault("", len(known)))  # where the code is -1
    return Column(np.array(index, np.int32)[codes], tuple(known), missing if missing.any() else None)


def same(word: str, n_rows: int) -> Column:
    """Make a column with the same text in all cells, which takes the memory of one."""
    return Column(np.broadcast_to(np.array(0, np.int32), n_rows), (word,))


@dataclass(frozen=True)
class Table:
    """A table as a file holds it: columns by name, and how the file was read.

    Parameters
    ----------
    columns : name -> cells
    how : how the file was read, in words
    rows : int (N,), the row of the file of each row, from 1 without the header; all of them in order by default
    notes, warnings : sentences on what was left out or restated
    """

    columns: Mapping[str, Column]
    how: str = ""
    rows: NDArray[np.int64] | None = None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    @property
    def names(self) -> list[str]:
        """Names of the columns, in the file's order."""
        return list(self.columns)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Rows of the file, from 1, int64 (N,)."""
        return np.arange(1, len(self) + 1, dtype=np.int64) if self.rows is None else self.rows

    def row(self, index: int) -> int:
        """Row of the file, from 1, of a row counted from 0."""
        return index + 1 if self.rows is None else int(self.rows[index])

    def where(self, rows: NDArray[np.bool_]) -> Self:
        """Return the table with some rows, bool (N,), which keep their numbers in the file."""
        columns = {name: column.where(rows) for name, column in self.columns.items()}
        return replace(self, columns=columns, rows=self.numbers[rows])

    def with_columns(self, columns: Mapping[str, Column], **changes: Any) -> Table:
        """Return the table with other columns of the same rows."""
        return replace(self, columns=columns, **changes)


def table_of_frame(frame: pd.DataFrame) -> Table:
    """Make a table of a pandas one, whose `attrs["understood"]` say how it was read."""
    columns = {str(name): _column_of_series(frame.iloc[:, place]) for place, name in enumerate(frame.columns)}
    if len(columns) < frame.shape[1]:
        names = [str(name) for name in frame.columns]
        twice = next(name for name in names if names.count(name) > 1)
        raise VotesError(f"has {names.count(twice)} columns named {shown(twice)}, expected one")
    return Table(columns, frame.attrs.get("understood", ""))


def table_of_rows(rows: Sequence[Mapping[str, Any]], how: str = "") -> Table:
    """Make a table of dictionaries; a name that a row lacks is a missing cell."""
    names = list(dict.fromkeys(str(name) for row in rows for name in row))
    return Table({name: column_of([row.get(name) for row in rows]) for name in names}, how)


class Problems:
    """Collect what is wrong with cells, one line for each kind, and raise them together.

    Parameters
    ----------
    row : the row of the file of a row counted from 0
    """

    def __init__(self, row: Callable[[int], int]) -> None:
        self.row = row
        self.lines: list[str] = []

    def add(self, is_bad: NDArray[np.bool_], why: str | Callable[[int], str]) -> None:
        """Note the first of the bad rows, bool (N,), with the reason and the number of further ones."""
        rows = np.flatnonzero(is_bad)
        if len(rows):
            reason = why if isinstance(why, str) else why(int(rows[0]))
            self.lines.append(_line(self.row(int(rows[0])), reason, len(rows)))

    def check(self) -> None:
        """Raise if anything is wrong."""
        if self.lines:
            raise VotesError("\n".join(self.lines))


def _line(row: int, reason: str, n_rows: int) -> str:
    more = f" (and {n_rows - 1} more rows like it)" if n_rows > 1 else ""
    return f"row {row}: {reason}{more}"


def refuse(is_bad: NDArray[np.bool_], why: str | Callable[[int], str]) -> None:
    """Raise for the first bad row, with the reason and the number of further ones.

    Parameters
    ----------
    is_bad : bool (N,)
    why : the reason, or a function that returns that of a row, counted from 0

    Raises
    ------
    VotesError
        If any row is bad.
    """
    problems = Problems(lambda row: row + 1)
    problems.add(is_bad, why)
    problems.check()


def texts(cells: Iterable[Any]) -> NDArray[np.object_]:
    """Return cells as stripped texts, object (N,): empty where missing, whole numbers without decimals."""
    return np.array([_text(cell) for cell in cells], object)


def _text(cell: Any) -> str:
    if isinstance(cell, str):
        return cell.strip()
    if _is_nan(cell):
        return ""
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell).strip()


def _is_nan(cell: Any) -> bool:
    return not isinstance(cell, str) and bool(pd.api.types.is_scalar(cell) and pd.isna(cell))


def numbers(values: NDArray[np.object_], name: str, *, may_be_negative: bool = False) -> NDArray[np.float64]:
    """Return a column's texts as numbers, NaN where empty.

    Parameters
    ----------
    values : object (N,), texts
    name : of the column, for the error
    may_be_negative : accept numbers below 0

    Returns
    -------
    float64 (N,)

    Raises
    ------
    VotesError
        Naming the row and the value.
    """
    expected = "a number or nothing" if may_be_negative else "a number, 0 or more, or nothing"
    parsed = np.array([number_or_nan(value) for value in values], np.float64)
    is_bad = ~np.isfinite(parsed) | ((parsed < 0) & (not may_be_negative))
    refuse(is_bad & (values != ""), lambda row: f"{name} is {shown(values[row])}, expected {expected}")
    return parsed


def number(text: str) -> float:
    """Return a text as a number, with a decimal point or comma; raises ValueError for any other text."""
    return float(text.replace(",", ".") if DECIMAL_COMMA.fullmatch(text) else text)


def number_or_nan(text: str) -> float:
    """Return a text as a finite number, else NaN."""
    try:
        value = number(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def is_numeric(column: Column) -> bool:
    """Does a column hold numbers and empty cells only, and at least one number?"""
    return bool(column.filled) and all(not math.isnan(number_or_nan(word)) for word in column.filled)


def values_of(column: Column) -> Iterator[float]:
    """Yield the different numbers of a column."""
    return (number_or_nan(word) for word in column.filled)


def shown(value: object) -> str:
    """Return a value for a message: quoted, short, and without letters that a terminal cannot print."""
    return repr(printable(value))


def printable(value: object) -> str:
    """Return a value for a message: short, and without letters that a terminal cannot print."""
    text = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in str(value))
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}…"


def named(names: Sequence[str], most: int = MOST_NAMED) -> str:
    """Return the names of columns for a message: some of them, where there are very many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(map(printable, names[:most])) + more

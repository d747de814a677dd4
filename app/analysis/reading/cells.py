"""Hold a table as columns of few different texts, and name the cells of it that are wrong."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.phrases import counted
from app.analysis.reading.votes_table import VotesError

FEW = 100  # rows that are wrong in one way, of which it is asked whether all are the first
LONGEST_VALUE = 80  # letters of a file that a message repeats
FEWEST_SORTED = 2**26  # keys of which not each has a byte
LARGEST_KEY = 2**62  # that an int64 holds
MOST_NAMED = 40  # columns that it names
DECIMAL_COMMA = re.compile(r"[+-]?(?!\d{1,3}(,\d{3})+$)\d+,\d+|[+-]?0,\d+")  # 1,5 and 0,125; 1,234 may be thousands


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

    @property
    def is_missing(self) -> NDArray[np.bool_]:
        """Which cells are not there at all? bool (N,)."""
        return np.broadcast_to(np.bool_(False), len(self)) if self.missing is None else self.missing

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

    @cached_property
    def compact(self) -> Column:
        """Return the column with only the texts that some cell has."""
        place = {word: code for code, word in enumerate(self.seen)}
        codes = np.array([place.get(word, 0) for word in self.words], np.int32)
        return self if len(place) == len(self.words) else Column(codes[self.codes], self.seen, self.missing)

    def tells_alike(self, other: Column) -> bool:
        """Does another column tell the same rows apart?"""
        pairs = len(np.unique(self.codes.astype(np.int64) * len(other.words) + other.codes))
        return pairs == len(self.seen) == len(other.seen)

    def mapped(self, words: Iterable[str]) -> Column:
        """Return the column with other words in the place of its own; those that are the same become one."""
        known: dict[str, int] = {}
        return Column(numbered_names(words, known, np.int32)[self.codes], tuple(known))


def numbered_names(values: Iterable[Hashable], known: dict[Any, int], kind: type[Any] = np.intp) -> NDArray[Any]:
    """Return each value's number, `kind` (N,), in order of appearance after those already known.

    Parameters
    ----------
    values : names
    known : name -> number; gets the new ones
    kind : of numbers
    """
    return np.array([known.setdefault(value, len(known)) for value in values], kind)


def is_repeated(values: Iterable[Hashable]) -> NDArray[np.bool_]:
    """Which values stand there before, too? bool (N,)."""
    return np.asarray(np.diff(np.maximum.accumulate(numbered_names(values, {})), prepend=-1) == 0)


def n_different(columns: Sequence[Column]) -> int:
    """Return how many rows some columns tell apart."""
    key, size = np.zeros(len(columns[0]), np.int64), 1
    for column in columns:
        if size * len(column.words) > LARGEST_KEY:
            key, kept = pd.factorize(key)
            size = len(kept)
        key = key * len(column.words) + column.codes
        size *= len(column.words)
    if size > FEWEST_SORTED:
        return len(pd.unique(key))
    is_there = np.zeros(size, bool)
    is_there[key] = True
    return int(np.count_nonzero(is_there))


def column_of(cells: Iterable[Any]) -> Column:
    """Make a column of any cells; numbers, dates and None become texts as `texts` says."""
    values = list(cells)
    known: dict[str, int] = {}
    codes = numbered_names(map(_text, values), known, np.int32)
    missing = np.array([value is None or _is_nan(value) for value in values], bool)
    return Column(codes, tuple(known), missing if missing.any() else None)


def column_of_series(series: pd.Series) -> Column:
    """Make a column of one of pandas; where its cells are all of a kind, each different one is looked at once."""
    if pd.api.types.infer_dtype(series, skipna=True) not in ("string", "integer", "floating", "boolean"):
        return column_of(series.tolist())
    codes, different = pd.factorize(series)
    known: dict[str, int] = {}
    missing = codes < 0  # the last of the texts
    texts = [*map(_text, different.tolist()), *([""] if missing.any() else [])]
    return Column(numbered_names(texts, known, np.int32)[codes], tuple(known), missing if missing.any() else None)


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

    def without_empty_rows(self) -> Self:
        """Return the table without the rows in which every cell is empty."""
        if not all("" in column.words for column in self.columns.values()) or not self.columns:
            return self
        is_there = np.logical_or.reduce([column.meaning(bool, bool) for column in self.columns.values()])
        return self if is_there.all() else self.where(is_there)


def table_of_frame(frame: pd.DataFrame, how: str = "") -> Table:
    """Make a table of a pandas one."""
    columns = {str(name): column_of_series(frame.iloc[:, place]) for place, name in enumerate(frame.columns)}
    if len(columns) < frame.shape[1]:
        names = [str(name) for name in frame.columns]
        twice = next(name for name in names if names.count(name) > 1)
        raise VotesError(f"has {names.count(twice)} columns named {shown(twice)}, expected one")
    return Table(columns, how)


def table_of_rows(rows: Sequence[Mapping[str, Any]], how: str = "") -> Table:
    """Make a table of dictionaries; a name that a row lacks is a missing cell."""
    names = list(dict.fromkeys(str(name) for row in rows for name in row))
    return Table({name: column_of([row.get(name) for row in rows]) for name in names}, how)


@dataclass
class Problems:
    """Collect what is wrong with cells, one line for each kind, and raise them together.

    Parameters
    ----------
    row : the row of the file of a row counted from 0
    lines : what is wrong, in words
    wrong_rows : rows of the file in which it is, some of each kind
    """

    row: Callable[[int], int]
    lines: list[str] = field(default_factory=list)
    wrong_rows: list[int] = field(default_factory=list)

    def add(self, is_bad: NDArray[np.bool_], why: str | Callable[[int], str]) -> None:
        """Note the first of the bad rows, bool (N,), with the reason and the number of further ones."""
        rows = np.flatnonzero(is_bad)
        if len(rows):
            first = int(rows[0])
            self.wrong_rows += map(self.row, rows[:FEW].tolist())
            more = f" (and {counted(len(rows) - 1, 'more row')} like it)" if len(rows) > 1 else ""
            self.lines.append(f"row {self.row(first)}: {why if isinstance(why, str) else why(first)}{more}")

    def check(self) -> None:
        """Raise if anything is wrong."""
        if len(self.wrong_rows) > 1 and set(self.wrong_rows) == {1}:
            self.lines.append("nothing else is wrong: if row 1 is a second header, delete row 1")
        if self.lines:
            raise VotesError("\n".join(self.lines))


def _text(cell: Any) -> str:
    if isinstance(cell, str):
        return cell.strip()
    if _is_nan(cell):
        return ""
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell).strip()


def _is_nan(cell: Any) -> bool:
    return not isinstance(cell, str) and bool(pd.api.types.is_scalar(cell) and pd.isna(cell))


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


def printable(value: object, most: int = LONGEST_VALUE) -> str:
    """Return a value for a message: short, and without letters that a terminal cannot print."""
    text = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in str(value))
    return text if len(text) <= most else f"{text[:most]}…"


def named(names: Sequence[str], most: int = MOST_NAMED) -> str:
    """Return the names of columns for a message: some of them, where there are very many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(map(printable, names[:most])) + more

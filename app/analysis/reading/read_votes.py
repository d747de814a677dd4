"""Read votes: recognise a table, then read it by its description. The second half of reading, for votes.

Rows are counted from 1, without the header. Nothing is dropped in silence: an error names the row, the column and the
value, and sentences say which columns were used as what, which were not, and who and what is in the table.
"""

from __future__ import annotations

import unicodedata
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.cells import (
    FLAGS,
    LARGEST_COUNT,
    Column,
    Problems,
    Table,
    named,
    number_or_nan,
    shown,
    table_of_frame,
    table_of_rows,
)
from app.analysis.reading.choices import UNKNOWN, Asked, Meaning, codes_of
from app.analysis.reading.description import VOTES, Description, QuestionError, Told
from app.analysis.reading.layouts import LongTable, rows_of
from app.analysis.reading.phrases import listed
from app.analysis.reading.programs import restated
from app.analysis.reading.recognise import recognise
from app.analysis.reading.tabular import read_table
from app.analysis.reading.votes_table import (
    CHOICES,
    IDENTICAL,
    NAMES,
    NONE,
    ROLE_CODES,
    ROLES,
    VotesError,
    VotesTable,
    constant,
    joined,
)
from app.analysis.reading.words import OPTIONAL, RATING_OPTIONAL

WARNING = "Warning: "  # begins a sentence that is one
MAY_BE_UNKNOWN = {"participant": "votes count as independent", "dataset": "all votes are on one dataset"}
MOST_NAMED = 8  # participants, datasets and conditions that are listed

Rows = Iterable[Mapping[str, Any]]


@dataclass(frozen=True)
class Source:
    """A file that was read and recognised: its table, and what that is."""

    path: Path
    table: Table
    description: Description

    @property
    def holds_votes(self) -> bool:
        """Does it hold votes, and not ratings?"""
        return self.description.holds == VOTES


def recognise_file(path: Path | str, told: Told | None = None) -> Source:
    """Read a file's cells and recognise what they are.

    Raises
    ------
    QuestionError
        If several readings fit, with the option that picks each.
    VotesError
        Naming the file, and the row and the value where there is one.
    """
    path, told = Path(path), told or Told()
    table = read_table(path, told)
    try:
        table = restated(table, told.format, "" if path.suffix.lower() == ".xlsx" else told.sheet)
        return Source(path, table, recognise(table, told))
    except QuestionError as question:
        raise question.at(path) from None
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error


def votes_from_rows(
    rows: Rows | pd.DataFrame, columns: Mapping[str, str] | None = None, choices: Mapping[str, str] | None = None
) -> VotesTable:
    """Make a votes table from dictionaries or a pandas table, of any layout that a file may have.

    Parameters
    ----------
    rows : with at least item_a, item_b and choice
    columns : our name of a column -> the name in `rows`, where it differs
    choices : our word `a`, `b` or `none` -> the word in `rows`, where it differs

    Raises
    ------
    VotesError
        Naming the row and the value.
    """
    table = _table_of(rows)
    description = recognise(table, Told(columns or {}, choices or {}))
    if description.holds != VOTES:
        raise VotesError(f"holds {description.holds}, expected votes: item_a, item_b and choice")
    return _votes(rows_of(table, description), description)


def _table_of(rows: Rows | pd.DataFrame) -> Table:
    if isinstance(rows, pd.DataFrame):
        return table_of_frame(rows.reset_index(drop=True))
    if isinstance(rows, str | bytes | Mapping):
        raise VotesError(f"{type(rows).__name__} is no table of votes, expected rows with named values or a DataFrame")
    kept = list(rows)
    for number, row in enumerate(kept, start=1):
        if not isinstance(row, Mapping):
            raise VotesError(f"row {number}: {shown(row)} is not an object with named values")
    return table_of_rows(kept)


def read_votes(
    path: Path | str, columns: Mapping[str, str] | None = None, choices: Mapping[str, str] | None = None
) -> VotesTable:
    """Read a votes table from a file: text with commas, semicolons or tabs, JSON, Parquet or Excel.

    Parameters
    ----------
    path : a file whose name ends in .csv, .tsv, .csv.gz, .json, .jsonl, .parquet or .xlsx
    columns, choices : as in `votes_from_rows`; without them, names and words of other tools are recognised

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    return understand_votes([path], columns, choices)[0]


def understand_votes(
    paths: Sequence[Path | str | Source],
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
    told: Told | None = None,
) -> tuple[VotesTable, list[str]]:
    """Read the votes of one or several files as one table, and say how each was understood.

    Parameters
    ----------
    paths : as in `read_votes`, or files already recognised; a name means the same person in all of them
    columns, choices : as in `votes_from_rows`, for every file
    told : all that the user said, instead

    Returns
    -------
    VotesTable, and the sentences; those that begin with `WARNING` are warnings

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    told = told or Told(columns or {}, choices or {})
    tables, sentences, warnings = [], [], []
    for path in paths:
        source = path if isinstance(path, Source) else recognise_file(path, told)
        table = votes_of(source)
        tables.append(table)
        sentences.append(_sentence(source, table))
        warnings += [
            f"{WARNING}{source.path.name}: {text}" for text in (*source.table.warnings, *source.description.warnings)
        ]
    votes = tables[0] if len(tables) == 1 else joined(tables)
    return votes, [*sentences, *_look_alikes(votes), *in_several(table.participants for table in tables), *warnings]


def votes_of(source: Source) -> VotesTable:
    """Read the votes of a recognised file by its description."""
    if not source.holds_votes:
        raise VotesError(f"{source.path}: holds {source.description.holds}, expected votes: item_a, item_b and choice")
    try:
        return _votes(rows_of(source.table, source.description), source.description)
    except VotesError as error:
        raise VotesError(f"{source.path}: {error}") from error


def _sentence(source: Source, votes: VotesTable) -> str:
    """Say how a file was understood: the three lists, and a fingerprint that changes with any vote."""
    unknown = [name for name in MAY_BE_UNKNOWN if getattr(votes, f"{name}s") == ("",)]
    weights = None if votes.count.strides == (0,) else np.asarray(votes.count, np.float64)
    chosen = np.bincount(votes.choice, weights, minlength=3).astype(np.int64)
    tally = ", ".join(f"{word} {n}" for word, n in zip(CHOICES, chosen, strict=True))
    parts = [
        source.table.how,
        f"{len(votes)} rows, {votes.n_votes} votes",
        *_left_out(votes),
        *source.table.notes,
        *source.description.notes,
        *(f"no {name} is named: {MAY_BE_UNKNOWN[name]}" for name in unknown),
    ]
    people = [(votes.participants if votes.has_participants else (), "participant"),
              (votes.items, "condition"),
              (votes.datasets if votes.has_datasets else (), "dataset")]  # fmt: skip
    return in_lists(source, parts, people, f"choices: {tally}; fingerprint {_fingerprint(votes)}")


def _left_out(votes: VotesTable) -> list[str]:
    """Say how many votes do not count, and why."""
    counts = {"practice": votes.practice, "excluded": votes.excluded, "checks": votes.role != 0}
    if votes.used().n_votes == votes.n_votes:
        return []
    why = ", ".join(f"{int(votes.count[rows].sum())} {what}" for what, rows in counts.items() if rows.any())
    return [f"{votes.used().n_votes} of them count ({why or 'others'})"]


def in_lists(source: Source, parts: Sequence[str], names: Sequence[tuple[Sequence[str], str]], rest: str) -> str:
    """Say how a file was read, and in three lists which columns are used, which are not, and who and what is in it.

    Parameters
    ----------
    source : the file
    parts : what is said of it first
    names : names, and what they are: participants, conditions, datasets
    rest : what is said last
    """
    unused = [name or "a column without a name" for name in source.description.not_used]
    not_used = f"not used: {named(unused)}" if unused else "every column is used"
    used = "; ".join(source.description.used)
    lists = [f"{len(list_)} {what}{'' if len(list_) == 1 else 's'}: {_few(list_)}" for list_, what in names if list_]
    first = f"{source.path.name}: {'; '.join(filter(None, (*parts, not_used)))}"
    return "\n- ".join([first, f"used: {used}", "; ".join(lists), rest])


def _few(names: Sequence[str]) -> str:
    return named(list(names), MOST_NAMED)


def _fingerprint(votes: VotesTable) -> str:
    """Return a number that changes with any vote, name or exclusion."""
    columns = [getattr(votes, field.name) for field in fields(VotesTable) if field.name not in (*NAMES, "reason")]
    return fingerprint([votes.participants, votes.datasets, votes.items], columns)


def fingerprint(names: Sequence[object], columns: Sequence[NDArray[Any]]) -> str:
    """Return a checksum of names and columns (N,), as eight letters; a column of one value counts as that value."""
    check = zlib.crc32(repr(names).encode())
    for column in columns:
        is_one = column.strides == (0,)
        check = zlib.crc32(np.ascontiguousarray(column[:1] if is_one else column).data, check)
    return f"{check:08x}"


def in_several(participants: Iterable[Sequence[str]]) -> list[str]:
    """Say if files share participants, who are then taken for the same people; the names in each file are given."""
    names = [name for file in participants for name in file if name]
    twice = [name for name, n in Counter(names).items() if n > 1]
    if not twice:
        return []
    return [f"{listed(twice)} {'is' if len(twice) == 1 else 'are'} in several files and counted as the same people"]


def _look_alikes(votes: VotesTable) -> list[str]:
    """Name participants, datasets and items that differ in nothing but capitals, accents, spaces or signs."""
    sentences = []
    for what in ("participants", "datasets", "items"):
        alike: dict[str, list[str]] = {}
        for name in getattr(votes, what):
            letters = filter(str.isalnum, unicodedata.normalize("NFKD", name))
            alike.setdefault("".join(letters).casefold() or name, []).append(name)
        for names in alike.values():
            if len(names) > 1:
                quoted = " and ".join(map(repr, names))
                sentences.append(f"{quoted} look alike and are counted as {len(names)} {what}")
    return sentences


def _votes(rows: LongTable, description: Description) -> VotesTable:
    """Return the votes of rows under our names."""
    if not len(rows):
        raise VotesError("has no row, expected at least one vote")
    problems, n = Problems(rows.row), len(rows)
    participant, participants = _names(rows, "participant", problems)
    dataset, datasets = _names(rows, "dataset", problems)
    columns = rows.columns
    for name in ("item_a", "item_b"):
        _check_there(rows, name, problems)
    item_a, item_b, items = _both(columns["item_a"], columns["item_b"])
    role = _coded(rows, "role", lambda word: ROLE_CODES.get(word, UNKNOWN), np.int8)
    if role is not None:
        problems.add(role == UNKNOWN, lambda r: _wrong(rows, "role", r, ", ".join(ROLES)))
    identical = item_a == item_b if role is None else (item_a == item_b) & (role != IDENTICAL)
    problems.add(
        identical & (columns["item_a"].meaning(bool, bool)),
        lambda r: f"the item {items[item_a[r]]!r} is compared with itself",
    )
    votes = VotesTable(
        participants,
        datasets,
        items,
        participant=participant,
        dataset=dataset,
        item_a=item_a,
        item_b=item_b,
        choice=_choice(rows, description, problems),
        first_shown=_first_shown(rows, item_a, item_b, items, problems),
        both_seen=flags(rows, "both_seen", problems, empty=-1, kind=np.int8, absent=-1),
        shown_smoothly=flags(rows, "shown_smoothly", problems, empty=-1, kind=np.int8, absent=-1),
        count=_counts(rows, problems),
        response_ms=_numbers(rows, "response_ms", problems),
        press_to_picture_ms=_numbers(rows, "press_to_picture_ms", problems),
        practice=flags(rows, "practice", problems),
        excluded=flags(rows, "excluded", problems),
        reason=columns["reason"].texts if "reason" in columns else constant("", np.object_, n),
        role=constant(0, np.int8, n) if role is None else role,
    )
    problems.check()
    return votes


def _wrong(rows: LongTable, role: str, row: int, expected: str) -> str:
    column = rows.columns[role]
    instead = f" (--columns {role}=- if the column is something else)" if role in (*OPTIONAL, *RATING_OPTIONAL) else ""
    return f"{rows.cell(role, row)} is {shown(column.text(row))}, expected {expected}{instead}"


def _check_there(rows: LongTable, role: str, problems: Problems) -> None:
    column = rows.columns[role]
    if column.missing is not None:
        problems.add(column.missing, f"{role} is missing")
    is_empty = column.meaning(lambda word: not word, bool)
    problems.add(is_empty if column.missing is None else is_empty & ~column.missing, f"{role} is empty")


def _names(rows: LongTable, role: str, problems: Problems) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Return the index of each row's name, int32 (N,), and the names; a single empty one if none is recorded."""
    column = rows.columns.get(role)
    if column is None:
        return constant(0, np.int32, len(rows)), ("",)
    codes, names = _in_order(column)
    if "" in names and len(names) > 1:
        problems.add(codes == names.index(""), f"{role} is empty")
    return codes, names


def _in_order(column: Column) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Return a column with only the texts that are there."""
    seen = column.seen
    if len(seen) == len(column.words):
        return column.codes, column.words
    place = {word: code for code, word in enumerate(seen)}
    return np.array([place.get(word, 0) for word in column.words], np.int32)[column.codes], seen


def _both(a: Column, b: Column) -> tuple[NDArray[np.int32], NDArray[np.int32], tuple[str, ...]]:
    """Return both columns of items as codes into one list: first all of `item_a`, in the order of appearance."""
    item_a, names = _in_order(a)
    codes_b, names_b = _in_order(b)
    place = {name: code for code, name in enumerate(names)}
    index = np.array([place.setdefault(name, len(place)) for name in names_b], np.int32)
    return item_a, index[codes_b], tuple(place)


def _coded(rows: LongTable, role: str, understand: Any, kind: type[Any]) -> NDArray[Any] | None:
    column = rows.columns.get(role)
    return None if column is None else column.meaning(understand, kind)


def _choice(rows: LongTable, description: Description, problems: Problems) -> NDArray[np.int8]:
    columns = rows.columns
    column = columns["choice"]
    if description.layout in ("rows", "wide"):
        meaning = Meaning({word: int(code) for word, code in description.words.items()}, description.by_item)
    else:
        meaning = Meaning({word: code for code, word in enumerate(CHOICES)})
    codes = codes_of(meaning, Asked(column, columns["item_a"], columns["item_b"]))
    expected = description.expected or ", ".join(CHOICES)
    if column.missing is not None:
        problems.add(column.missing, "choice is missing")
    problems.add(
        (codes == UNKNOWN) & (True if column.missing is None else ~column.missing),
        lambda r: _wrong(rows, "choice", r, expected),
    )
    return np.where(flags(rows, "ties", problems), NONE, codes).astype(np.int8) if "ties" in columns else codes


def _first_shown(
    rows: LongTable, item_a: NDArray[np.int32], item_b: NDArray[np.int32], items: tuple[str, ...], problems: Problems
) -> NDArray[np.int8]:
    column = rows.columns.get("first_shown")
    if column is None:
        return constant(-1, np.int8, len(rows))
    place = {name: index for index, name in enumerate(items)} | {"": -1}
    there = column.meaning(lambda word: place.get(word, -2), np.int32)
    first = np.select([there == -1, there == item_a, there == item_b], [-1, 0, 1], default=-2).astype(np.int8)
    problems.add(
        first == -2,
        lambda r: _wrong(rows, "first_shown", r, f"{shown(items[item_a[r]])} or {shown(items[item_b[r]])} or nothing"),
    )
    return first


def flags(
    rows: LongTable, role: str, problems: Problems, *, empty: int = 0, kind: type[Any] = np.bool_, absent: int = 0
) -> NDArray[Any]:
    """Return a column of true and false, `kind` (N,).

    Parameters
    ----------
    rows : one vote or rating a row
    role : of the column
    problems : get what is neither
    empty : what an empty cell is
    kind : of numbers that the answers are
    absent : what all cells are without the column
    """
    known = FLAGS | {"": empty}
    codes = _coded(rows, role, lambda word: known.get(word.lower(), -2), np.int8)
    if codes is None:
        return constant(absent, kind, len(rows))
    problems.add(codes == -2, lambda r: _wrong(rows, role, r, "true or false"))
    return codes.astype(kind)


def _numbers(rows: LongTable, role: str, problems: Problems) -> NDArray[np.float64]:
    """Return a column of numbers, NaN where empty, or without the column."""
    values = _coded(rows, role, number_or_nan, np.float64)
    if values is None:
        return constant(np.nan, np.float64, len(rows))
    is_bad = (np.isnan(values) & rows.columns[role].meaning(bool, bool)) | (values < 0)
    problems.add(is_bad, lambda r: _wrong(rows, role, r, "a number, 0 or more, or nothing"))
    return values


def _counts(rows: LongTable, problems: Problems) -> NDArray[np.int64]:
    values = _coded(rows, "count", number_or_nan, np.float64)
    if values is None:
        return constant(1, np.int64, len(rows))
    with np.errstate(invalid="ignore"):
        is_bad = ~((values >= 0) & (values <= LARGEST_COUNT) & (values == np.floor(values)))
    problems.add(is_bad, lambda r: _wrong(rows, "count", r, f"a whole number, 0 to {LARGEST_COUNT:.0f}"))
    return np.where(is_bad, 0, values).astype(np.int64)

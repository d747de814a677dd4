"""Read votes by the description of a table: the second half of reading, for votes.

Rows are counted from 1, without the header; an error names the row, the column and the value.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.cells import Column, Problems, Table, number_or_nan, shown, table_of_frame, table_of_rows
from app.analysis.reading.choices import UNKNOWN, Asked, Meaning, codes_of
from app.analysis.reading.description import VOTES, Description, Told
from app.analysis.reading.layouts import LongTable, flags, rows_of, stacked
from app.analysis.reading.phrases import counted
from app.analysis.reading.recognise import recognise
from app.analysis.reading.sources import Source, fingerprint, in_lists, in_several, look_alikes, recognise_file
from app.analysis.reading.votes_table import (
    CHOICE_CODES,
    CHOICES,
    IDENTICAL,
    NAMES,
    NONE,
    ROLE_CODES,
    ROLES,
    VotesError,
    VotesTable,
    joined,
    naming,
    unrecorded,
)
from app.analysis.reading.words import NOT_THERE

LARGEST_COUNT = 1e12  # of a row; sums of millions of such rows are whole numbers still
MAY_BE_UNKNOWN = {"participant": "votes count as independent", "dataset": "all votes are on one dataset"}

Rows = Iterable[Mapping[str, Any]]


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
    return _votes(table, recognise(table, Told(columns or {}, choices or {})))


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
    return understand_votes([path], Told(columns or {}, choices or {}))[0]


def understand_votes(paths: Sequence[Path | str | Source], told: Told | None = None) -> tuple[VotesTable, list[str]]:
    """Read the votes of one or several files as one table, and say how each was understood.

    Parameters
    ----------
    paths : as in `read_votes`, or files already recognised; a name means the same person in all of them
    told : all that the user said, for every file

    Returns
    -------
    VotesTable, and the sentences; those that begin with `WARNING` are warnings

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    tables, sentences, warnings = [], [], []
    for path in paths:
        source = path if isinstance(path, Source) else recognise_file(path, told)
        table = votes_of(source)
        tables.append(table)
        sentences.append(_sentence(source, table))
        warnings += source.warned()
    votes = tables[0] if len(tables) == 1 else joined(tables)
    names = {what: getattr(votes, what) for what in ("participants", "datasets", "items")}
    return votes, [*sentences, *look_alikes(names), *in_several(table.participants for table in tables), *warnings]


def votes_of(source: Source) -> VotesTable:
    """Read the votes of a recognised file by its description."""
    with naming(source.path):
        return _votes(source.table, source.description)


def _sentence(source: Source, votes: VotesTable) -> str:
    """Say how a file was understood: the three lists, and a fingerprint that changes with any vote."""
    unknown = [name for name in MAY_BE_UNKNOWN if getattr(votes, f"{name}s") == ("",)]
    weights = None if votes.count.strides == (0,) else np.asarray(votes.count, np.float64)
    chosen = np.bincount(votes.choice, weights, minlength=3).astype(np.int64)
    tally = ", ".join(f"{word} {n}" for word, n in zip(CHOICES, chosen, strict=True))
    parts = [
        source.table.how,
        f"{counted(len(source.table), 'row')}, {counted(votes.n_votes, 'vote')}",
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


def _fingerprint(votes: VotesTable) -> str:
    """Return a number that changes with any vote, name or exclusion."""
    columns = [getattr(votes, field.name) for field in fields(VotesTable) if field.name not in (*NAMES, "reason")]
    return fingerprint([votes.participants, votes.datasets, votes.items], columns)


def _votes(table: Table, description: Description) -> VotesTable:
    """Return the votes of a table under our names."""
    if description.holds != VOTES:
        raise VotesError(f"holds {description.holds}, expected votes: item_a, item_b and choice")
    rows = rows_of(table, description)
    if not len(rows):
        raise VotesError("has no row, expected at least one vote")
    problems = Problems(rows.row)
    participant, participants = _names(rows, "participant", problems)
    dataset, datasets = _names(rows, "dataset", problems)
    columns = rows.columns
    for name in ("item_a", "item_b"):
        _check_there(rows, name, problems)
    item_a, item_b, items = _both(columns["item_a"], columns["item_b"])
    role = rows.recorded("role", ROLE_CODES.get, ", ".join(ROLES), problems)
    problems.add(
        (item_a == item_b) & (role != IDENTICAL) & columns["item_a"].meaning(bool, bool),
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
        both_seen=flags(rows, "both_seen", problems),
        shown_smoothly=flags(rows, "shown_smoothly", problems),
        count=rows.recorded("count", _whole, f"a whole number, 0 to {LARGEST_COUNT:.0f}", problems, may_be_empty=False),
        response_ms=_numbers(rows, "response_ms", problems),
        press_to_picture_ms=_numbers(rows, "press_to_picture_ms", problems),
        practice=flags(rows, "practice", problems),
        excluded=flags(rows, "excluded", problems),
        reason=columns["reason"].texts if "reason" in columns else unrecorded("reason", len(rows)),
        role=role,
    )
    problems.check()
    return votes


def _check_there(rows: LongTable, role: str, problems: Problems) -> None:
    column = rows.columns[role]
    problems.add(column.is_missing, f"{role} is missing")
    problems.add(column.meaning(lambda word: not word, bool) & ~column.is_missing, f"{role} is empty")


def _names(rows: LongTable, role: str, problems: Problems) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Return the index of each row's name, int32 (N,), and the names; a single empty one if none is recorded."""
    column = rows.columns.get(role)
    if column is None:
        return unrecorded(role, len(rows)), ("",)
    column = column.compact
    if "" in column.words and len(column.words) > 1:
        problems.add(column.meaning(lambda word: not word, bool), f"{role} is empty")
    return column.codes, column.words


def _both(a: Column, b: Column) -> tuple[NDArray[np.int32], NDArray[np.int32], tuple[str, ...]]:
    """Return both columns of items as codes into one list: first all of `item_a`, in the order of appearance."""
    both = stacked([a.compact, b.compact])
    return both.codes[: len(a)], both.codes[len(a) :], both.words


def _choice(rows: LongTable, description: Description, problems: Problems) -> NDArray[np.int8]:
    column = rows.columns["choice"]
    words = {word: int(code) for word, code in description.words.items()} or CHOICE_CODES
    asked = Asked(column, rows.columns["item_a"], rows.columns["item_b"])
    codes = codes_of(Meaning(words, description.by_item), asked)
    expected = description.expected or ", ".join(CHOICES)
    problems.add(column.is_missing, "choice is missing")
    ways = dict.fromkeys(("", *NOT_THERE), "; leave out rows without an answer")
    is_unknown = (codes == UNKNOWN) & ~column.is_missing
    problems.add(is_unknown, lambda r: rows.wrong("choice", r, expected) + ways.get(column.text(r), ""))
    return np.where(flags(rows, "ties", problems), NONE, codes).astype(np.int8)


def _first_shown(
    rows: LongTable, item_a: NDArray[np.int32], item_b: NDArray[np.int32], items: tuple[str, ...], problems: Problems
) -> NDArray[np.int8]:
    column = rows.columns.get("first_shown")
    if column is None:
        return unrecorded("first_shown", len(rows))
    place = {name: index for index, name in enumerate(items)} | {"": -1}
    there = column.meaning(lambda word: place.get(word, -2), np.int32)
    first = np.select([there == -1, there == item_a, there == item_b], [-1, 0, 1], default=-2).astype(np.int8)
    problems.add(
        first == -2,
        lambda r: rows.wrong("first_shown", r, f"{shown(items[item_a[r]])} or {shown(items[item_b[r]])} or nothing"),
    )
    return first


def _numbers(rows: LongTable, role: str, problems: Problems) -> NDArray[np.float64]:
    """Return a column of numbers, NaN where empty, or without the column."""
    return rows.recorded(role, _measured, "a number, 0 or more, or nothing", problems)


def _measured(word: str) -> float | None:
    return value if (value := number_or_nan(word)) >= 0 else None


def _whole(word: str) -> float | None:
    return value if (value := number_or_nan(word)) <= LARGEST_COUNT and value >= 0 and value == int(value) else None

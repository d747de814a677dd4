"""Read a votes table strictly from a file or rows, in our column names or another tool's.

Rows are counted from 1, without the header. Nothing is dropped: an error names the row and the value. Sentences say
which names and words were recognised, not given.
"""

from __future__ import annotations

import csv
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.layouts import (
    MAY_BE_UNKNOWN,
    OPTIONAL,
    REQUIRED,
    Layout,
    choice_codes,
    our_columns,
    recognise,
    unused_columns,
)
from app.analysis.reading.phrases import listed
from app.analysis.reading.quick_reading import QUICK_FROM, quick_votes
from app.analysis.reading.tabular import flags, named, numbers, read_frame, refuse, shown, texts
from app.analysis.reading.votes_table import IDENTICAL, ROLE_CODES, ROLES, VotesError, VotesTable, joined
from app.analysis.reading.wide_tables import one_vote_a_row

WITHOUT_COLUMN = {"count": "1"}  # what each cell of a column that is not there would say; of others nothing
WITHOUT_NAMES = {"participant": "votes count as independent", "dataset": "all votes are on one dataset"}

Rows = Iterable[Mapping[str, Any]]


def votes_from_rows(
    rows: Rows | pd.DataFrame,
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
) -> VotesTable:
    """Make a votes table from dictionaries or a pandas table.

    Parameters
    ----------
    rows : with at least item_a, item_b and choice; a pandas table may have any layout that a file may have
    columns : our name of a column -> the name in `rows`, where it differs
    choices : our word `a`, `b` or `none` -> the word in `rows`, where it differs

    Raises
    ------
    VotesError
        Naming the row and the value.
    """
    if isinstance(rows, pd.DataFrame):
        return _votes_from_frame(rows.reset_index(drop=True), columns, choices)[0]
    if isinstance(rows, str | bytes | Mapping):
        raise VotesError(f"{type(rows).__name__} is no table of votes, expected rows with named values or a DataFrame")
    kept = list(rows)
    for number, row in enumerate(kept, start=1):
        if not isinstance(row, Mapping):
            raise VotesError(f"row {number}: {shown(row)} is not an object with named values")
    return _votes_from_frame(pd.DataFrame(kept, dtype=object), columns, choices)[0]


def read_votes(
    path: Path | str,
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
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
    paths: Sequence[Path | str],
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
) -> tuple[VotesTable, list[str]]:
    """Read the votes of one or several files as one table, and say how each was understood.

    Parameters
    ----------
    paths : as in `read_votes`; a participant's name means the same person in all of them
    columns, choices : as in `votes_from_rows`, for every file

    Returns
    -------
    VotesTable, and the sentences

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    tables, sentences = [], []
    for path in map(Path, paths):
        table, how, notes = _read_quickly(path, columns, choices) or _read_strictly(path, columns, choices)
        tables.append(table)
        rest = "".join(f"; {note}" for note in notes)
        sentences.append(f"{path.name}: {how}; {len(table)} rows, {table.n_votes} votes{rest}")
    votes = tables[0] if len(tables) == 1 else joined(tables)
    return votes, [*sentences, *_look_alikes(votes), *in_several(table.participants for table in tables)]


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


def _read_quickly(
    path: Path, columns: Mapping[str, str] | None, choices: Mapping[str, str] | None
) -> tuple[VotesTable, str, Sequence[str]] | None:
    """Read a large clean CSV file as `_read_strictly` does; None if it needs that."""
    if path.suffix.lower() != ".csv" or not path.is_file() or path.stat().st_size < QUICK_FROM:
        return None
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = next(csv.reader(file))
        layout = recognise(header, columns, choices)
    except (ValueError, StopIteration):
        return None
    given = {name: layout.columns.get(name, name) for name in (*REQUIRED, *OPTIONAL)}
    there = {name: theirs for name, theirs in given.items() if header.count(theirs) == 1}
    if not set(REQUIRED) <= there.keys() or len(set(header)) < len(header) or set(layout.columns) - there.keys():
        return None
    table = quick_votes(path, there, layout.choice_codes)
    if table is None or ({"a", "b"} & set(table.items) and not layout.choices):  # a choice may be a name
        return None
    return table, "text in UTF-8, commas between cells", layout.notes


def _read_strictly(
    path: Path, columns: Mapping[str, str] | None, choices: Mapping[str, str] | None
) -> tuple[VotesTable, str, Sequence[str]]:
    """Read a file of any layout: the votes, how its cells were understood, and what was recognised in them."""
    frame = read_frame(path)
    try:
        table, notes = _votes_from_frame(frame, columns, choices)
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error
    return table, frame.attrs.get("understood", ""), notes


def _votes_from_frame(
    frame: pd.DataFrame, columns: Mapping[str, str] | None, choices: Mapping[str, str] | None
) -> tuple[VotesTable, list[str]]:
    """Return the votes, and which names and words were recognised, not given."""
    frame, note = one_vote_a_row(frame, columns or {})
    notes = [note] if note else []
    layout = recognise(tuple(map(str, frame.columns)), columns, choices)
    notes += layout.notes
    ours = our_columns(frame, layout)
    if ours.empty:
        raise VotesError("has no row, expected at least one vote")
    for name in REQUIRED[2:]:
        refuse(ours[name].isna().to_numpy(), f"{name} is missing")  # its row is too short
    text = {
        name: texts(ours[name].to_list()) if name in ours else np.full(len(ours), WITHOUT_COLUMN.get(name, ""), object)
        for name in (*REQUIRED, *OPTIONAL)
    }
    unknown = [name for name in MAY_BE_UNKNOWN if not text[name].any()]
    notes += [f"no {name} is named: {WITHOUT_NAMES[name]}" for name in unknown]
    if unknown and (unused := unused_columns(frame, layout)):
        notes.append(f"not used: {named(unused)}")
    votes, words = _votes_from_texts(text, layout)
    return votes, [*notes, words] if words else notes


def _votes_from_texts(text: Mapping[str, NDArray[np.object_]], layout: Layout) -> tuple[VotesTable, str]:
    """Return the votes of our columns, each object (N,), and what the words of the choices mean, as `choice_codes`."""
    participant, participants = _names(text["participant"], "participant", may_be_unknown=True)
    dataset, datasets = _names(text["dataset"], "dataset", may_be_unknown=True)
    both, items = _names(np.concatenate([text["item_a"], text["item_b"]]), "item", may_be_unknown=False)
    item_a, item_b = both.reshape(2, -1)
    role = _role(text["role"])
    refuse(
        (item_a == item_b) & (role != IDENTICAL), lambda row: f"the item {items[item_a[row]]!r} is compared with itself"
    )
    choice, words = choice_codes(text["choice"], (text["item_a"], text["item_b"]), layout)
    votes = VotesTable(
        participants,
        datasets,
        items,
        participant=participant,
        dataset=dataset,
        item_a=item_a,
        item_b=item_b,
        choice=choice,
        first_shown=_first_shown(text["first_shown"], text["item_a"], text["item_b"]),
        both_seen=np.where(text["both_seen"] == "", -1, flags(text["both_seen"], "both_seen")).astype(np.int8),
        count=numbers(text["count"], "count", whole=True).astype(np.int64),
        response_ms=numbers(text["response_ms"], "response_ms"),
        press_to_picture_ms=numbers(text["press_to_picture_ms"], "press_to_picture_ms"),
        practice=flags(text["practice"], "practice"),
        excluded=flags(text["excluded"], "excluded"),
        reason=text["reason"],
        role=role,
    )
    return votes, words


def _names(
    values: NDArray[np.object_], what: str, *, may_be_unknown: bool
) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    codes, names = pd.factorize(values)
    if "" in names and not (may_be_unknown and len(names) == 1):
        n_rows = len(values) // 2 if what == "item" else len(values)
        row = int(np.flatnonzero(values == "")[0])
        column = what if what != "item" else ("item_a" if row < n_rows else "item_b")
        raise VotesError(f"row {row % n_rows + 1}: {column} is empty")
    return codes.astype(np.int32), tuple(str(name) for name in names)


def _first_shown(
    values: NDArray[np.object_], item_a: NDArray[np.object_], item_b: NDArray[np.object_]
) -> NDArray[np.int8]:
    first = np.select([values == "", values == item_a, values == item_b], [-1, 0, 1], default=-2)
    refuse(
        first == -2,
        lambda row: (
            f"first_shown is {shown(values[row])}, expected {shown(item_a[row])} or {shown(item_b[row])} or nothing"
        ),
    )
    return first.astype(np.int8)


def _role(values: NDArray[np.object_]) -> NDArray[np.int8]:
    roles = np.array([ROLE_CODES.get(value, -1) for value in values], np.int8)
    refuse(roles < 0, lambda row: f"role is {shown(values[row])}, expected {', '.join(ROLES)}")
    return roles

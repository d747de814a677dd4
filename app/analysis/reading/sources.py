"""Read a file and recognise what it is, and say how it was understood: what votes and ratings have in common.

Nothing is dropped in silence: sentences say which columns were used as what, which were not, and who and what is in
the table.
"""

from __future__ import annotations

import unicodedata
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import Table, named, number_or_nan
from app.analysis.reading.description import VOTES, Description, Told
from app.analysis.reading.files.tabular import read_table
from app.analysis.reading.phrases import counted, listed
from app.analysis.reading.programs import restated
from app.analysis.reading.recognise import recognise
from app.analysis.reading.votes_table import naming

WARNING = "Warning: "  # begins a sentence that is one
EXACT = 1e5  # numbers below are told apart by six digits
MOST_NAMED = 8  # participants, datasets and conditions that are listed


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

    def warned(self, more: Iterable[str] = ()) -> list[str]:
        """Return the warnings on the file, and more."""
        warnings = (*self.table.warnings, *self.description.warnings, *more)
        return [f"{WARNING}{self.path.name}: {text}" for text in warnings]


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
    with naming(path):
        table = restated(table, told.format, "" if path.suffix.lower() == ".xlsx" else told.sheet)
        return Source(path, table, recognise(table, told))


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
    lists = [f"{counted(len(list_), what)}: {named(list_, MOST_NAMED)}" for list_, what in names if list_]
    first = f"{source.path.name}: {'; '.join(filter(None, (*parts, not_used)))}"
    return "\n- ".join([first, f"used: {used}", "; ".join(lists), rest])


def fingerprint(names: Sequence[object], columns: Sequence[NDArray[Any]]) -> str:
    """Return a checksum of names and columns (N,), as eight letters; a column of one value counts as that value."""
    check = zlib.crc32(repr(names).encode())
    for column in columns:
        is_one = column.strides == (0,)
        check = zlib.crc32(np.ascontiguousarray(column[:1] if is_one else column).data, check)
    return f"{check:08x}"


def look_alikes(names: Mapping[str, Sequence[str]]) -> list[str]:
    """Name participants, datasets and items that differ in nothing but capitals, accents, spaces, signs or noughts."""
    sentences = []
    for what, different in names.items():
        alike: dict[str, list[str]] = {}
        for name in different:
            letters = "".join(filter(str.isalnum, unicodedata.normalize("NFKD", name))).casefold()
            number = number_or_nan(name)
            alike.setdefault(f"{number:g}" if abs(number) < EXACT else letters or name, []).append(name)
        for several in alike.values():
            if len(several) > 1:
                quoted = " and ".join(map(repr, several))
                sentences.append(f"{quoted} look alike and are counted as {len(several)} {what}")
    return sentences


def in_several(participants: Iterable[Sequence[str]]) -> list[str]:
    """Say if files share participants, who are then taken for the same people; the names in each file are given."""
    names = [name for file in participants for name in file if name]
    twice = [name for name, n in Counter(names).items() if n > 1]
    if not twice:
        return []
    return [f"{listed(twice)} {'is' if len(twice) == 1 else 'are'} in several files and counted as the same people"]

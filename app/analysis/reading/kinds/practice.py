"""Find the rows of a table that are practice, by a column that numbers trials or names their phase."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import Column, Table, is_numeric, named, number_or_nan
from app.analysis.reading.phrases import counted
from app.analysis.reading.words import plain

TRIAL_NUMBER = re.compile(r"trial(s|no|nr|num|number|index|id|n)?$|timestamp$|thisn$")  # of plain names
NUMBERS_TRIALS = re.compile(r"trial(s|no|nr|num|number|index|n)?$|thisn$")  # not only tells them apart
NAMES_TRIALS = re.compile(r"trial|session|phase|block|part$|run$|loop|round|stage", re.IGNORECASE)
PRACTICE = re.compile(r"(practi[cs]e|training|warm[\s_-]?up)([\s_-]*(trial|round|block)s?)?[\s_-]*\d*", re.IGNORECASE)
FEWEST_ZEROS = 2  # for each first trial: a number of all practice, not that of a first trial counted from 0


@dataclass(frozen=True)
class Practice:
    """Rows of practice, bool (N,), the columns that say so, and sentences on them."""

    rows: NDArray[np.bool_]
    columns: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def practice_in(table: Table, taken: Collection[str]) -> Practice:
    """Find rows whose trial is called practice or has a number below 0, unless all are so.

    Parameters
    ----------
    table : as it is recognised
    taken : names of columns that say something else
    """
    is_practice, columns, notes, warnings = np.zeros(len(table), bool), [], [], []
    for name, column in table.columns.items():
        if name in taken or not NAMES_TRIALS.search(name):
            continue
        is_counted = bool(NUMBERS_TRIALS.search(plain(name)))
        rows = column.meaning(partial(_is_practice, numbers=is_counted), bool)
        if rows.any() and not (is_practice | rows).all():
            is_practice |= rows
            columns.append(name)
            words = named([*map(repr, column.where(rows).filled)])
            left = f"{counted(int(rows.sum()), 'row')} {'is' if rows.sum() == 1 else 'are'} left out as practice"
            notes.append(f"{left} (the column {name!r} is {words}); --columns trial=- counts them")
        if is_counted and (zeros := _doubtful_zeros(column)):
            where = f"the column {name!r} is 0 in {counted(zeros, 'row')}"
            warnings.append(f"{where}, which count: leave them out if they are practice")
    return Practice(is_practice, tuple(columns), tuple(notes), tuple(warnings))


def _is_practice(word: str, *, numbers: bool) -> bool:
    return bool(PRACTICE.fullmatch(word)) or (numbers and number_or_nan(word) < 0)


def _doubtful_zeros(column: Column) -> int:
    """Count the trials of the number 0, where it follows negative ones or there are more than of the number 1."""
    if not is_numeric(column):
        return 0
    numbers = column.meaning(number_or_nan, np.float64)
    zeros, ones = (int((numbers == number).sum()) for number in (0, 1))
    return zeros if zeros and ((numbers < 0).any() or 0 < FEWEST_ZEROS * ones <= zeros) else 0

"""Read the long table of measures: a row for each value, as `reconstudy validate` writes it or anybody else does."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

from app.analysis.reading.cells import named, number
from app.analysis.reading.files.tabular import read_csv
from app.analysis.reading.phrases import counted
from app.analysis.reading.votes_table import VotesError, naming

Better = Literal["higher", "lower"]

REQUIRED = ("dataset", "approach", "measure", "value", "better")
OPTIONAL = ("frame", "direction", "unit", "source")
WHOLE = ("", "all")  # the frame of a value of the whole sequence
SYMMETRIC = ("", "symmetric")  # directions that add nothing to a measure's name
DIRECTIONS = (*SYMMETRIC, "reference_to_distorted", "distorted_to_reference")
WORDS = {"lower": "less is better", "higher": "more is better"}  # the direction in a study's validation.csv
LARGEST_TABLE = 32 * 1024 * 1024  # bytes; 300 000 rows, more than all measures of a large study frame by frame
LONGEST = {**dict.fromkeys(("dataset", "approach", "measure"), 200), "unit": 40, "source": 500}  # characters, as stored
MOST_NAMED = 5  # of the places that a note is about


@dataclass(frozen=True)
class MeasuredValue:
    """The value of a measure for an approach on a dataset, over the whole sequence.

    Parameters
    ----------
    dataset, approach : in a study's words; the dataset "all" stands for every dataset
    measure : its name, with the direction of the comparison where that is not symmetric
    value : finite
    better : whether a higher or a lower value is better
    unit, source : "" where the table does not tell
    """

    dataset: str
    approach: str
    measure: str
    value: float
    better: Better
    unit: str = ""
    source: str = ""


@dataclass(frozen=True)
class MeasuresTable:
    """The values of a table of measures.

    Parameters
    ----------
    values : in the order of the table, each dataset, approach and measure once
    notes : sentences that tell what was averaged and what was left out
    """

    values: tuple[MeasuredValue, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Row:
    """A checked row.

    Parameters
    ----------
    number : counted from 1 below the header
    frame : None for the whole sequence
    """

    number: int
    frame: int | None
    value: MeasuredValue

    @property
    def place(self) -> tuple[str, str, str]:
        return self.value.dataset, self.value.approach, self.value.measure

    @property
    def where(self) -> str:
        return f"{self.value.dataset}/{self.value.approach}"


def is_long(columns: Sequence[str]) -> bool:
    """Tell the long table, with a row for each value, from the wide one, with a column for each measure."""
    return {"measure", "value"} <= set(columns)


def read_measures_table(path: Path) -> MeasuresTable:
    """Read the long table of measures from a CSV file.

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one: the file is too large or no UTF-8 table separated by commas, or
        its content is refused by `measures_from_columns`.
    """
    if path.is_file() and (size := path.stat().st_size) > LARGEST_TABLE:
        raise VotesError(
            f"{path}: has {size / 2**20:.0f} MB, expected {LARGEST_TABLE // 2**20} MB at most; keep the rows of the "
            "whole sequence (no frame), or divide the table"
        )
    table = read_csv(path)
    with naming(path):
        columns = {name: column.texts.tolist() for name, column in table.columns.items()}
        return measures_from_columns(columns, table.numbers.tolist())


def measures_from_columns(columns: Mapping[str, Sequence[str]], numbers: Sequence[int] | None = None) -> MeasuresTable:
    """Return one value for each dataset, approach and measure.

    Rows without a frame are the value. Where a measure has values of frames alone, it is their mean. Values that are
    not finite, such as the PSNR of two equal things, are left out; the notes name them.

    Parameters
    ----------
    columns : texts by column: `dataset, approach, measure, value, better`, and `frame, direction, unit, source` where
        there are any; other columns are ignored
    numbers : of the rows, counted from 1 below the header; all in order by default

    Raises
    ------
    VotesError
        Naming the row: a column is missing, a cell cannot be read, a value stands in the table twice, or rows of a
        measure contradict each other in what is better or in the unit.
    """
    _check_columns(list(columns))
    numbers = numbers or range(1, len(columns["dataset"]) + 1)
    texts = {name: [cell.strip() for cell in columns.get(name, [""] * len(numbers))] for name in (*REQUIRED, *OPTIONAL)}
    cells = zip(*texts.values(), strict=True)
    rows = [_row(number, dict(zip(texts, row, strict=True))) for number, row in zip(numbers, cells, strict=True)]
    return _whole_sequences(_by_place(rows))


def _check_columns(columns: Sequence[str]) -> None:
    if missing := [name for name in REQUIRED if name not in columns]:
        more = "; better is higher or lower, for each measure" if missing == ["better"] else ""
        raise VotesError(
            f"has the columns {named(columns)}, without {', '.join(missing)}; expected {', '.join(REQUIRED)}, and "
            f"{', '.join(OPTIONAL)} where known{more}"
        )


def _row(number: int, cells: Mapping[str, str]) -> _Row:
    for name, longest in LONGEST.items():
        if len(cells[name]) > longest:
            raise VotesError(f"row {number}: {name} has {len(cells[name])} characters, expected {longest} at most")
        if not cells[name] and name in REQUIRED:
            raise VotesError(f"row {number}: {name} is empty")
    if cells["better"] not in get_args(Better):
        raise VotesError(f"row {number}: better is {cells['better']!r}, expected higher or lower")
    if cells["direction"] not in (*DIRECTIONS, WORDS[cells["better"]]):
        raise VotesError(
            f"row {number}: direction is {cells['direction']!r}, expected {', '.join(DIRECTIONS[1:])} or nothing"
        )
    value = MeasuredValue(
        measure=_full_name(cells["measure"], cells["direction"]),
        value=_number(number, cells["value"]),
        better=cast(Better, cells["better"]),
        **{name: cells[name] for name in ("dataset", "approach", "unit", "source")},
    )
    return _Row(number, _frame(number, cells["frame"]), value)


def _full_name(measure: str, direction: str) -> str:
    """Return the measure's name with what is compared with what, unless both ways are."""
    return f"{measure} ({direction.replace('_', ' ')})" if direction in DIRECTIONS[len(SYMMETRIC) :] else measure


def _number(row: int, text: str) -> float:
    """Return the value of a cell, NaN where it is empty."""
    try:
        return number(text or "nan")
    except ValueError as error:
        raise VotesError(f"row {row}: value is {text!r}, expected a number") from error


def _frame(row: int, text: str) -> int | None:
    if text in WHOLE:
        return None
    if not (text.isascii() and text.isdigit()):
        raise VotesError(
            f"row {row}: frame is {text!r}, expected a whole number, or nothing for the value of the whole sequence"
        )
    return int(text)


def _by_place(rows: Sequence[_Row]) -> list[dict[int | None, _Row]]:
    """Return the rows of each dataset, approach and measure, by frame, in the order of the first.

    Raises
    ------
    VotesError
        If a frame of a place has two values, or a measure two units or directions.
    """
    places: dict[tuple[str, str, str], dict[int | None, _Row]] = {}
    measures: dict[str, _Row] = {}
    for row in rows:
        first = places.setdefault(row.place, {}).setdefault(row.frame, row)
        if first is not row:
            frame = "" if row.frame is None else f" in frame {row.frame}"
            raise VotesError(
                f"row {row.number}: {row.value.measure} of {row.where}{frame} is {row.value.value:g}, row "
                f"{first.number} has it already with {first.value.value:g}; keep one of them, or give them different "
                "names"
            )
        earlier = measures.setdefault(row.value.measure, row)
        for name in ("better", "unit"):
            value, value_before = getattr(row.value, name), getattr(earlier.value, name)
            if value != value_before:
                raise VotesError(
                    f"row {row.number}: {name} of {row.value.measure} is {value!r}, row {earlier.number} says "
                    f"{value_before!r}; expected the same for all values of a measure"
                )
    return [*places.values()]


def _whole_sequences(places: Sequence[Mapping[int | None, _Row]]) -> MeasuresTable:
    values: list[MeasuredValue] = []
    left_out: list[_Row] = []
    averaged: dict[str, list[int]] = {}  # measure -> numbers of frames
    for place in places:
        rows = [place[None]] if None in place else [*place.values()]
        used = [row for row in rows if math.isfinite(row.value.value)]
        left_out += [row for row in rows if row not in used]
        if used and None not in place:
            averaged.setdefault(used[0].value.measure, []).append(len(used))
        if used:
            values.append(_mean(used))
    return MeasuresTable(tuple(values), (*_averages(averaged), *_absences(left_out)))


def _mean(rows: Sequence[_Row]) -> MeasuredValue:
    mean = math.fsum(row.value.value for row in rows) / len(rows)
    sources = "; ".join(dict.fromkeys(row.value.source for row in rows if row.value.source))
    return replace(rows[0].value, value=mean, source=sources[: LONGEST["source"]])


def _averages(averaged: Mapping[str, Sequence[int]]) -> Iterator[str]:
    for measure, counts in averaged.items():
        fewest, most = min(counts), max(counts)
        frames = f"{fewest} to {most} frames; not all approaches have equally many"
        yield f"{measure} is the mean of {frames if fewest < most else counted(most, 'frame')}"


def _absences(rows: Sequence[_Row]) -> Iterator[str]:
    """Yield a sentence for each measure with values that are not finite."""
    by_measure: dict[str, list[str]] = {}
    for row in rows:
        frame = "" if row.frame is None else f" frame {row.frame}"
        value = "not a number" if math.isnan(row.value.value) else f"{row.value.value:+g}"
        by_measure.setdefault(row.value.measure, []).append(f"{row.where}{frame} ({value})")
    for measure, places in by_measure.items():
        more = f" and {len(places) - MOST_NAMED} more" if len(places) > MOST_NAMED else ""
        yield f"{measure} leaves out what has no finite value: {', '.join(places[:MOST_NAMED])}{more}"

"""Read tables of text from CSV, Parquet and JSON, and check columns row by row."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.votes_table import VotesError

LONGEST_LINE = 80  # letters of a file that a message repeats


def read_frame(path: Path) -> pd.DataFrame:
    """Read a table; the ending of the file's name, .csv, .parquet or .json, tells the format.

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one.
    """
    try:
        reader = READERS[path.suffix.lower()]
    except KeyError as error:
        raise VotesError(f"{path}: ends in {path.suffix!r}, expected one of {', '.join(READERS)}") from error
    return _read(path, reader)


def read_csv(path: Path) -> pd.DataFrame:
    """Read a CSV table whatever the file's name; spaces around cells are stripped.

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one.
    """
    return _read(path, _read_csv)


def _read(path: Path, reader: Callable[[Path], pd.DataFrame]) -> pd.DataFrame:
    try:
        return reader(path)
    except FileNotFoundError as error:
        raise VotesError(f"{path}: there is no such file") from error
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error


def numbers(
    values: NDArray[np.object_], name: str, *, whole: bool = False, may_be_negative: bool = False
) -> NDArray[np.float64]:
    """Return a column's texts as numbers, NaN where empty.

    Parameters
    ----------
    values : object (N,), texts
    name : of the column, for the error
    whole : expect whole numbers, and refuse empty cells
    may_be_negative : accept numbers below 0

    Returns
    -------
    float64 (N,)

    Raises
    ------
    VotesError
        Naming the row and the value.
    """
    expected = "a whole number, 0 or more" if whole else "a number, 0 or more, or nothing"
    if may_be_negative:
        expected = "a number or nothing"

    def number(value: str) -> float:
        try:
            return float(value)
        except ValueError:
            return math.nan

    parsed = np.array([number(value) for value in values], np.float64)
    is_bad = ~np.isfinite(parsed) | ((parsed < 0) & (not may_be_negative)) | (whole & (parsed != np.floor(parsed)))
    refuse(is_bad & (whole | (values != "")), lambda row: f"{name} is {values[row]!r}, expected {expected}")
    return parsed


def refuse(is_bad: NDArray[np.bool_], why: Callable[[int], str]) -> None:
    """Raise for the first bad row, with the reason and the number of further ones.

    Parameters
    ----------
    is_bad : bool (N,)
    why : the reason for a row, counted from 0

    Raises
    ------
    VotesError
        If any row is bad.
    """
    rows = np.flatnonzero(is_bad)
    if len(rows):
        more = f" (and {len(rows) - 1} more rows like it)" if len(rows) > 1 else ""
        raise VotesError(f"row {rows[0] + 1}: {why(int(rows[0]))}{more}")


def _read_csv(path: Path) -> pd.DataFrame:
    text = _decode(path.read_bytes())
    if not text.strip():
        raise VotesError("is empty, expected a header and at least one row")
    if "\0" in text:
        row = text[: text.index("\0")].count("\n")
        raise VotesError(f"row {row} holds a NUL character, so it is no text; save the file as CSV in UTF-8")
    header = [name.strip() for name in next(csv.reader(io.StringIO(text.lstrip())))]
    if twice := [name for name in dict.fromkeys(header) if header.count(name) > 1]:
        raise VotesError(f"has {header.count(twice[0])} columns named {twice[0]!r}, expected one")
    try:
        frame = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False, skipinitialspace=True)
    except pd.errors.ParserError as error:
        raise VotesError(f"is not a table of equally long rows: {str(error).strip()}") from error
    if not isinstance(frame.index, pd.RangeIndex):  # pandas takes surplus cells at the left for names of the rows
        raise VotesError(f"is not a table of equally long rows: row 1 has more cells than the header's {len(header)}")
    frame.columns = [str(column).strip() for column in frame.columns]
    return pd.DataFrame({name: frame[name].str.strip() for name in frame.columns})


def _decode(content: bytes) -> str:
    """Decode UTF-8, or UTF-16 if the file begins with its mark; else refuse, naming the first row that fails."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        start = content.rfind(b"\n", 0, error.start) + 1
        line = content[start:].split(b"\n", 1)[0].decode("latin-1").strip()[:LONGEST_LINE]
        row = content[: error.start].count(b"\n")
        raise VotesError(f"row {row}: {line!r} is not UTF-8 (it may be Latin-1); save the file as UTF-8") from error


def _read_parquet(path: Path) -> pd.DataFrame:
    try:
        return pd.read_parquet(path)
    except (ValueError, OSError) as error:
        if isinstance(error, FileNotFoundError):
            raise
        raise VotesError(f"is not readable as Parquet: {error}") from error


def _read_json(path: Path) -> pd.DataFrame:
    try:
        content = json.loads(_decode(path.read_bytes()))
    except json.JSONDecodeError as error:
        raise VotesError(f"is not readable as JSON: {error}") from error
    rows = content.get("votes") if isinstance(content, dict) else content
    if not isinstance(rows, list):
        raise VotesError("holds no list of votes, expected [{…}, …] or {'votes': [{…}, …]}")
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, dict):
            raise VotesError(f"row {number}: {row!r} is not an object with named values")
    return pd.DataFrame(rows, dtype=object)


READERS: dict[str, Callable[[Path], pd.DataFrame]] = {".csv": _read_csv, ".parquet": _read_parquet, ".json": _read_json}

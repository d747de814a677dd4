"""Read tables from text, JSON, Parquet and Excel, and check columns row by row."""

from __future__ import annotations

import csv
import gzip
import io
import json
import math
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.votes_table import VotesError
from app.files import FORMULA

NO_TEXT = frozenset(range(32)) - frozenset(b"\t\n\r\f")  # bytes of no text in any encoding of letters
LONGEST_VALUE = 80  # letters of a file that a message repeats
MOST_NAMED = 40  # columns that it names
MOST_CELLS = 50_000_000  # of a packed table, which may hold far more than it has bytes; a million votes have 30 million
MOST_COLUMNS = 20_000  # of a text; a column for each pair of 200 items
MOST_UNPACKED = 512 * 1024 * 1024  # bytes, of an Excel or gzip file
SAMPLE = 4096  # bytes that tell text from anything else
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
DECIMAL_COMMA = re.compile(r"[+-]?(?!\d{1,3}(,\d{3})+$)\d+,\d+|[+-]?0,\d+")  # 1,5 and 0,125; 1,234 may be thousands
# An apostrophe that keeps a spreadsheet from taking text for a formula.
DISARMED = f"^'(?=[{re.escape(''.join(FORMULA))}])"
LARGEST_COUNT = 1e12  # of a row; sums of millions of such rows are whole numbers still
FLAGS = {"": 0, "0": 0, "false": 0, "no": 0, "1": 1, "true": 1, "yes": 1}  # in lower case
SIGNATURES = {
    b"PK\x03\x04": "a zip or Excel file",
    b"PAR1": "a Parquet file",
    b"\x1f\x8b": "a gzip file",
    b"\x89PNG": "a picture",
    b"%PDF": "a PDF",
    b"\xd0\xcf\x11\xe0": "an old Excel file",
}


def read_frame(path: Path) -> pd.DataFrame:
    """Read a table; the ending of the file's name tells the format, and its content the separator and encoding.

    `attrs["understood"]` of the table says in words how the file was read.

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one.
    """
    name = path.name.lower()
    reader = next((reader for ending, reader in READERS.items() if name.endswith(ending)), None)
    if path.is_dir():
        raise VotesError(f"{path}: is a folder, expected a file: {', '.join(READERS)}")
    if reader is None:
        raise VotesError(f"{path}: ends in {path.suffix!r}, expected one of {', '.join(READERS)}")
    return _read(path, reader)


def read_csv(path: Path) -> pd.DataFrame:
    """Read a table of text with commas, semicolons or tabs between cells, whatever the file's name; spaces around
    cells are stripped.

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one.
    """
    return _read(path, _read_text)


def _read(path: Path, reader: Callable[[Path], pd.DataFrame]) -> pd.DataFrame:
    try:
        return reader(path)
    except FileNotFoundError as error:
        raise VotesError(f"{path}: there is no such file") from error
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error


def texts(cells: Iterable[Any]) -> NDArray[np.object_]:
    """Return cells as stripped texts, object (N,): empty where missing, whole numbers without decimals."""
    return np.array([_text(cell) for cell in cells], object)


def _text(cell: Any) -> str:
    if isinstance(cell, str):
        return cell.strip()
    if pd.api.types.is_scalar(cell) and pd.isna(cell):
        return ""
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell).strip()


def flags(values: NDArray[np.object_], name: str) -> NDArray[np.bool_]:
    """Return a column's texts as true or false, bool (N,); an empty cell is false.

    Parameters
    ----------
    values : object (N,), texts
    name : of the column, for the error

    Raises
    ------
    VotesError
        Naming the row and the value.
    """
    codes, words = pd.factorize(values)
    known = np.array([FLAGS.get(str(word).lower(), -1) for word in words], np.int8)[codes]
    refuse(known < 0, lambda row: f"{name} is {shown(values[row])}, expected true or false")
    return known.astype(bool)


def numbers(
    values: NDArray[np.object_], name: str, *, whole: bool = False, may_be_negative: bool = False
) -> NDArray[np.float64]:
    """Return a column's texts as numbers, NaN where empty.

    Parameters
    ----------
    values : object (N,), texts
    name : of the column, for the error
    whole : expect whole numbers up to `LARGEST_COUNT`, and refuse empty cells
    may_be_negative : accept numbers below 0

    Returns
    -------
    float64 (N,)

    Raises
    ------
    VotesError
        Naming the row and the value.
    """
    expected = f"a whole number, 0 to {LARGEST_COUNT:.0f}" if whole else "a number, 0 or more, or nothing"
    if may_be_negative:
        expected = "a number or nothing"

    def number_or_nan(value: str) -> float:
        try:
            return number(value)
        except ValueError:
            return math.nan

    parsed = np.array([number_or_nan(value) if value else math.nan for value in values], np.float64)
    is_bad = ~np.isfinite(parsed) | ((parsed < 0) & (not may_be_negative))
    is_bad |= whole & ((parsed != np.floor(parsed)) | (parsed > LARGEST_COUNT))
    refuse(is_bad & (whole | (values != "")), lambda row: f"{name} is {shown(values[row])}, expected {expected}")
    return parsed


def number(text: str) -> float:
    """Return a text as a number, with a decimal point or comma; raises ValueError for any other text."""
    return float(text.replace(",", ".") if DECIMAL_COMMA.fullmatch(text) else text)


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
    rows = np.flatnonzero(is_bad)
    if len(rows):
        more = f" (and {len(rows) - 1} more rows like it)" if len(rows) > 1 else ""
        reason = why if isinstance(why, str) else why(int(rows[0]))
        raise VotesError(f"row {rows[0] + 1}: {reason}{more}")


def shown(value: object) -> str:
    """Return a value for a message: quoted, short, and without letters that a terminal cannot print."""
    return repr(printable(value))


def printable(value: object) -> str:
    """Return a value for a message: short, and without letters that a terminal cannot print."""
    text = "".join(letter if letter.isprintable() else "�" for letter in str(value))
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}…"


def named(names: Sequence[str]) -> str:
    """Return the names of columns for a message: some of them, where there are very many."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(map(printable, names[:MOST_NAMED])) + more


def _read_text(path: Path) -> pd.DataFrame:
    return _table_of_text(path.read_bytes())


def _read_gzip(path: Path) -> pd.DataFrame:
    try:
        with gzip.open(path) as file:
            content = file.read(MOST_UNPACKED + 1)
        _check_unpacked(len(content))
        return _table_of_text(content)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise VotesError(f"is not readable as gzip: {error}") from error


def _table_of_text(content: bytes) -> pd.DataFrame:
    text, encoding = _decode(content)
    if not text.strip():
        raise VotesError("is empty, expected a header and at least one row")
    if "\0" in text:
        row = text[: text.index("\0")].count("\n")
        raise VotesError(f"row {row} holds a NUL character, so it is no text; save the file as CSV in UTF-8")
    separator = _separator(text.lstrip().splitlines()[0])
    header = [name.strip() for name in _cells(io.StringIO(text.lstrip()), separator)]
    if not header:
        raise VotesError(f"is no table: its header holds a name of more than {csv.field_size_limit()} letters")
    if len(header) > MOST_COLUMNS:
        raise VotesError(f"has {len(header)} columns, expected {MOST_COLUMNS} at most")
    if twice := [(name, n) for name, n in Counter(header).items() if n > 1]:
        raise VotesError(f"has {twice[0][1]} columns named {shown(twice[0][0])}, expected one")
    try:
        frame = pd.read_csv(
            io.StringIO(text), sep=separator, dtype=str, keep_default_na=False, skipinitialspace=separator != "\t"
        )
    except pd.errors.ParserError as error:
        raise VotesError(f"is not a table of equally long rows: {str(error).strip()}") from error
    if not isinstance(frame.index, pd.RangeIndex):  # pandas takes surplus cells at the left for names of the rows
        raise VotesError(f"is not a table of equally long rows: row 1 has more cells than the header's {len(header)}")
    frame.columns = [str(column).strip() for column in frame.columns]
    cells = {name: frame[name].str.strip().str.replace(DISARMED, "", regex=True) for name in frame.columns}
    return _understood(pd.DataFrame(cells), f"text in {encoding}, {SEPARATORS[separator]} between cells")


def _separator(header: str) -> str:
    """Return what separates most cells of the header; a comma where nothing does."""
    counts = {mark: len(_cells([header], mark)) for mark in SEPARATORS}
    return max(counts, key=lambda mark: counts[mark])


def _cells(lines: Iterable[str], separator: str) -> list[str]:
    """Return the cells of the first line; none where one is longer than any name."""
    try:
        return next(csv.reader(lines, delimiter=separator))
    except csv.Error:
        return []


def _understood(frame: pd.DataFrame, what: str) -> pd.DataFrame:
    frame.attrs["understood"] = what
    return frame


def _decode(content: bytes) -> tuple[str, str]:
    """Decode UTF-8, or UTF-16 if the file begins with its mark, and name the encoding; else refuse, naming the first
    row that fails.
    """
    for signature, kind in SIGNATURES.items():
        if content.startswith(signature):
            raise VotesError(f"is {kind}, expected a table of text; give the file the ending of what it is")
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return content.decode("utf-16"), "UTF-16"
        except UnicodeDecodeError as error:
            raise VotesError(f"begins as UTF-16, and cannot be read as such: {error.reason}") from error
    try:
        return content.decode("utf-8-sig"), "UTF-8 with a byte-order mark" if content[:1] == b"\xef" else "UTF-8"
    except UnicodeDecodeError as error:
        if any(byte in NO_TEXT for byte in content[:SAMPLE]):
            raise VotesError(
                f"is no text (byte {error.start + 1} is 0x{content[error.start]:02x}); expected a table: CSV in UTF-8, "
                "or a Parquet file whose name ends in .parquet"
            ) from error
        start = content.rfind(b"\n", 0, error.start) + 1
        line = content[start:].split(b"\n", 1)[0].decode("latin-1").strip()
        row = content[: error.start].count(b"\n")
        raise VotesError(
            f"row {row}: {shown(line)} is not UTF-8 (it may be Latin-1); save the file as UTF-8"
        ) from error


def _read_parquet(path: Path) -> pd.DataFrame:
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(path) as file:
            _check_cells(file.metadata.num_rows * file.metadata.num_columns)
            texts = [column.name for column in file.schema if column.physical_type == "BYTE_ARRAY"]
        frame = pd.read_parquet(path, read_dictionary=texts)  # so that a text that stands in many rows is kept once
        packed = frame.select_dtypes("category").columns
        return _understood(frame.astype(dict.fromkeys(packed, object)), "Parquet")
    except (FileNotFoundError, VotesError):
        raise
    except (ValueError, OSError) as error:
        raise VotesError(f"is not readable as Parquet: {error}") from error


def _read_json(path: Path) -> pd.DataFrame:
    try:
        content = json.loads(_decode(path.read_bytes())[0])
    except json.JSONDecodeError as error:
        raise VotesError(f"is not readable as JSON: {error}") from error
    rows = content.get("votes") if isinstance(content, dict) else content
    if not isinstance(rows, list):
        raise VotesError("holds no list of votes, expected [{…}, …] or {'votes': [{…}, …]}")
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, dict):
            raise VotesError(f"row {number}: {shown(row)} is not an object with named values")
    return _understood(pd.DataFrame(rows, dtype=object), "JSON")


def _read_lines(path: Path) -> pd.DataFrame:
    rows = []
    for number, line in enumerate(_decode(path.read_bytes())[0].split("\n"), start=1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
        except json.JSONDecodeError as error:
            raise VotesError(f"line {number} is not readable as JSON: {error}") from error
        if not isinstance(row, dict):
            raise VotesError(f"line {number}: {shown(line)} is not an object with named values")
        rows.append(row)
    return _understood(pd.DataFrame(rows, dtype=object), "JSON, an object on each line")


def _read_excel(path: Path) -> pd.DataFrame:
    try:
        with zipfile.ZipFile(path) as archive:
            _check_unpacked(sum(entry.file_size for entry in archive.infolist()))
        with pd.ExcelFile(path, engine="openpyxl") as book:
            _check_cells(_cells_up_to(book.book.worksheets[0].iter_rows(values_only=True)))
            sheets = [str(name) for name in book.sheet_names]
            frame = pd.read_excel(book, sheet_name=0, dtype=object, keep_default_na=False, na_values=[""])
    except (FileNotFoundError, VotesError):
        raise
    except Exception as error:  # openpyxl raises whatever its parts raise
        raise VotesError(f"is not readable as Excel: {shown(error)}") from error
    frame.columns = [str(name).strip() for name in frame.columns]
    rest = f", the first of {len(sheets)}" if len(sheets) > 1 else ""
    frame = frame.map(lambda cell: cell.strip() if isinstance(cell, str) else cell).dropna(how="all")
    return _understood(frame.reset_index(drop=True), f"Excel, sheet {sheets[0]}{rest}")


def _cells_up_to(rows: Iterable[Sequence[object]]) -> int:
    """Count cells, no further than needed to know that they are too many."""
    n_cells = 0
    for row in rows:
        n_cells += len(row)
        if n_cells > MOST_CELLS:
            break
    return n_cells


def _check_cells(n_cells: int) -> None:
    if n_cells > MOST_CELLS:
        raise VotesError(f"holds more than {MOST_CELLS // 10**6} million cells, far more than votes; divide it")


def _check_unpacked(n_bytes: int) -> None:
    if n_bytes > MOST_UNPACKED:
        raise VotesError(f"unpacks to more than {MOST_UNPACKED // 2**20} MB, far more than votes; divide it")


# By the end of a file's name, the longer endings first.
READERS: dict[str, Callable[[Path], pd.DataFrame]] = {
    **dict.fromkeys((".csv.gz", ".tsv.gz"), _read_gzip),
    **dict.fromkeys((".csv", ".tsv"), _read_text),
    **dict.fromkeys((".jsonl", ".ndjson"), _read_lines),
    ".json": _read_json,
    ".parquet": _read_parquet,
    ".xlsx": _read_excel,
}

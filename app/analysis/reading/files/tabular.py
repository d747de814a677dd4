"""Read tables from text, JSON, Parquet and Excel: the ending of a file's name tells which."""

from __future__ import annotations

import gzip
import json
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any

import pandas as pd

from app.analysis.reading.cells import Table, printable, shown, table_of_frame, table_of_rows
from app.analysis.reading.description import Told
from app.analysis.reading.files.nested import rows_of_json, rows_of_python
from app.analysis.reading.files.text import decode, quick_table, table_of_text
from app.analysis.reading.votes_table import VotesError, naming

LONGEST_REASON = 400  # letters of what a reader of others says
MOST_CELLS = 50_000_000  # of a packed table, which may hold far more than it has bytes; a million votes have 30 million
MOST_UNPACKED = 512 * 1024 * 1024  # bytes, of an Excel or gzip file


def read_table(path: Path, told: Told = Told()) -> Table:  # frozen
    """Read a table; the ending of the file's name tells the format, and its content the separator and encoding.

    Parameters
    ----------
    path : the file
    told : the encoding of text, by default UTF-8, or UTF-16 with its mark; the sheet of a workbook, by default the
        first; and the layout, as that of choix has no header

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one.
    """
    if (table := quick_table(path, told)) is not None:
        return table
    with naming(path):
        if path.is_dir():
            raise VotesError(f"is a folder, expected a file: {', '.join(READERS)}")
        name = path.name.lower()
        reader = next((reader for ending, reader in READERS.items() if name.endswith(ending)), None)
        if reader is None:
            raise VotesError(f"ends in {path.suffix!r}, expected one of {', '.join(READERS)}")
        return reader(path, told)


def read_csv(path: Path) -> Table:
    """Read a table of text with commas, semicolons or tabs between cells, whatever the file's name; spaces around
    cells are stripped.

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one.
    """
    with naming(path):
        return _read_text(path, Told())


Reader = Callable[[Path, Told], Table]


def _read_text(path: Path, told: Told) -> Table:
    return table_of_text(path.read_bytes(), told)


@contextmanager
def _readable(kind: str, *errors: type[Exception], what: str = "") -> Iterator[None]:
    """Say of what a reader raises that the file is not readable as one of its kind."""
    try:
        yield
    except (FileNotFoundError, VotesError):
        raise
    except errors as error:
        raise VotesError(f"{what}is not readable as {kind}: {printable(error, LONGEST_REASON)}") from error


def _read_gzip(path: Path, told: Told) -> Table:
    with _readable("gzip", gzip.BadGzipFile, EOFError, zlib.error), gzip.open(path) as file:
        content = file.read(MOST_UNPACKED + 1)
    _check_unpacked(len(content))
    return table_of_text(content, told)


def _read_parquet(path: Path, _told: Told) -> Table:
    from pyarrow import parquet

    with _readable("Parquet", ValueError, OSError):
        with parquet.ParquetFile(path) as file:
            _check_cells(file.metadata.num_rows * file.metadata.num_columns)
            texts = [column.name for column in file.schema if column.physical_type == "BYTE_ARRAY"]
        frame = pd.read_parquet(path, read_dictionary=texts)  # so that a text that stands in many rows is kept once
        packed = frame.select_dtypes("category").columns
        return table_of_frame(frame.astype(dict.fromkeys(packed, object)), "Parquet")


def _read_json(path: Path, told: Told) -> Table:
    with _readable("JSON", json.JSONDecodeError):
        content = json.loads(decode(path.read_bytes(), told.encoding)[0])
    return _flat(rows_of_json(content), "JSON")


def _flat(nested: tuple[list[dict[str, Any]], tuple[str, ...]], how: str) -> Table:
    """Return the table of rows, with what was left out or restated."""
    rows, notes = nested
    return replace(table_of_rows(rows, how), notes=notes)


def _read_python(path: Path, told: Told) -> Table:
    """Read a dataset file of sureal, whose literals are taken and which is never run."""
    text, _ = decode(path.read_bytes(), told.encoding)
    return _flat(rows_of_python(text), "Python, read as literals and not run")


def _read_lines(path: Path, told: Told) -> Table:
    rows = []
    for number, line in enumerate(decode(path.read_bytes(), told.encoding)[0].split("\n"), start=1):
        if not line.strip():
            continue
        with _readable("JSON", json.JSONDecodeError, what=f"line {number} "):
            row = json.loads(line)
        if not isinstance(row, dict):
            raise VotesError(f"line {number}: {shown(line)} is not an object with named values")
        rows.append(row)
    return _flat(rows_of_json(rows), "JSON, an object on each line")


def _read_excel(path: Path, told: Told) -> Table:
    with _readable("Excel", Exception):  # openpyxl raises whatever its parts raise
        with zipfile.ZipFile(path) as archive:
            _check_unpacked(sum(entry.file_size for entry in archive.infolist()))
        with pd.ExcelFile(path, engine="openpyxl") as book:
            sheets = [str(name) for name in book.sheet_names]
            sheet = told.sheet or sheets[0]
            if sheet not in sheets:
                raise VotesError(f"has no sheet {shown(sheet)}; it has {', '.join(map(shown, sheets))}")
            for n_cells in accumulate(map(len, book.book[sheet].iter_rows(values_only=True))):
                _check_cells(n_cells)  # no further than needed to know that they are too many
            frame = pd.read_excel(book, sheet_name=sheet, dtype=object, keep_default_na=False, na_values=[""])
    frame.columns = [str(name).strip() for name in frame.columns]
    place = sheets.index(sheet)
    rest = f", {'the first' if not place else f'number {place + 1}'} of {len(sheets)}" if len(sheets) > 1 else ""
    others = ", ".join(shown(name) for name in sheets if name != sheet)
    notes = (f"the other sheets are {others} (to read one: --sheet NAME)",) if others else ()
    return replace(table_of_frame(frame, f"Excel, sheet {sheet}{rest}"), notes=notes).without_empty_rows()


def _check_cells(n_cells: int) -> None:
    if n_cells > MOST_CELLS:
        raise VotesError(f"holds more than {MOST_CELLS // 10**6} million cells, far more than votes; divide it")


def _check_unpacked(n_bytes: int) -> None:
    if n_bytes > MOST_UNPACKED:
        raise VotesError(f"unpacks to more than {MOST_UNPACKED // 2**20} MB, far more than votes; divide it")


# By the end of a file's name, the longer endings first.
READERS: dict[str, Reader] = {
    **dict.fromkeys((".csv.gz", ".tsv.gz"), _read_gzip),
    **dict.fromkeys((".csv", ".tsv"), _read_text),
    **dict.fromkeys((".jsonl", ".ndjson"), _read_lines),
    ".json": _read_json,
    ".parquet": _read_parquet,
    ".xlsx": _read_excel,
    ".py": _read_python,
}

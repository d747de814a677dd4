"""Read tables from text, JSON, Parquet and Excel, and check columns row by row."""

from __future__ import annotations

import csv
import gzip
import io
import json
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.cells import Column, Table, shown, table_of_frame
from app.analysis.reading.description import Told
from app.analysis.reading.nested import rows_of_json, rows_of_python
from app.analysis.reading.votes_table import VotesError
from app.files import FORMULA

NO_TEXT = frozenset(range(32)) - frozenset(b"\t\n\r\f")  # bytes of no text in any encoding of letters
MOST_CELLS = 50_000_000  # of a packed table, which may hold far more than it has bytes; a million votes have 30 million
MOST_COLUMNS = 20_000  # of a text; a column for each pair of 200 items
MOST_UNPACKED = 512 * 1024 * 1024  # bytes, of an Excel or gzip file
SAMPLE = 4096  # bytes that tell text from anything else
QUICK_FROM = 4_000_000  # bytes; below, reading text cell by cell takes no more than a second
BLOCK = 16_000_000  # bytes read at once
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
SEPARATOR_LINE = re.compile(r"\s*\"?sep=(.)\"?\s*", re.IGNORECASE)  # what a spreadsheet writes above the header
# An apostrophe that keeps a spreadsheet from taking text for a formula.
DISARMED = f"^'(?=[{re.escape(''.join(FORMULA))}])"
SIGNATURES = {
    b"PK\x03\x04": "a zip or Excel file",
    b"PAR1": "a Parquet file",
    b"\x1f\x8b": "a gzip file",
    b"\x89PNG": "a picture",
    b"%PDF": "a PDF",
    b"\xd0\xcf\x11\xe0": "an old Excel file",
}


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
    if (table := _quick_table(path, told)) is not None:
        return table
    frame = read_frame(path, told)
    try:
        table = table_of_frame(frame)
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error
    if frame.attrs.get("rows") is not None and len(table):
        table = replace(table, rows=np.asarray(frame.attrs["rows"], np.int64))
    return replace(table, notes=tuple(frame.attrs.get("notes", ())))


def read_frame(path: Path, told: Told = Told()) -> pd.DataFrame:  # frozen
    """Read a table as pandas has it.

    `attrs["understood"]` of the table says in words how the file was read, `attrs["rows"]` the rows of the file.

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
    return _read(path, reader, told)


def read_csv(path: Path) -> pd.DataFrame:
    """Read a table of text with commas, semicolons or tabs between cells, whatever the file's name; spaces around
    cells are stripped.

    Raises
    ------
    VotesError
        Naming the file, and the row where there is one.
    """
    return _read(path, _read_text, Told())


Reader = Callable[[Path, Told], pd.DataFrame]


def _read(path: Path, reader: Reader, told: Told) -> pd.DataFrame:
    try:
        return reader(path, told)
    except FileNotFoundError as error:
        raise VotesError(f"{path}: there is no such file") from error
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error


def _read_text(path: Path, told: Told) -> pd.DataFrame:
    return _table_of_text(path.read_bytes(), told)


def _read_gzip(path: Path, told: Told) -> pd.DataFrame:
    try:
        with gzip.open(path) as file:
            content = file.read(MOST_UNPACKED + 1)
        _check_unpacked(len(content))
        return _table_of_text(content, told)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise VotesError(f"is not readable as gzip: {error}") from error


def _table_of_text(content: bytes, told: Told) -> pd.DataFrame:
    text, encoding = _decode(content, told.encoding)
    if not text.strip():
        raise VotesError("is empty, expected a header and at least one row")
    if "\0" in text:
        row = _lines_in(text[: text.index("\0")])
        raise VotesError(f"row {row} holds a NUL character, so it is no text; save the file as CSV in UTF-8")
    if "\n" not in text:
        text = text.replace("\r", "\n")  # ends of lines as on old Macs
    text = text.lstrip("\r\n")
    first, _, rest = text.partition("\n")
    named = SEPARATOR_LINE.fullmatch(first)
    text = rest if named else text
    if told.format == "choix":
        text = f"winner,loser\n{text}"
    separator = named[1] if named and named[1] in SEPARATORS else _separator((text.splitlines() or [""])[0])
    header = [name.strip() for name in _cells(io.StringIO(text), separator)]
    if not header:
        raise VotesError(f"is no table: its header holds a name of more than {csv.field_size_limit()} letters")
    if len(header) > MOST_COLUMNS:
        raise VotesError(f"has {len(header)} columns, expected {MOST_COLUMNS} at most")
    if twice := [(name, n) for name, n in Counter(filter(None, header)).items() if n > 1]:
        raise VotesError(f"has {twice[0][1]} columns named {shown(twice[0][0])}, expected one")
    try:
        frame = pd.read_csv(
            io.StringIO(text), sep=separator, dtype=str, keep_default_na=False, skipinitialspace=separator != "\t",
            skip_blank_lines=False, header=0, names=_named_once(header), index_col=False, on_bad_lines="error",
        )  # fmt: skip
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        raise VotesError(f"is not a table of equally long rows: {str(error).strip()}") from error
    _check_lengths(text, separator, len(header))
    cells = {name: frame[name].str.strip().str.replace(DISARMED, "", regex=True) for name in frame.columns}
    understood = f"text in {encoding}, {SEPARATORS[separator]} between cells"
    return _without_empty_rows(_understood(pd.DataFrame(cells), understood))


def _named_once(header: Sequence[str]) -> list[str]:
    """Return names of columns in which empty ones, as R and trailing commas leave them, are numbered."""
    empty = [place for place, name in enumerate(header) if not name]
    return [name or (f"Unnamed: {place}" if len(empty) > 1 else "") for place, name in enumerate(header)]


def _check_lengths(text: str, separator: str, n_columns: int) -> None:
    """Raise if the first row has more cells than the header: pandas drops them, or takes them for names of rows."""
    rows = csv.reader(io.StringIO(text), delimiter=separator)
    next(rows, None)
    try:
        first = next(rows, [])
    except csv.Error:
        return
    if len(first) > n_columns and any(cell.strip() for cell in first[n_columns:]):
        raise VotesError(f"is not a table of equally long rows: row 1 has more cells than the header's {n_columns}")


def _without_empty_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Leave rows out in which every cell is empty; the others keep their numbers in the file."""
    is_there = ~(frame.isna() | (frame == "")).all(axis=1).to_numpy() if frame.shape[1] else np.ones(len(frame), bool)
    if is_there.all():
        return frame
    kept = frame[is_there].reset_index(drop=True)
    kept.attrs = {**frame.attrs, "rows": (np.flatnonzero(is_there) + 1).tolist()}
    return kept


def _lines_in(text: str) -> int:
    """Count the ends of lines, of any kind."""
    return text.count("\n") or text.count("\r")


def _quick_table(path: Path, told: Told) -> Table | None:
    """Read a large clean CSV file in UTF-8 at once; None for any other, which is read cell by cell."""
    if path.suffix.lower() != ".csv" or not path.is_file() or path.stat().st_size < QUICK_FROM:
        return None
    if told.encoding or told.format == "choix":
        return None
    from pyarrow import ArrowException, dictionary, int32, string  # loads slowly
    from pyarrow import csv as arrow_csv

    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = next(csv.reader(file))
        names = [name.strip() for name in header]
        if len(set(names)) < len(names) or "" in names or len(names) < 2 or len(names) > MOST_COLUMNS:
            return None
        if SEPARATOR_LINE.fullmatch(header[0]) or _separator(",".join(header)) != ",":
            return None
        options = arrow_csv.ConvertOptions(
            column_types=dict.fromkeys(header, dictionary(int32(), string())), null_values=[], strings_can_be_null=False
        )
        with arrow_csv.open_csv(
            path, read_options=arrow_csv.ReadOptions(block_size=BLOCK), convert_options=options
        ) as reader:
            columns = _coded(reader, header)
    except (ValueError, OSError, StopIteration, csv.Error, ArrowException):
        return None
    if columns is None:
        return None
    with path.open("rb") as raw:
        encoding = "UTF-8 with a byte-order mark" if raw.read(1) == b"\xef" else "UTF-8"
    return Table(dict(zip(names, columns, strict=True)), f"text in {encoding}, commas between cells")


def _coded(reader: Any, header: Sequence[str]) -> list[Column] | None:
    """Return columns from batches of dictionary-encoded ones; None if a cell needs a closer look."""
    known: list[dict[str, int]] = [{} for _ in header]
    parts: list[list[NDArray[np.int32]]] = [[] for _ in header]
    for batch in reader:
        for place, (words, cells) in enumerate(zip(known, batch.columns, strict=True)):
            texts = [word.strip() for word in cells.dictionary.to_pylist()]
            if any(word[:1] in ("'", '"') or "\0" in word for word in texts):
                return None
            index = np.array([words.setdefault(word, len(words)) for word in texts], np.int32)
            parts[place].append(index[cells.indices.to_numpy()])
    columns = [
        Column(np.concatenate(codes) if codes else np.array([], np.int32), tuple(words))
        for codes, words in zip(parts, known, strict=True)
    ]
    may_be_empty = [column for column in columns if "" in column.words]
    if len(may_be_empty) == len(columns):  # rows in which all cells are empty are left out elsewhere
        is_empty = np.logical_and.reduce([column.codes == column.words.index("") for column in columns])
        if is_empty.any():
            return None
    return columns


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


def _decode(content: bytes, encoding: str = "") -> tuple[str, str]:
    """Decode as told, else UTF-8, or UTF-16 if the file begins with its mark, and name the encoding; else refuse,
    naming the first row that fails and what to tell.
    """
    for signature, kind in SIGNATURES.items():
        if content.startswith(signature):
            raise VotesError(f"is {kind}, expected a table of text; give the file the ending of what it is")
    if encoding:
        return _decode_as(content, encoding), encoding
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return content.decode("utf-16"), "UTF-16"
        except UnicodeDecodeError as error:
            raise VotesError(f"begins as UTF-16, and cannot be read as such: {error.reason}") from error
    if wide := _utf_16_without_mark(content[:SAMPLE]):
        raise VotesError(f"looks like UTF-16 without its mark (every other byte is 0): --encoding {wide}")
    try:
        return content.decode("utf-8-sig"), "UTF-8 with a byte-order mark" if content[:1] == b"\xef" else "UTF-8"
    except UnicodeDecodeError as error:
        if any(byte in NO_TEXT for byte in content[:SAMPLE]):
            raise VotesError(
                f"is no text (byte {error.start + 1} is 0x{content[error.start]:02x}); expected a table: CSV in UTF-8, "
                "or a Parquet file whose name ends in .parquet"
            ) from error
        mark = b"\n" if b"\n" in content else b"\r"
        start = content.rfind(mark, 0, error.start) + 1
        line = content[start:].split(mark, 1)[0].decode("latin-1").strip()
        row = content[: error.start].count(mark)
        raise VotesError(
            f"row {row}: {shown(line)} is not UTF-8 (it may be Latin-1: --encoding latin-1); or save the file as UTF-8"
        ) from error


def _decode_as(content: bytes, encoding: str) -> str:
    try:
        return content.decode(encoding).removeprefix("\ufeff")
    except LookupError as error:
        raise VotesError(
            f"--encoding {encoding} is not known; known are utf-8, latin-1, cp1252, utf-16 and others"
        ) from error
    except UnicodeDecodeError as error:
        raise VotesError(f"is not {encoding}: {error.reason} at byte {error.start + 1}") from error


def _utf_16_without_mark(sample: bytes) -> str:
    """Return the kind of UTF-16 that a text looks like; empty for others."""
    half = len(sample) // 2
    if half < 8:  # too short to tell
        return ""
    zeros = [sample[start::2].count(0) for start in (0, 1)]
    if zeros[1] > 0.7 * half and not zeros[0]:
        return "utf-16-le"
    return "utf-16-be" if zeros[0] > 0.7 * half and not zeros[1] else ""


def _read_parquet(path: Path, _told: Told) -> pd.DataFrame:
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


def _read_json(path: Path, told: Told) -> pd.DataFrame:
    try:
        content = json.loads(_decode(path.read_bytes(), told.encoding)[0])
    except json.JSONDecodeError as error:
        raise VotesError(f"is not readable as JSON: {error}") from error
    return _flat(rows_of_json(content), "JSON")


def _flat(nested: tuple[list[dict[str, Any]], tuple[str, ...]], how: str) -> pd.DataFrame:
    """Return the table of rows, with what was left out or restated."""
    rows, notes = nested
    frame = _understood(pd.DataFrame(rows, dtype=object), how)
    frame.attrs["notes"] = notes
    return frame


def _read_python(path: Path, told: Told) -> pd.DataFrame:
    """Read a dataset file of sureal, whose literals are taken and which is never run."""
    text, _ = _decode(path.read_bytes(), told.encoding)
    return _flat(rows_of_python(text), "Python, read as literals and not run")


def _read_lines(path: Path, told: Told) -> pd.DataFrame:
    rows = []
    for number, line in enumerate(_decode(path.read_bytes(), told.encoding)[0].split("\n"), start=1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
        except json.JSONDecodeError as error:
            raise VotesError(f"line {number} is not readable as JSON: {error}") from error
        if not isinstance(row, dict):
            raise VotesError(f"line {number}: {shown(line)} is not an object with named values")
        rows.append(row)
    return _flat(rows_of_json(rows), "JSON, an object on each line")


def _read_excel(path: Path, told: Told) -> pd.DataFrame:
    try:
        with zipfile.ZipFile(path) as archive:
            _check_unpacked(sum(entry.file_size for entry in archive.infolist()))
        with pd.ExcelFile(path, engine="openpyxl") as book:
            sheets = [str(name) for name in book.sheet_names]
            sheet = told.sheet or sheets[0]
            if sheet not in sheets:
                raise VotesError(f"has no sheet {shown(sheet)}; it has {', '.join(map(shown, sheets))}")
            _check_cells(_cells_up_to(book.book[sheet].iter_rows(values_only=True)))
            frame = pd.read_excel(book, sheet_name=sheet, dtype=object, keep_default_na=False, na_values=[""])
    except (FileNotFoundError, VotesError):
        raise
    except Exception as error:  # openpyxl raises whatever its parts raise
        raise VotesError(f"is not readable as Excel: {shown(error)}") from error
    frame.columns = [str(name).strip() for name in frame.columns]
    frame = frame.map(lambda cell: cell.strip() if isinstance(cell, str) else cell)
    place = sheets.index(sheet)
    rest = f", {'the first' if not place else f'number {place + 1}'} of {len(sheets)}" if len(sheets) > 1 else ""
    others = [shown(name) for name in sheets if name != sheet]
    frame = _without_empty_rows(_understood(frame, f"Excel, sheet {sheet}{rest}"))
    if others:
        frame.attrs["notes"] = (f"the other sheets are {', '.join(others)} (--sheet names one)",)
    return frame


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
READERS: dict[str, Reader] = {
    **dict.fromkeys((".csv.gz", ".tsv.gz"), _read_gzip),
    **dict.fromkeys((".csv", ".tsv"), _read_text),
    **dict.fromkeys((".jsonl", ".ndjson"), _read_lines),
    ".json": _read_json,
    ".parquet": _read_parquet,
    ".xlsx": _read_excel,
    ".py": _read_python,
}

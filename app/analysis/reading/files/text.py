"""Cut text into the cells of a table: encodings, separators, headers; large clean files at once."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from app.analysis.reading.cells import Column, Table, column_of_series, shown
from app.analysis.reading.description import Told
from app.analysis.reading.votes_table import VotesError
from app.files import FORMULA

NO_TEXT = frozenset(range(32)) - frozenset(b"\t\n\r\f")  # bytes of no text in any encoding of letters
MOST_COLUMNS = 20_000  # of a text; a column for each pair of 200 items
SAMPLE = 4096  # bytes that tell text from anything else
QUICK_FROM = 4_000_000  # bytes; below, reading text cell by cell takes no more than a second
BLOCK = 16_000_000  # bytes read at once
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
SEPARATOR_LINE = re.compile(r"\s*\"?sep=(.)\"?\s*", re.IGNORECASE)  # what a spreadsheet writes above the header
# An apostrophe that keeps a spreadsheet from taking text for a formula.
DISARMED = re.compile(f"^'(?=[{re.escape(''.join(FORMULA))}])")
SIGNATURES = {
    b"PK\x03\x04": "a zip or Excel file",
    b"PAR1": "a Parquet file",
    b"\x1f\x8b": "a gzip file",
    b"\x89PNG": "a picture",
    b"%PDF": "a PDF",
    b"\xd0\xcf\x11\xe0": "an old Excel file",
}


def table_of_text(content: bytes, told: Told) -> Table:
    """Read a table of text, whose separator and encoding its content tells; spaces around cells are stripped."""
    text, encoding = decode(content, told.encoding)
    if not text.strip():
        raise VotesError("is empty, expected a header and at least one row")
    if "\n" not in text:
        text = text.replace("\r", "\n")  # ends of lines as on old Macs
    if "\0" in text:
        row = text[: text.index("\0")].count("\n")
        raise VotesError(f"row {row} holds a NUL character, so it is no text; save the file as CSV in UTF-8")
    text = text.lstrip("\r\n")
    first, _, rest = text.partition("\n")
    named = SEPARATOR_LINE.fullmatch(first)
    text = rest if named else text
    if told.format == "choix":
        text = f"winner,loser\n{text}"
    separator = named[1] if named and named[1] in SEPARATORS else _separator((text.splitlines() or [""])[0])
    lines = io.StringIO(text)
    header, first_row = ([cell.strip() for cell in _cells(lines, separator)] for _ in range(2))
    if not header:
        raise VotesError(f"is no table: its header holds a name of more than {csv.field_size_limit()} letters")
    if len(header) > MOST_COLUMNS:
        raise VotesError(f"has {len(header)} columns, expected {MOST_COLUMNS} at most")
    if twice := [(name, n) for name, n in Counter(filter(None, header)).items() if n > 1]:
        raise VotesError(f"has {twice[0][1]} columns named {shown(twice[0][0])}, expected one")
    beyond = range(len(first_row) - len(header))  # cells after those of the header: of trailing commas
    try:
        frame = pd.read_csv(
            io.StringIO(text), sep=separator, dtype=str, keep_default_na=False, skipinitialspace=separator != "\t",
            skip_blank_lines=False, header=0, names=[*_named_once(header), *beyond], on_bad_lines="error",
        )  # fmt: skip
    except pd.errors.ParserError as error:
        raise VotesError(
            f"is not a table of equally long rows: {str(error).strip()}; the first line is to name the columns, and is "
            f"{shown(separator.join(header))}"
        ) from error
    columns = {str(name): column_of_series(frame[name]) for name in frame.columns}
    cells = {
        name: column.mapped(DISARMED.sub("", word.strip()) for word in column.words) for name, column in columns.items()
    }
    for place in map(str, beyond):
        if len(rows := np.flatnonzero(cells.pop(place).meaning(bool, bool))):
            why = f"row {rows[0] + 1} has more cells than the header's {len(header)}"
            raise VotesError(f"is not a table of equally long rows: {why}")
    return Table(cells, f"text in {encoding}, {SEPARATORS[separator]} between cells").without_empty_rows()


def _named_once(header: Sequence[str]) -> list[str]:
    """Return names of columns in which empty ones, as R and trailing commas leave them, are numbered."""
    empty = [place for place, name in enumerate(header) if not name]
    return [name or (f"Unnamed: {place}" if len(empty) > 1 else "") for place, name in enumerate(header)]


def decode(content: bytes, encoding: str = "") -> tuple[str, str]:
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


def quick_table(path: Path, told: Told) -> Table | None:
    """Read a large clean CSV file in UTF-8 at once; None for any other, which is read cell by cell."""
    is_clean = path.suffix.lower() == ".csv" and not told.encoding and told.format != "choix"
    if not is_clean or not path.is_file() or path.stat().st_size < QUICK_FROM:
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
        read = arrow_csv.ReadOptions(block_size=BLOCK, use_threads=False)
        texts = arrow_csv.read_csv(path, read_options=read, convert_options=options).unify_dictionaries()
    except (ValueError, OSError, StopIteration, csv.Error, ArrowException):
        return None
    columns = {}
    for name, cells in zip(names, texts.itercolumns(), strict=True):
        coded = cells.combine_chunks()
        words = tuple(word.strip() for word in coded.dictionary.to_pylist())
        if any(word[:1] in ("'", '"') or "\0" in word for word in words):
            return None  # it needs a closer look
        columns[name] = Column(coded.indices.to_numpy(), words).mapped(words)
    with path.open("rb") as raw:
        encoding = "UTF-8 with a byte-order mark" if raw.read(1) == b"\xef" else "UTF-8"
    return Table(columns, f"text in {encoding}, commas between cells").without_empty_rows()


def _separator(header: str) -> str:
    """Return what separates most cells of the header; a comma where nothing does."""
    counts = {mark: len(_cells([header], mark)) for mark in SEPARATORS}
    return max(counts, key=lambda mark: counts[mark])


def _cells(lines: Iterable[str], separator: str) -> list[str]:
    """Return the cells of the next line; none where one is longer than any name, or at the end."""
    try:
        return next(csv.reader(lines, delimiter=separator), [])
    except csv.Error:
        return []

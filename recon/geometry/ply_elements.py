"""The elements of a PLY file, text or binary, as arrays: a reader of our own, as the usual one is under the GPL.

Rows of lists of one length, as those of triangles are, are mapped into memory; others are found row by row.
"""

from __future__ import annotations

import re
import struct
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

NUMBERS = {
    name: np.dtype(kind)
    for kind, names in {
        "i1": "char int8",
        "u1": "uchar uint8",
        "i2": "short int16",
        "u2": "ushort uint16",
        "i4": "int int32",
        "u4": "uint uint32",
        "f4": "float float32",
        "f8": "double float64",
    }.items()
    for name in names.split()
}
Order = Literal["<", ">"]
ORDERS: dict[str, Order | None] = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_HEADER = 64 * 1024  # bytes
LINE_END = re.compile(rb"\r\n|\n|\r")
HEADER_END = {b"\r": re.compile(rb"\rend_header[ \t]*\r")}  # its data may begin with the byte of a line feed
USUAL_HEADER_END = re.compile(rb"\nend_header[ \t]*(\r?\n|\Z)")
Take = Callable[[NDArray[np.int64], np.dtype[Any]], NDArray[Any]]


@dataclass(frozen=True)
class Property:
    """A number of each row, or a list whose length, of type `length`, stands before it."""

    name: str
    kind: np.dtype[Any]
    length: np.dtype[Any] | None = None


@dataclass(frozen=True, eq=False)
class Lists:
    """A list in each row.

    Parameters
    ----------
    values : (K,), all lists one after another
    lengths : int64 (N,)
    """

    values: NDArray[Any]
    lengths: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Element:
    """The rows of an element: numbers (N,) or lists by their property's name."""

    n_rows: int
    columns: Mapping[str, NDArray[Any] | Lists]


@dataclass(frozen=True, eq=False)
class Elements:
    """What a PLY file holds: its elements by name, and its comments in order."""

    elements: Mapping[str, Element]
    comments: tuple[str, ...]

    def columns(self, name: str) -> Mapping[str, NDArray[Any] | Lists]:
        """Return the columns of an element, (N,) each; none where the file has no such element, or no row of it."""
        return self.elements[name].columns if self.n_rows(name) else {}

    def n_rows(self, name: str) -> int:
        """Return how many rows an element has; 0 where the file has no such element."""
        return self.elements[name].n_rows if name in self.elements else 0


@dataclass(frozen=True)
class _Header:
    """What stands before the rows, `n_bytes` long; `rows` has the number and properties of each element's rows."""

    order: Order | None
    rows: Mapping[str, tuple[int, tuple[Property, ...]]]
    comments: tuple[str, ...]
    n_bytes: int


def read_elements(path: Path) -> Elements:
    """Read a PLY file; binary numbers stay in the file until they are used.

    Raises
    ------
    ValueError
        If it is no whole PLY file: says what is wrong, without the file's name.
    OSError
        If it cannot be read.
    """
    with path.open("rb") as file:
        header = _header(file.read(LONGEST_HEADER), path.stat().st_size)
        if header.order is None:
            file.seek(header.n_bytes)
            return Elements(_text_elements(header, file.read()), header.comments)
    return Elements(_binary_elements(header, header.order, np.asarray(np.memmap(path, np.uint8, "r"))), header.comments)


def _header(content: bytes, size: int) -> _Header:
    """Parse the header of a file of `size` bytes, which may not promise more rows than that."""
    first = LINE_END.search(content)
    if first is None or content[: first.start()].strip() != b"ply":
        raise ValueError(f"it begins with {content[:12]!r}, expected a line ply")
    end = HEADER_END.get(first[0], USUAL_HEADER_END).search(content)
    if end is None:
        raise ValueError(f"there is no end_header in its first {LONGEST_HEADER} bytes")
    form: str | None = None
    rows: dict[str, tuple[int, tuple[Property, ...]]] = {}
    comments = []
    for line in LINE_END.split(content[first.end() : end.start()]):
        text = _text(line).strip()
        match text.split():
            case ["format", name, "1.0"] if name in ORDERS and form is None:
                form = name
            case ["comment", *_]:
                comments.append(text.removeprefix("comment").strip())
            case ["element", name, count] if name not in rows and re.fullmatch(r"-?\d{1,30}", count):
                if not 0 <= int(count) <= size:
                    raise ValueError(f"its header promises {int(count)} rows, but the file has only {size} bytes")
                rows[name] = int(count), ()
            case ["property", *words] if rows:
                name, (n_rows, properties) = next(reversed(rows.items()))
                rows[name] = n_rows, (*properties, _property(text, words, properties))
            case [] | ["obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header has the line {text!r:.80}, which says nothing in a PLY file there")
    if form is None:
        raise ValueError("its header has no line format, expected format ascii 1.0 or format binary_little_endian 1.0")
    return _Header(ORDERS[form], rows, tuple(comments), end.end())


def _property(line: str, words: Sequence[str], others: Sequence[Property]) -> Property:
    match words:
        case [kind, name] if kind in NUMBERS:
            read = Property(name, NUMBERS[kind])
        case ["list", length, kind, name] if kind in NUMBERS and length in NUMBERS and NUMBERS[length].kind in "iu":
            read = Property(name, NUMBERS[kind], NUMBERS[length])
        case _:
            raise ValueError(
                f"its header has the line {line!r:.80}, expected a property with a type, for example float"
            )
    if read.name in [other.name for other in others]:
        raise ValueError(f"its header has two properties {read.name} of one element")
    return read


def _text(line: bytes) -> str:
    """Decode a line; names of textures are UTF-8, or in the letters of an old system."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _text_elements(header: _Header, content: bytes) -> dict[str, Element]:
    lines = [line for line in content.splitlines() if line.strip()]
    elements, start = {}, 0
    for name, (n_rows, properties) in header.rows.items():
        if not properties:
            elements[name] = Element(n_rows, {})
            continue
        rows = lines[start : start + n_rows]
        if len(rows) < n_rows:
            raise ValueError(f"it ends after {len(rows)} rows of {name}, expected {n_rows}")
        start += n_rows
        ends = np.cumsum([len(row.split()) for row in rows], dtype=np.int64)
        numbers = _numbers(name, rows, int(ends[-1]) if n_rows else 0)

        def take(
            places: NDArray[np.int64], kind: np.dtype[Any], numbers: NDArray[np.float64] = numbers
        ) -> NDArray[Any]:
            return _fitting(numbers[places], kind)

        starts = np.concatenate([np.zeros(1, np.int64), ends])[:-1]
        widths = dict.fromkeys(NUMBERS.values(), 1)
        elements[name] = Element(n_rows, _columns(name, properties, starts, ends, widths, take))
    return elements


def numbers_of(text: str | bytes) -> NDArray[np.float64]:
    """Return the numbers (N,) of a text, with spaces between; fewer than it has words where one is no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # where the text is no number; callers name it
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except ValueError:
            return np.zeros(0)


def are_numbers(text: str | bytes) -> bool:
    """Tell whether all words of a text are numbers."""
    try:
        list(map(float, text.split()))
    except ValueError:
        return False
    return True


def _numbers(name: str, rows: Sequence[bytes], n_numbers: int) -> NDArray[np.float64]:
    """Return all numbers of rows of text, or say which row has something else."""
    numbers = numbers_of(b" ".join(rows))
    if len(numbers) != n_numbers:
        for number, row in enumerate(rows):
            if not are_numbers(row):
                raise ValueError(f"row {number} of {name} is {_text(row)!r:.60}, expected numbers")
        raise ValueError(f"its rows of {name} are not readable as numbers")
    return numbers


def _fitting(numbers: NDArray[np.float64], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return numbers in the type that their property has."""
    if kind.kind == "f":
        with np.errstate(over="ignore"):  # as infinite as it is in this type
            return numbers.astype(kind)
    bounds = np.iinfo(kind)
    wrong = ~((numbers >= bounds.min) & (numbers <= bounds.max) & (numbers == np.floor(numbers)))
    if wrong.any():
        raise ValueError(f"it has {numbers[wrong][0]:g}, out of bounds for the {kind.name} of its header")
    return numbers.astype(kind)


def _binary_elements(header: _Header, order: Order, content: NDArray[np.uint8]) -> dict[str, Element]:
    elements, at = {}, header.n_bytes
    for name, (n_rows, properties) in header.rows.items():
        mapped = _mapped(properties, n_rows, content[at:], order)
        if mapped is not None:
            columns, n_bytes = mapped
        else:
            columns, n_bytes = _found_by_row(name, properties, n_rows, content[at:], order)
        elements[name] = Element(n_rows, columns)
        at += n_bytes
    if at < len(content):
        raise ValueError("it goes on after its last element")
    return elements


def _mapped(
    properties: Sequence[Property], n_rows: int, content: NDArray[np.uint8], order: Order
) -> tuple[dict[str, NDArray[Any] | Lists], int] | None:
    """Take all lists to be as long as the first row's; returns columns and their bytes, None where they are not."""
    fields: list[tuple[Any, ...]] = []
    at = 0
    for number, each in enumerate(properties):
        kind = each.kind.newbyteorder(order)
        if each.length is None:
            fields.append((f"{number}", kind))
        else:
            first = content[at : at + each.length.itemsize]
            if not n_rows or len(first) < each.length.itemsize:
                return None
            length = int(first.view(each.length.newbyteorder(order))[0])
            if not 0 <= length * n_rows <= len(content):
                return None
            fields += [(f"{number} length", each.length.newbyteorder(order)), (f"{number}", kind, (length,))]
        at = np.dtype(fields).itemsize
    if n_rows * at > len(content):
        return None
    rows = content[: n_rows * at].view(np.dtype(fields)) if at else np.zeros(n_rows, np.dtype(fields))
    columns: dict[str, NDArray[Any] | Lists] = {}
    for number, each in enumerate(properties):
        values = rows[f"{number}"]
        values = values.astype(each.kind, copy=False)
        if each.length is None:
            columns[each.name] = values
            continue
        lengths = rows[f"{number} length"]
        if (lengths != values.shape[1]).any():
            return None
        columns[each.name] = Lists(values.reshape(-1), np.full(n_rows, values.shape[1], np.int64))
    return columns, n_rows * at


def _found_by_row(
    name: str, properties: Sequence[Property], n_rows: int, content: NDArray[np.uint8], order: Order
) -> tuple[dict[str, NDArray[Any] | Lists], int]:
    """Go from row to row over lists of many lengths; returns columns and how many bytes they have."""
    ends = _row_ends(name, properties, n_rows, content, order)

    def take(places: NDArray[np.int64], kind: np.dtype[Any]) -> NDArray[Any]:
        taken = np.empty((len(places), kind.itemsize), np.uint8)
        for byte in range(kind.itemsize):
            taken[:, byte] = content[places + byte]
        return taken.reshape(-1).view(kind.newbyteorder(order)).astype(kind, copy=False)

    starts = np.concatenate([np.zeros(1, np.int64), ends])[:-1]
    widths = {number: number.itemsize for number in NUMBERS.values()}
    return _columns(name, properties, starts, ends, widths, take), int(ends[-1]) if n_rows else 0


def _row_ends(
    name: str, properties: Sequence[Property], n_rows: int, content: NDArray[np.uint8], order: Order
) -> NDArray[np.int64]:
    """Return where each row ends, int64 (N,), bytes; a ValueError says that the file ends before one."""
    steps: list[tuple[int, struct.Struct, int]] = []  # bytes of numbers before a list, its length, bytes of its numbers
    gap = 0
    for each in properties:
        if each.length is None:
            gap += each.kind.itemsize
        else:
            steps.append((gap, struct.Struct(order + each.length.char), each.kind.itemsize))
            gap = 0
    buffer, ends, at = content.data, np.empty(n_rows, np.int64), 0
    for row in range(n_rows):
        for before, length, itemsize in steps:
            at += before
            if at + length.size > len(content):
                raise ValueError(f"it ends within row {row} of {name}, expected {n_rows} rows")
            count = length.unpack_from(buffer, at)[0]
            if count < 0:
                raise ValueError(f"row {row} of {name} has a list of {count} numbers")
            at += length.size + count * itemsize
        at += gap
        if at > len(content):
            raise ValueError(f"it ends within row {row} of {name}, expected {n_rows} rows")
        ends[row] = at
    return ends


def _columns(
    name: str,
    properties: Sequence[Property],
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    widths: Mapping[np.dtype[Any], int],
    take: Take,
) -> dict[str, NDArray[Any] | Lists]:
    """Return the columns of rows of many lengths.

    Parameters
    ----------
    name : of the element, for messages
    starts, ends : int64 (N,), places of each row
    widths : how many places a number of each type takes
    take : returns the numbers of a type at places
    """
    at, columns = starts, dict[str, NDArray[Any] | Lists]()
    for each in properties:
        kind = each.length or each.kind
        _check_ends(name, at + widths[kind], ends)
        numbers = take(at, kind)
        at = at + widths[kind]
        if each.length is None:
            columns[each.name] = numbers
            continue
        lengths, width = numbers.astype(np.int64), widths[each.kind]
        if (lengths < 0).any():
            raise ValueError(f"row {int(np.argmax(lengths < 0))} of {name} has a list of {lengths.min()} numbers")
        _check_ends(name, at + lengths * width, ends)
        before = np.cumsum(lengths) - lengths
        places = np.repeat(at - before * width, lengths) + np.arange(int(lengths.sum())) * width
        columns[each.name] = Lists(take(places, each.kind), lengths)
        at = at + lengths * width
    if (at != ends).any():
        row = int(np.argmax(at != ends))
        raise ValueError(f"row {row} of {name} goes on after its last property")
    return columns


def _check_ends(name: str, at: NDArray[np.int64], ends: NDArray[np.int64]) -> None:
    if (at > ends).any():
        raise ValueError(f"row {int(np.argmax(at > ends))} of {name} ends before its last property")

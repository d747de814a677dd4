"""Send tables as JSON, CSV or Parquet, as the client prefers: in pages, and only when they have changed."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from itertools import count, islice
from tempfile import SpooledTemporaryFile
from typing import IO, Annotated, Any, Literal

from fastapi import Depends, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response, StreamingResponse
from fastapi.routing import APIRoute
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware
from starlette.types import Receive, Scope, Send

from app.files import without_formula
from app.web import media
from app.web.analyst.columns import KINDS
from app.web.gates import fields_of

Format = Literal["json", "csv", "parquet"]
CSV = "text/csv; charset=utf-8; header=present"
PARQUET = "application/vnd.apache.parquet"
SHORTEST = 16 * 1024  # bytes of an answer that is compressed, unless it is sent while it is read
LEVEL = 5  # of compression, to 9: most of the gain for a third of the time
ALREADY = (*DEFAULT_EXCLUDED_CONTENT_TYPES, PARQUET)  # compressed
MEDIA_TYPES: dict[Format, str] = {"json": "application/json", "csv": CSV, "parquet": PARQUET}
MOST_ROWS = 1_000_000  # of a page
IN_MEMORY = 1024 * 1024  # bytes of a table; the rest waits on disk
TAG_LENGTH = 32  # characters of a digest
PART = 256 * 1024  # bytes sent at once
ROWS_SENT_AT_ONCE = 500
ROWS_AT_ONCE = 20_000  # of a Parquet file, as Python objects


@dataclass(frozen=True)
class TableRequest:
    """Format and page that a client asks for, and what it already has.

    Parameters
    ----------
    known : header If-None-Match, the entity tags of what the client has
    limit, offset : the page, in rows; no limit: to the end
    """

    format: Format
    known: str
    limit: int | None
    offset: int


def table_request(
    request: Request,
    given: Annotated[Format | None, Query(alias="format", description="overrides Accept; else JSON")] = None,
    limit: Annotated[int | None, Query(ge=1, le=MOST_ROWS, description="largest number of rows")] = None,
    offset: Annotated[int, Query(ge=0, le=10**9, description="rows to skip")] = 0,
) -> TableRequest:
    """Read format and page from the request: `?format=`, else the preference of Accept, else JSON.

    A parameter that the route does not have is refused: a misspelt filter would give the whole table.
    """
    names = sorted(fields_of(request.scope["route"].dependant, "query"))
    if strange := [name for name in request.query_params if name not in names]:
        expected = f"there is no such parameter, expected {', '.join(names[:-1])} or {names[-1]}"
        told = {"type": "value_error", "ctx": {"error": expected}}
        raise RequestValidationError([{"loc": ("query", name), **told} for name in strange])
    known = request.headers.get("if-none-match", "")
    return TableRequest(given or _accepted(request.headers.get("accept", "")), known, limit, offset)


ChosenFormat = Annotated[TableRequest, Depends(table_request)]


def table(
    rows: Iterable[Mapping[str, Any]],
    columns: Iterable[str],
    chosen: TableRequest,
    name: str,
    digest: str | None = None,
    n_rows: int | None = None,
) -> Response:
    """Return rows as a JSON array of objects, as CSV with a header, or as Parquet, with the same columns.

    `X-Total-Count` gives the number of rows in all, which tells the client of a page when it has them. Rows are read
    one by one, and a temporary file takes what exceeds a little memory.

    Parameters
    ----------
    rows : of the whole table
    columns : their names, in order
    name : of the file, without its ending
    digest : of what the rows follow from, for the entity tag; None: the tag is that of the content
    n_rows : in all; None: all are read to count them
    """
    columns, numbers = list(columns), count()
    counted = (row for row, _ in zip(rows, numbers, strict=False))
    end = None if chosen.limit is None else chosen.offset + chosen.limit
    page = islice(counted, chosen.offset, end)
    content = SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115 (closed when it has been sent)
    WRITERS[chosen.format](content, page, columns)
    if n_rows is None:
        deque(counted, maxlen=0)  # the rows after the page
        n_rows = next(numbers)
    headers = {"X-Total-Count": str(n_rows)}
    if chosen.format != "json":
        headers["Content-Disposition"] = f'attachment; filename="{name}.{chosen.format}"'
    beside = headers["X-Total-Count"]
    return streamed(content, MEDIA_TYPES[chosen.format], chosen, headers, beside=beside, digest=digest)


@dataclass(frozen=True)
class Stored:
    """A long table in the database, of which only what is sent is read.

    Parameters
    ----------
    revision : changes whenever a row may have changed
    n_rows : in all
    read : offset, limit (None: to the end) -> rows
    """

    revision: Any
    n_rows: Callable[[], int]
    read: Callable[[int, int | None], Iterable[Mapping[str, Any]]]


def stored_table(stored: Stored, columns: Iterable[str], chosen: TableRequest, name: str) -> Response:
    """Return a page of a long table as `table` does: sent while it is read, and not read at all if it is known."""
    columns = list(columns)
    tag = table_digest(chosen, name, [columns, stored.revision])
    if is_known(chosen, tag):
        return unchanged(tag)
    headers = {"X-Total-Count": str(stored.n_rows()), **_own_headers(tag)}
    if chosen.format != "json":
        headers["Content-Disposition"] = f'attachment; filename="{name}.{chosen.format}"'
    rows = stored.read(chosen.offset, chosen.limit)
    parts = {"json": _json_parts, "csv": _csv_parts}.get(chosen.format)
    content = parts(rows, columns) if parts else _parquet_parts(rows, columns)
    return StreamingResponse(content, media_type=MEDIA_TYPES[chosen.format], headers=headers)


def table_digest(chosen: TableRequest, name: str, facts: Any) -> str:
    """Return the digest of a table that follows from facts, in the format and page that a client asks for."""
    asked = [version("reconstudy"), name, chosen.format, chosen.limit, chosen.offset]
    return hashlib.sha256(json.dumps([asked, facts], default=str).encode()).hexdigest()


def _csv_parts(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> Iterator[bytes]:
    yield csv_text((), columns).encode()
    for batch in _batches(rows, ROWS_SENT_AT_ONCE):
        out = io.BytesIO()
        write_csv(out, batch, columns, has_header=False)
        yield out.getvalue()


def _json_parts(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> Iterator[bytes]:
    before = b"["
    for batch in _batches(rows, ROWS_SENT_AT_ONCE):
        out = io.BytesIO()
        write_json(out, batch, columns)
        yield before + out.getvalue()[1:-1]
        before = b","
    yield b"[]" if before == b"[" else b"]"


def _parquet_parts(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> Iterator[bytes]:
    """Write a Parquet file of columns of known kinds, batch by batch, and send it when it is whole."""
    import pyarrow
    import pyarrow.parquet

    schema = pyarrow.schema([(name, _kind(pyarrow, name)) for name in columns])
    content = SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115 (closed when it has been sent)
    with pyarrow.parquet.ParquetWriter(content, schema) as writer:
        for batch in _batches(rows, ROWS_AT_ONCE):
            arrays = [
                pyarrow.array([_nested_as_text(row.get(field.name)) for row in batch], field.type) for field in schema
            ]
            writer.write_table(pyarrow.table(arrays, schema=schema))
    yield from parts_of(content)


def _batches(rows: Iterable[Mapping[str, Any]], size: int) -> Iterator[list[Mapping[str, Any]]]:
    rows = iter(rows)
    while batch := list(islice(rows, size)):
        yield batch


def streamed(
    content: SpooledTemporaryFile[bytes],
    media_type: str,
    chosen: TableRequest,
    headers: Mapping[str, str],
    beside: str = "",
    digest: str | None = None,
) -> Response:
    """Return a temporary file's content with its digest as entity tag, or 304 if the client has it; close it when sent.

    Parameters
    ----------
    beside : enters the entity tag
    digest : the entity tag's, where it is known
    """
    content.seek(0)
    whole = hashlib.file_digest(content, "sha256")
    whole.update(beside.encode())
    digest = digest or whole.hexdigest()
    if is_known(chosen, digest):
        content.close()
        return unchanged(digest)
    size = {"Content-Length": str(content.tell())}
    return StreamingResponse(
        parts_of(content), media_type=media_type, headers={**size, **_own_headers(digest), **headers}
    )


def json_object(content: Mapping[str, Any], chosen: TableRequest, digest: str | None = None) -> Response:
    """Return an object as JSON with its digest, or a given one, as entity tag; 304 if the client has it."""
    text = json_bytes(content)
    digest = digest or hashlib.sha256(text).hexdigest()
    if is_known(chosen, digest):
        return unchanged(digest)
    return Response(text, media_type=MEDIA_TYPES["json"], headers=_own_headers(digest))


def is_known(chosen: TableRequest, digest: str) -> bool:
    """Does the client have this content already?"""
    return media.is_known(chosen.known, digest[:TAG_LENGTH])


def unchanged(digest: str) -> Response:
    return Response(status_code=304, headers=_own_headers(digest))


def _own_headers(digest: str) -> dict[str, str]:
    """Return the headers of a table or object; its tag is weak, as it may be compressed on its way."""
    return {"ETag": f'W/"{digest[:TAG_LENGTH]}"', "Cache-Control": "no-store", "Vary": "Accept, Authorization, Cookie"}


def parts_of(content: IO[bytes]) -> Iterator[bytes]:
    """Yield a file part by part, and close it at the end."""
    with content:
        content.seek(0)
        while part := content.read(PART):
            yield part


def json_bytes(content: Any) -> bytes:
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def csv_text(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Write CSV by RFC 4180: missing values empty, nested values as JSON, formulas disarmed by an apostrophe."""
    out = io.BytesIO()
    write_csv(out, rows, columns)
    return out.getvalue().decode()


def write_csv(
    out: IO[bytes], rows: Iterable[Mapping[str, Any]], columns: Sequence[str], *, has_header: bool = True
) -> None:
    """Write CSV to a file, as `csv_text`."""
    text = io.TextIOWrapper(out, encoding="utf-8", newline="")
    writer = csv.writer(text)
    if has_header:
        writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row.get(column)) for column in columns])
    text.detach()


def write_json(out: IO[bytes], rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Write a JSON array of objects."""
    before = b"["
    for row in rows:
        out.write(before + json_bytes({column: _plain(row.get(column)) for column in columns}))
        before = b","
    out.write(b"[]" if before == b"[" else b"]")


def write_parquet(out: IO[bytes], rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Write Parquet; nested values, and columns of mixed types, become text."""
    import pyarrow
    import pyarrow.parquet

    rows = iter(rows)
    batches: list[list[Any]] = []
    while (batch := list(islice(rows, ROWS_AT_ONCE))) or not batches:
        batches.append([_array(pyarrow, [row.get(column) for row in batch]) for column in columns])
    arrays = [_joined(pyarrow, name, parts) for name, parts in zip(columns, zip(*batches, strict=True), strict=True)]
    pyarrow.parquet.write_table(pyarrow.table(arrays, names=list(columns)), out)


WRITERS: dict[Format, Callable[[IO[bytes], Iterable[Mapping[str, Any]], Sequence[str]], None]] = {
    "json": write_json,
    "csv": write_csv,
    "parquet": write_parquet,
}


def _array(pyarrow: Any, values: Sequence[Any]) -> Any:
    plain = [_nested_as_text(value) for value in values]
    try:
        return pyarrow.array(plain)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
        return pyarrow.array([None if value is None else str(_written(value)) for value in plain], pyarrow.string())


def _nested_as_text(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, (dict, list, tuple)) else value


def _kind(pyarrow: Any, column: str) -> Any:
    """Return the type of a documented column; text of any other."""
    kinds = {bool: pyarrow.bool_(), int: pyarrow.int64(), float: pyarrow.float64()}
    kinds[datetime] = pyarrow.timestamp("us", "UTC")
    return kinds.get(KINDS.get(column, str), pyarrow.string())


def _joined(pyarrow: Any, column: str, parts: Sequence[Any]) -> Any:
    """Join the parts of a column: in the type that it documents, else in their common type, or as text."""
    kinds = {part.type for part in parts} - {pyarrow.null()}
    if not kinds or column in KINDS:
        kind = _kind(pyarrow, column)
        try:
            return pyarrow.chunked_array([part.cast(kind) for part in parts], kind)
        except (pyarrow.ArrowInvalid, pyarrow.ArrowNotImplementedError):  # then it is what its values are
            pass
    if kinds == {pyarrow.int64(), pyarrow.float64()}:
        kind = pyarrow.float64()
    else:
        kind = kinds.pop() if len(kinds) == 1 else pyarrow.string()
    return pyarrow.chunked_array([part.cast(kind) for part in parts], kind)


def flattened(content: Any, path: str = "") -> Iterator[dict[str, Any]]:
    """Flatten a nested object into rows of (key, value), for example ("scores.0.item", "id_fa")."""
    children = content.items() if isinstance(content, Mapping) else enumerate(content)
    for name, child in children:
        key = f"{path}.{name}" if path else str(name)
        if isinstance(child, (Mapping, list, tuple)) and child:
            yield from flattened(child, key)
        else:
            yield {"key": key, "value": child}


def _plain(value: Any) -> Any:
    return value.isoformat() if isinstance(value, datetime) else value


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return without_formula(value) if isinstance(value, str) else _written(value)


def _written(value: Any) -> Any:
    """Return a value as CSV, and text in Parquet, write it; R reads no other words as logical, pandas reads these."""
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    return _plain(_nested_as_text(value))


def _accepted(accept: str) -> Format:
    """Return the format with the highest weight in an Accept header; JSON among equals."""
    weights: dict[Format, float] = dict.fromkeys(MEDIA_TYPES, 0.0)
    for entry in accept.split(","):
        kind, _, parameters = entry.strip().partition(";")
        for name, media_type in MEDIA_TYPES.items():
            if kind.strip().lower() == media_type.split(";")[0]:
                weights[name] = _quality(parameters)
    return max(weights, key=lambda name: weights[name])


def _quality(parameters: str) -> float:
    for parameter in parameters.split(";"):
        name, _, value = parameter.strip().partition("=")
        if name == "q":
            try:
                return float(value)
            except ValueError:
                return 0.0
    return 1.0


class CompressedRoute(APIRoute):
    """Answers as any route does, compressed where that is worth it: JSON and CSV repeat names in every row."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        await GZipMiddleware(super().handle, SHORTEST, LEVEL, exclude_content_types=ALREADY)(scope, receive, send)

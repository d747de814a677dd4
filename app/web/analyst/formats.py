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
from itertools import count, islice
from tempfile import SpooledTemporaryFile
from typing import IO, Annotated, Any, Literal

from fastapi import Depends, Query, Request
from fastapi.responses import Response, StreamingResponse

Format = Literal["json", "csv", "parquet"]
CSV = "text/csv; charset=utf-8; header=present"
PARQUET = "application/vnd.apache.parquet"
MEDIA_TYPES: dict[Format, str] = {"json": "application/json", "csv": CSV, "parquet": PARQUET}
MOST_ROWS = 1_000_000  # of a page
IN_MEMORY = 1024 * 1024  # bytes of a table; the rest waits on disk
PART = 256 * 1024  # bytes sent at once
ROWS_AT_ONCE = 20_000  # of a Parquet file, as Python objects
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # first characters of a spreadsheet's formula


@dataclass(frozen=True)
class TableRequest:
    """Format and page that a client asks for, and what it already has.

    Parameters
    ----------
    known : entity tags that the client has
    limit, offset : the page, in rows; no limit: to the end
    """

    format: Format
    known: frozenset[str]
    limit: int | None
    offset: int


def table_request(
    request: Request,
    given: Annotated[Format | None, Query(alias="format", description="overrides Accept; else JSON")] = None,
    limit: Annotated[int | None, Query(ge=1, le=MOST_ROWS, description="largest number of rows")] = None,
    offset: Annotated[int, Query(ge=0, le=10**9, description="rows to skip")] = 0,
) -> TableRequest:
    """Read format and page from the request: `?format=`, else the preference of Accept, else JSON."""
    known = frozenset(tag.strip().removeprefix("W/") for tag in request.headers.get("if-none-match", "").split(","))
    return TableRequest(given or _accepted(request.headers.get("accept", "")), known, limit, offset)


ChosenFormat = Annotated[TableRequest, Depends(table_request)]


def table(rows: Iterable[Mapping[str, Any]], columns: Iterable[str], chosen: TableRequest, name: str) -> Response:
    """Return rows as a JSON array of objects, as CSV with a header, or as Parquet, with the same columns.

    `X-Total-Count` gives the number of rows in all, which tells the client of a page when it has them. Rows are read
    one by one, and a temporary file takes what exceeds a little memory: a million votes need no more memory than
    ten.
    """
    columns, numbers = list(columns), count()
    counted = (row for row, _ in zip(rows, numbers, strict=False))
    end = None if chosen.limit is None else chosen.offset + chosen.limit
    page = islice(counted, chosen.offset, end)
    content = SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115 (closed when it has been sent)
    WRITERS[chosen.format](content, page, columns)
    deque(counted, maxlen=0)  # the rows after the page
    headers = {"X-Total-Count": str(next(numbers))}
    if chosen.format != "json":
        headers["Content-Disposition"] = f'attachment; filename="{name}.{chosen.format}"'
    return streamed(content, MEDIA_TYPES[chosen.format], chosen, headers, beside=headers["X-Total-Count"])


def streamed(
    content: SpooledTemporaryFile[bytes],
    media_type: str,
    chosen: TableRequest,
    headers: Mapping[str, str],
    beside: str = "",
) -> Response:
    """Return a temporary file's content with its digest as entity tag, or 304 if the client has it; close it when sent.

    `beside` enters the entity tag.
    """
    content.seek(0)
    whole = hashlib.file_digest(content, "sha256")
    whole.update(beside.encode())
    digest = whole.hexdigest()
    if is_known(chosen, digest):
        content.close()
        return unchanged(digest)
    size = {"Content-Length": str(content.tell())}
    return StreamingResponse(
        _parts(content), media_type=media_type, headers={**size, **_own_headers(digest), **headers}
    )


def json_object(content: Mapping[str, Any], chosen: TableRequest) -> Response:
    """Return an object as JSON with its digest as entity tag; 304 if the client has it."""
    text = json_bytes(content)
    digest = hashlib.sha256(text).hexdigest()
    if is_known(chosen, digest):
        return unchanged(digest)
    return Response(text, media_type=MEDIA_TYPES["json"], headers=_own_headers(digest))


def is_known(chosen: TableRequest, digest: str) -> bool:
    """Does the client have this content already?"""
    return bool(chosen.known & {_tag(digest), "*"})


def unchanged(digest: str) -> Response:
    return Response(status_code=304, headers=_own_headers(digest))


def _own_headers(digest: str) -> dict[str, str]:
    return {"ETag": _tag(digest), "Cache-Control": "private, no-cache", "Vary": "Accept, Authorization, Cookie"}


def _tag(digest: str) -> str:
    return f'"{digest[:32]}"'


def _parts(content: IO[bytes]) -> Iterator[bytes]:
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


def write_csv(out: IO[bytes], rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Write CSV to a file, as `csv_text`."""
    text = io.TextIOWrapper(out, encoding="utf-8", newline="")
    writer = csv.writer(text)
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
    arrays = [_joined(pyarrow, parts) for parts in zip(*batches, strict=True)]
    pyarrow.parquet.write_table(pyarrow.table(arrays, names=list(columns)), out)


WRITERS: dict[Format, Callable[[IO[bytes], Iterable[Mapping[str, Any]], Sequence[str]], None]] = {
    "json": write_json,
    "csv": write_csv,
    "parquet": write_parquet,
}


def _array(pyarrow: Any, values: Sequence[Any]) -> Any:
    plain = [json.dumps(value) if isinstance(value, (dict, list, tuple)) else value for value in values]
    try:
        return pyarrow.array(plain)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
        return pyarrow.array([None if value is None else str(_plain(value)) for value in plain], pyarrow.string())


def _joined(pyarrow: Any, parts: Sequence[Any]) -> Any:
    """Join the parts of a column, in their common type, or as text."""
    kinds = {part.type for part in parts} - {pyarrow.null()}
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
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"'{value}" if value.startswith(FORMULA) else value
    return json.dumps(value) if isinstance(value, (dict, list, tuple)) else _plain(value)


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

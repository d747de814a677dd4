"""Tables as JSON, CSV or Parquet, as the client prefers; in pages, and only when they have changed."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from typing import Annotated, Any, Literal

from fastapi import Depends, Query, Request
from fastapi.responses import Response

Format = Literal["json", "csv", "parquet"]
CSV = "text/csv; charset=utf-8; header=present"
PARQUET = "application/vnd.apache.parquet"
MEDIA_TYPES: dict[Format, str] = {"json": "application/json", "csv": CSV, "parquet": PARQUET}
MOST_ROWS = 1_000_000  # of a page
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet would compute


@dataclass(frozen=True)
class Wanted:
    """How a client wants a table.

    Parameters
    ----------
    known : the entity tags that it has already
    limit, offset : the page, in rows; no limit: to the end
    """

    format: Format
    known: frozenset[str]
    limit: int | None
    offset: int


def wanted(
    request: Request,
    given: Annotated[Format | None, Query(alias="format", description="before Accept; else JSON")] = None,
    limit: Annotated[int | None, Query(ge=1, le=MOST_ROWS, description="rows at most")] = None,
    offset: Annotated[int, Query(ge=0, le=10**9, description="rows left out at the beginning")] = 0,
) -> Wanted:
    """`?format=`, else what Accept prefers, else JSON; and which page."""
    known = frozenset(tag.strip().removeprefix("W/") for tag in request.headers.get("if-none-match", "").split(","))
    return Wanted(given or _accepted(request.headers.get("accept", "")), known, limit, offset)


ChosenFormat = Annotated[Wanted, Depends(wanted)]


def table(rows: Iterable[Mapping[str, Any]], columns: Iterable[str], chosen: Wanted, name: str) -> Response:
    """Rows as a JSON array of objects, as CSV with a header, or as Parquet; the same columns in each.

    A page says how many rows there are in all (`X-Total-Count`) so that a client knows when it has them.
    """
    columns, every = list(columns), list(rows)
    end = None if chosen.limit is None else chosen.offset + chosen.limit
    page = list(islice(every, chosen.offset, end))
    headers = {"X-Total-Count": str(len(every))}
    if chosen.format == "csv":
        content = csv_text(page, columns).encode()
    elif chosen.format == "parquet":
        content = parquet_bytes(page, columns)
    else:
        content = json_bytes([{column: _plain(row.get(column)) for column in columns} for row in page])
    if chosen.format != "json":
        headers["Content-Disposition"] = f'attachment; filename="{name}.{chosen.format}"'
    return tagged(content, MEDIA_TYPES[chosen.format], chosen, headers)


def json_object(content: Mapping[str, Any], chosen: Wanted) -> Response:
    """One object as JSON, unless the client has it already."""
    return tagged(json_bytes(content), MEDIA_TYPES["json"], chosen, {})


def tagged(content: bytes, media_type: str, chosen: Wanted, headers: Mapping[str, str]) -> Response:
    """An answer with the digest of its content as entity tag; 304 if the client has that."""
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    own = {"ETag": tag, "Cache-Control": "private, no-cache", "Vary": "Accept, Authorization, Cookie"}
    if tag in chosen.known or "*" in chosen.known:
        return Response(status_code=304, headers=own)
    return Response(content, media_type=media_type, headers={**own, **headers})


def json_bytes(content: Any) -> bytes:
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def csv_text(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """CSV by RFC 4180; what is missing is empty, what is nested is JSON, what would be a formula is none."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row.get(column)) for column in columns])
    return text.getvalue()


def parquet_bytes(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> bytes:
    """Parquet; what is nested, and what a column holds of several kinds, is text."""
    import pyarrow
    import pyarrow.parquet

    arrays = {column: _array(pyarrow, [row.get(column) for row in rows]) for column in columns}
    out = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(arrays), out)
    return out.getvalue()


def _array(pyarrow: Any, values: Sequence[Any]) -> Any:
    plain = [json.dumps(value) if isinstance(value, (dict, list, tuple)) else value for value in values]
    if all(value is None for value in plain):
        return pyarrow.array(plain, pyarrow.string())
    try:
        return pyarrow.array(plain)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
        return pyarrow.array([None if value is None else str(_plain(value)) for value in plain], pyarrow.string())


def flattened(content: Any, path: str = "") -> Iterator[dict[str, Any]]:
    """A nested object as rows of (key, value), for example ("scores.0.item", "id_fa")."""
    children = content.items() if isinstance(content, Mapping) else enumerate(content)
    for name, child in children:
        own = f"{path}.{name}" if path else str(name)
        if isinstance(child, (Mapping, list, tuple)) and child:
            yield from flattened(child, own)
        else:
            yield {"key": own, "value": child}


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
    """The format with the highest weight in an Accept header; JSON of equals."""
    weights: dict[Format, float] = dict.fromkeys(MEDIA_TYPES, 0.0)
    for entry in accept.split(","):
        kind, _, parameters = entry.strip().partition(";")
        for name, own in MEDIA_TYPES.items():
            if kind.strip().lower() == own.split(";")[0]:
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

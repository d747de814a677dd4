"""Tables as JSON or CSV, as the client prefers."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import Depends, Query, Request
from fastapi.responses import JSONResponse, Response

Format = Literal["json", "csv"]
CSV = "text/csv; charset=utf-8; header=present"


def chosen_format(
    request: Request,
    given: Annotated[Format | None, Query(alias="format", description="before Accept; else JSON")] = None,
) -> Format:
    """`?format=`, else what Accept prefers, else JSON."""
    if given is not None:
        return given
    weights = {"json": 0.0, "csv": 0.0}
    for entry in request.headers.get("accept", "").split(","):
        kind, _, parameters = entry.strip().partition(";")
        for name, own in (("json", "application/json"), ("csv", "text/csv")):
            if kind.strip().lower() == own:
                weights[name] = _quality(parameters)
    return "csv" if weights["csv"] > weights["json"] else "json"


ChosenFormat = Annotated[Format, Depends(chosen_format)]


def table(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], chosen: Format, name: str) -> Response:
    """Rows as a JSON array of objects, or as CSV with a header."""
    if chosen == "csv":
        headers = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
        return Response(csv_text(rows, columns), media_type=CSV, headers=headers)
    return JSONResponse([{column: _plain(row.get(column)) for column in columns} for row in rows])


def csv_text(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """CSV by RFC 4180; what is missing is empty, what is nested is JSON."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row.get(column)) for column in columns])
    return text.getvalue()


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
    return json.dumps(value) if isinstance(value, (dict, list, tuple)) else _plain(value)


def _quality(parameters: str) -> float:
    for parameter in parameters.split(";"):
        name, _, value = parameter.strip().partition("=")
        if name == "q":
            try:
                return float(value)
            except ValueError:
                return 0.0
    return 1.0

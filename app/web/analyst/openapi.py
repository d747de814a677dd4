"""Describe the REST interface in OpenAPI: tables with their columns, problems, tokens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from starlette.routing import BaseRoute

from app.web.analyst.columns import EVERY, Columns, example_row
from app.web.analyst.formats import PARQUET, csv_text
from app.web.analyst.openapi_examples import EXAMPLES

Answers = dict[int | str, dict[str, Any]]

JSON = "application/json"
ROWS = {tuple(columns): example_row(columns) for columns in EVERY}
BINARY = {"schema": {"type": "string", "format": "binary"}}
PROBLEM = {
    "type": "object",
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
    },
    "required": ["type", "title", "status", "detail"],
    "example": {"type": "about:blank", "title": "Not Found", "status": 404, "detail": "There is no such study."},
}


def table_answers(columns: Columns, further: Columns | None = None) -> Answers:
    """Return the responses of a route that sends a table.

    Parameters
    ----------
    columns : that every row has
    further : that rows have in some studies
    """
    properties = {name: {"description": column.meaning} for name, column in (columns | (further or {})).items()}
    row = {"type": "object", "properties": properties, "required": list(columns)}
    example = example_row(columns)
    json_table = {"schema": {"type": "array", "items": row}}
    csv_table = {"schema": {"type": "string"}, "example": csv_text([example], list(columns))}
    content = {"application/json": json_table, "text/csv": csv_table, PARQUET: BINARY}
    return {200: {"description": "The table", "content": content}, 304: {"description": "Unchanged (If-None-Match)"}}


def object_answers(example: Mapping[str, Any], *, tables_too: bool = False) -> Answers:
    """Return the responses of a route that sends an object."""
    content: dict[str, Any] = {"application/json": {"schema": {"type": "object"}, "example": dict(example)}}
    if tables_too:
        content |= {"text/csv": {"schema": {"type": "string"}}, PARQUET: BINARY}
    return {200: {"description": "The object", "content": content}, 304: {"description": "Unchanged (If-None-Match)"}}


def file_body() -> dict[str, Any]:
    """Return the description of a body that is a file."""
    return {"requestBody": {"required": True, "content": {"application/octet-stream": BINARY}}}


def describe(app: FastAPI, routes: Sequence[BaseRoute]) -> None:
    """Let an app describe routes in OpenAPI, in their order, with problems and tokens."""

    def description() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _description(app, routes)
        return app.openapi_schema

    app.openapi = description  # type: ignore[method-assign]  # FastAPI's own way to extend it


def _description(app: FastAPI, routes: Sequence[BaseRoute]) -> dict[str, Any]:
    description = get_openapi(title=app.title, version=app.version, summary=app.summary, routes=routes)
    schemas = description["components"]["schemas"]
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    schemas["Problem"] = PROBLEM
    description["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
    problem = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
    for operations in description["paths"].values():
        for operation in operations.values():
            operation["responses"].pop("422", None)
            operation["responses"]["4XX"] = {"description": "Refused: says why (RFC 9457)", "content": problem}
            operation["responses"]["503"] = {"description": "Try again later (Retry-After)", "content": problem}
            operation["security"] = [{"token": []}]
            _add_examples(operation)
    return dict(description)


def _add_examples(operation: dict[str, Any]) -> None:
    """Give each JSON body and response its example; FastAPI would drop nulls from it."""
    parts = [operation.get("requestBody", {}), *operation["responses"].values()]
    for content in [part["content"][JSON] for part in parts if JSON in part.get("content", {})]:
        schema = content["schema"]
        row = schema.get("items", schema)
        if "properties" in row:
            content["example"] = [ROWS[tuple(row["required"])]]
        elif (name := str(row.get("$ref", "")).rsplit("/", 1)[-1]) in EXAMPLES:
            content["example"] = [EXAMPLES[name]] if "items" in schema else EXAMPLES[name]

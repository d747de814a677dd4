"""Show the description of the REST interface as a page to read, made from the OpenAPI document."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.web.gates import render

JSON = "application/json"
TAGS = {  # in this order
    "studies": "Manage studies",
    "results": "Fetch results",
    "material": "Texts, design and figures",
    "people": "Look after participants",
    "uploads": "Send films, results and studies",
    "files": "Keep files on the server",
    "jobs": "Work on the server",
    "participants": "Take part in a study",
}

router = APIRouter(include_in_schema=False)


@router.get("/docs")
def api_page(request: Request) -> Response:
    """Show every route with its parameters, bodies, answers and a line for curl."""
    described = request.app.openapi()
    groups: dict[str, list[dict[str, Any]]] = {}
    for operation in operations(described, str(request.base_url).rstrip("/")):
        groups.setdefault(operation["tag"], []).append(operation)
    context = {
        "title": described["info"]["title"],
        "groups": [(name, groups[tag]) for tag, name in TAGS.items()],
    }
    return render(request, "api.html", context)


def operations(described: Mapping[str, Any], server: str) -> Iterator[dict[str, Any]]:
    """Yield all routes of an OpenAPI document as the page shows them.

    Parameters
    ----------
    described : the document
    server : address that curl is to ask
    """
    schemas = described["components"]["schemas"]
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            content = operation.get("requestBody", {}).get("content", {})
            body = content.get(JSON, {})
            yield {
                "id": operation["operationId"],
                "tag": operation["tags"][0],
                "method": method.upper(),
                "path": path,
                "summary": operation["description"].split("\n\n")[0],
                "more": operation["description"].split("\n\n")[1:],
                "parameters": [_parameter(row) for row in operation.get("parameters", ())],
                "body": list(_fields(body.get("schema", {}), schemas)),
                "body_example": _as_text(body.get("example")),
                "takes": [kind for kind in content if kind != JSON],
                "answers": [_answer(status, row, schemas) for status, row in operation["responses"].items()],
                "curl": _curl(method, path, server, body.get("example"), is_file=bool(content) and not body),
            }


def _parameter(row: Mapping[str, Any]) -> dict[str, Any]:
    schema = row["schema"]
    text = row.get("description", schema.get("description") or _described(schema))
    return {"name": row["name"], "where": row["in"], "required": row.get("required", False), "text": text} | {
        "kind": _kind(schema)
    }


def _answer(status: str, row: Mapping[str, Any], schemas: Mapping[str, Any]) -> dict[str, Any]:
    content = row.get("content", {})
    body = content.get(JSON, {})
    return {
        "status": status,
        "text": row["description"],
        "kinds": list(content),
        "fields": list(_fields(body.get("schema", {}), schemas)),
        "example": _as_text(body.get("example")),
    }


def _fields(schema: Mapping[str, Any], schemas: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the fields of an object, or of a list's objects."""
    whole = _resolved(schema, schemas)
    whole = _resolved(whole.get("items", whole), schemas)
    for name, field in whole.get("properties", {}).items():
        text = field.get("description") or _described(field)
        yield {"name": name, "kind": _kind(field), "required": name in whole.get("required", ()), "text": text}


def _described(field: Mapping[str, Any]) -> str:
    """Return the description of a field that may be missing, which stands with its type."""
    return next((part["description"] for part in field.get("anyOf", ()) if "description" in part), "")


def _resolved(schema: Mapping[str, Any], schemas: Mapping[str, Any]) -> Mapping[str, Any]:
    resolved: Mapping[str, Any] = schemas[schema["$ref"].rsplit("/", 1)[-1]] if "$ref" in schema else schema
    return resolved


def _kind(schema: Mapping[str, Any]) -> str:
    """Return a schema's type in a few words."""
    if "$ref" in schema:
        return str(schema["$ref"]).rsplit("/", 1)[-1]
    if "enum" in schema:
        return " | ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    if "anyOf" in schema:
        return " or ".join(_kind(part) for part in schema["anyOf"])
    kind = str(schema.get("type", ""))
    return f"list of {_kind(schema['items']) or 'values'}" if kind == "array" and "items" in schema else kind


def _as_text(example: Any) -> str:
    return "" if example is None else json.dumps(example, indent=2, ensure_ascii=False)


def _curl(method: str, path: str, server: str, example: Any, *, is_file: bool) -> str:
    parts = ["curl"] + ([f"-X {method.upper()}"] if method != "get" else [])
    parts.append('-H "Authorization: Bearer $TOKEN"')
    if example is not None:
        parts.append(f"-H 'Content-Type: {JSON}' -d '{json.dumps(example, ensure_ascii=True)}'")
    if is_file:
        parts.append("--data-binary @FILE")
    return f"{' '.join(parts)} {server}{path.replace('{slug}', 'temple')}"

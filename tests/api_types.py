"""Declare the JSON of the participant's page as TypeScript types, from its OpenAPI description, for the type checker.

python -m tests.api_types    writes frontend/api.d.ts
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fastapi.openapi.utils import get_openapi

from app.web.participant import beginning, screening, session, trials, votes

PATH = Path(__file__).parent.parent / "frontend" / "api.d.ts"
PLAIN = {"string": "string", "integer": "number", "number": "number", "boolean": "boolean", "null": "null"}


def schemas() -> dict[str, Any]:
    """The models of the participant's routes, by name."""
    parts = (beginning, session, screening, trials, votes)
    routes = [route for part in parts for route in part.router.routes]
    return dict(get_openapi(title="", version="", routes=routes)["components"]["schemas"])


def type_of(schema: Mapping[str, Any]) -> str:
    """A schema as a type."""
    if "$ref" in schema:
        return str(schema["$ref"]).rsplit("/", 1)[-1]
    if "const" in schema or "enum" in schema:
        return " | ".join(map(json.dumps, schema.get("enum", [schema.get("const")])))
    if "anyOf" in schema:
        return " | ".join(map(type_of, schema["anyOf"]))
    if schema.get("type") == "array":
        return f"({type_of(schema['items'])})[]"
    if "properties" in schema:
        return "\n".join(["{", *fields_of(schema), "}"])
    if schema.get("additionalProperties") not in (None, True, False):
        return f"Record<string, {type_of(schema['additionalProperties'])}>"
    return PLAIN.get(schema.get("type", ""), "any")


def fields_of(schema: Mapping[str, Any]) -> Iterator[str]:
    """An object's fields with their descriptions; what may be missing is left out, and never null."""
    for name, field in schema["properties"].items():
        if "description" in field:
            yield f"  /** {field['description']} */"
        is_sent = name in schema.get("required", ())
        yield f"  {name}: {type_of(field)};" if is_sent else f"  {name}?: {type_of(field).removesuffix(' | null')};"


def declarations() -> str:
    """All models as types."""
    return "".join(f"export type {name} = {type_of(schema)};\n\n" for name, schema in schemas().items())


if __name__ == "__main__":
    PATH.write_text(declarations(), encoding="utf-8")

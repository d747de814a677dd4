"""JSON Schema of what users write, by the command line."""

from __future__ import annotations

import json

import pytest

from app.cli.schema import schemas
from tests.command_line import Command


@pytest.mark.parametrize("name", schemas())
def test_a_schema_names_all_settings_and_takes_no_others(command: Command, name: str) -> None:
    schema = json.loads(command("schema", *name.split()).out)
    fields = schemas()[name]().model_fields
    assert list(schema["properties"]) == [info.alias or key for key, info in fields.items()]
    assert name == "manifest" or schema["additionalProperties"] is False  # whose provenance is as its maker likes


@pytest.mark.parametrize("name", schemas())
def test_every_key_of_a_schema_is_described(name: str) -> None:
    schema = schemas()[name]().model_json_schema()
    for part in (schema, *schema.get("$defs", {}).values()):
        for key, value in part.get("properties", {}).items():
            assert "description" in value or "$ref" in value, (name, key)  # the latter says it for itself


def test_a_schema_has_defaults_bounds_and_examples(command: Command) -> None:
    settings = json.loads(command("schema", "reconstruct").out)["properties"]
    assert settings["close_holes"]["default"] == 0
    assert settings["close_holes"]["minimum"] == 0
    assert settings["frames"]["examples"] == ["0:25"]


def test_what_has_no_schema_is_refused_with_what_has(command: Command) -> None:
    told = command("schema", "status")
    assert told.code == 2
    assert "'status' has no schema" in told.err

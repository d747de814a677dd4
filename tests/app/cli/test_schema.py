"""JSON Schema of what users write, by the command line."""

from __future__ import annotations

import json

import pytest

from app.cli.schema import schemas
from app.operations.commands import COMMANDS
from tests.command_line import Command


@pytest.mark.parametrize("name", schemas())
def test_a_schema_names_all_settings_and_takes_no_others(command: Command, name: str) -> None:
    schema = json.loads(command("schema", *name.split()).out)
    assert schema["properties"].keys() == schemas()[name].model_fields.keys()
    assert schema["additionalProperties"] is False


@pytest.mark.parametrize("name", COMMANDS)
def test_each_setting_of_a_command_says_what_it_means(name: str) -> None:
    assert all(field.description for field in COMMANDS[name].model_fields.values())


def test_a_schema_has_defaults_bounds_and_examples(command: Command) -> None:
    settings = json.loads(command("schema", "reconstruct").out)["properties"]
    assert settings["close_holes"]["default"] == 0
    assert settings["close_holes"]["minimum"] == 0
    assert settings["frames"]["examples"] == ["0:25"]


def test_what_has_no_schema_is_refused_with_what_has(command: Command) -> None:
    told = command("schema", "serve")
    assert told.code == 2
    assert "'serve' has no schema" in told.err

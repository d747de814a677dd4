"""JSON Schema of what users write, by the command line."""

from __future__ import annotations

import json

import pytest

from app.cli.schema import SCHEMAS
from tests.command_line import Command


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_schema_says_what_each_setting_means_and_takes_no_others(command: Command, name: str) -> None:
    told = command("schema", *name.split())
    schema = json.loads(told.out)
    assert all(setting["description"] for setting in schema["properties"].values())
    assert schema["additionalProperties"] is False


def test_a_schema_has_defaults_bounds_and_examples(command: Command) -> None:
    settings = json.loads(command("schema", "reconstruct").out)["properties"]
    assert settings["close_holes"]["default"] == 0
    assert settings["close_holes"]["minimum"] == 0
    assert settings["frames"]["examples"] == ["0:25"]


def test_what_has_no_schema_is_refused_with_what_has(command: Command) -> None:
    told = command("schema", "serve")
    assert told.code == 2
    assert "'serve' has no schema" in told.err

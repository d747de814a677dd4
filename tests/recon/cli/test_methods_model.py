"""The model of a whole methods file takes what the pages show."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from pydantic import ValidationError

from recon.cli.methods_model import methods_file

DOCS = Path(__file__).parents[3] / "docs"
SHOWN = [
    block
    for page in ("begin.md", "depth.md", "measures.md")
    for block in re.findall(r"^```toml\n(.*?)^```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    if block.startswith(("[depth.", "[measure."))
]


@pytest.mark.parametrize("text", SHOWN)
def test_the_methods_that_the_pages_show_are_taken(text: str) -> None:
    content = tomllib.loads(text)
    assert methods_file().model_validate(content).model_fields_set == content.keys()


def test_a_misspelt_key_is_refused_by_the_table_of_our_method_and_the_schema_names_no_other_for_it() -> None:
    content = {"measure": {"a": {"command": "a {reference} {distorted}", "beter": "lower"}}}
    with pytest.raises(ValidationError, match="beter"):
        methods_file().model_validate(content)
    schema = methods_file().model_json_schema()["$defs"]
    assert "sigma" in schema["IdTable"]["properties"]
    assert {"id", "fb"} <= set(schema["PlugInTable"]["properties"]["method"]["not"]["enum"])

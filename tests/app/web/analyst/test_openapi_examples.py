"""Every route of the interface is described with examples that are as its schemas say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from app.main import create_app
from app.settings import Settings
from app.web.analyst.columns import EVERY, KINDS, STUDIES, TABLES

JSON = "application/json"


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    app = create_app(Settings(data_dir=tmp_path_factory.mktemp("described")))
    found: dict[str, Any] = app.openapi()
    app.state.database.dispose()
    return found


def contents(described: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every body and answer in JSON, with where it is."""
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            parts = {"body": operation.get("requestBody", {})}
            parts |= {status: answer for status, answer in operation["responses"].items() if status.startswith("2")}
            for name, part in parts.items():
                if JSON in part.get("content", {}):
                    yield f"{method} {path} {name}", part["content"][JSON]


def test_every_body_and_answer_has_an_example_that_fits_its_schema(described: dict[str, Any]) -> None:
    n = 0
    for where, content in contents(described):
        assert "example" in content, f"{where} has no example"
        whole = {**content["schema"], "components": described["components"]}
        faults = [fault.message for fault in Draft202012Validator(whole).iter_errors(content["example"])]
        assert faults == [], where
        n += 1
    assert n > 30


def test_the_example_of_a_table_has_every_column(described: dict[str, Any]) -> None:
    for name, columns in {**TABLES, "": STUDIES}.items():
        path = f"/api/v1/studies/{{slug}}/{name}" if name else "/api/v1/studies"
        content = described["paths"][path]["get"]["responses"]["200"]["content"]
        (row,) = content[JSON]["example"]
        assert list(row) == list(columns), path
        assert content["text/csv"]["example"].splitlines()[0] == ",".join(columns), path


def test_every_route_says_what_it_does(described: dict[str, Any]) -> None:
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            assert operation.get("description"), f"{method} {path}"
            assert {"4XX", "503"} <= operation["responses"].keys(), f"{method} {path}"


def test_a_column_of_one_name_is_of_one_kind_in_every_table() -> None:
    for columns in EVERY:
        for name, column in columns.items():
            assert column.kind == KINDS[name], name

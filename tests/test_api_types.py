"""The page's scripts are checked against the types that the server describes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

from pydantic import BaseModel

from tests.api_types import declarations, type_of

SESSION = Path(__file__).parent.parent / "static" / "js" / "session.js"


class Inner(BaseModel):
    depth: float


class Outer(BaseModel):
    kind: Literal["one", "two"]
    parts: list[Inner]
    by_name: dict[str, int]
    label: str | None
    note: bool | None = None


def test_a_model_becomes_the_type_of_its_json() -> None:
    fields = type_of(Outer.model_json_schema()).splitlines()[1:-1]
    assert [field.strip() for field in fields] == [
        'kind: "one" | "two";',
        "parts: (Inner)[];",
        "by_name: Record<string, number>;",
        "label: string | null;",
        "note?: boolean;",
    ]


def test_every_type_that_the_page_takes_is_described_by_the_server() -> None:
    taken = set(re.findall(r'frontend/api"\)\.(\w+)', SESSION.read_text(encoding="utf-8")))
    assert "SessionView" in taken
    assert taken <= set(re.findall(r"^export type (\w+)", declarations(), re.MULTILINE))

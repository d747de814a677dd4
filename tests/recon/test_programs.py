"""Programs of others: how their commands are filled in. How they fail is tested with matchers and fusions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest

from recon.programs import Program


@dataclass(frozen=True)
class Joining(Program):
    PLACEHOLDERS: ClassVar[tuple[str, ...]] = ("out",)
    LISTS: ClassVar[tuple[str, ...]] = ("parts",)
    OUTPUTS: ClassVar[tuple[str, ...]] = ("txt",)


def test_a_list_becomes_several_arguments() -> None:
    program = Joining("join {parts} '-o {out}' {folder}/x", "txt", folder="/home")
    assert program.arguments({"parts": ["a b", "c"], "out": "d"}) == ["join", "a b", "c", "-o d", "/home/x"]


def test_a_list_within_an_argument_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\{parts\} must be an argument of its own"):
        Joining("join --parts={parts} {out}", "txt")


def test_a_command_tells_which_names_it_uses() -> None:
    program = Joining("join {parts}", "txt")
    assert program.asks_for("parts")
    assert not program.asks_for("out")

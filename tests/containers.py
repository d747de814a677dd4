"""The Dockerfile as tests read it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent


class Step(NamedTuple):
    """An instruction of a Dockerfile, continuation lines joined."""

    instruction: str
    arguments: str


def stages() -> dict[str, list[Step]]:
    """The steps of every stage by its name; FROM is each stage's first."""
    text = re.sub(r"\\\n\s*", " ", (ROOT / "Dockerfile").read_text(encoding="utf-8"))
    by_name: dict[str, list[Step]] = {}
    for instruction, arguments in re.findall(r"^([A-Z]+) (.*)$", text, re.MULTILINE):
        if instruction == "FROM":
            steps = by_name[arguments.split()[-1]] = []
        steps.append(Step(instruction, arguments))
    return by_name


def arguments_of(stage: str, instruction: str, containing: str = "") -> list[str]:
    """What a stage's instructions of one kind say."""
    return [
        step.arguments for step in stages()[stage] if step.instruction == instruction and containing in step.arguments
    ]


def copied_files(stage: str) -> list[str]:
    """The paths of the repository that a stage copies."""
    steps = [arguments for arguments in arguments_of(stage, "COPY") if not arguments.startswith("--from")]
    return [path for arguments in steps for path in arguments.split()[:-1]]

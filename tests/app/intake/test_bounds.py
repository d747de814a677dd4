"""What is read in a process of its own waits for no other part of the program to be loaded."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import app
from app.intake.bounds import READERS

pytestmark = pytest.mark.slow

CALL = re.compile(r"\bin_bounds\((\w+),")
WITH_ROWS = "app.operations.upkeep.travel._stage"  # fills a database


def test_every_reader_is_at_hand_in_a_process_that_has_loaded_the_readers() -> None:
    folder = Path(app.__file__).parent
    calls = [
        (".".join(("app", *path.relative_to(folder).with_suffix("").parts)), name)
        for path in folder.rglob("*.py")
        for name in CALL.findall(path.read_text(encoding="utf-8"))
        if name != "read"  # the parameter of `in_bounds` itself
    ]
    assert len(calls) > 5
    probe = f"""
import importlib, sys
for reader in {READERS}: importlib.import_module(reader)
known = set(sys.modules)
late = []
for module, name in {calls}:
    function = getattr(importlib.import_module(module), name)
    home = function.__module__
    if home not in known and home + "." + name != {WITH_ROWS!r}:
        late.append(home + "." + name)
print(*late)
"""
    late = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True).stdout.split()
    light = ("app.operations.foreign_tables.",)  # which loads nothing besides the readers
    assert [name for name in late if not name.startswith(light)] == []

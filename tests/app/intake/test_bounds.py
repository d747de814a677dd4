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

CALL = re.compile(r"(?:\b|_)in_bounds\((\w+),|run_in_threadpool\(in_bounds, (\w+),")
WITH_ROWS = "app.operations.upkeep.travel._stage"  # fills a database


READ_IN_BOUNDS = {  # all that takes apart what came from outside
    ("app.intake.arrivals", "unpack"),
    ("app.operations.foreign_tables", "_analyse"),
    ("app.operations.foreign_tables", "_understand"),
    ("app.operations.studies.attach", "read_results"),
    ("app.operations.studies.receive_films", "read_manifest"),
    ("app.operations.studies.receive_films", "unpacked_films"),
    ("app.operations.upkeep.travel", "_stage"),
    ("app.operations.upkeep.travel", "read_manifest"),
    ("app.web.admin.studies.edit_page", "parse_study_file"),
    ("app.web.admin.studies.new_study_page", "parse_study_file"),
    ("app.web.uploads", "check"),
    ("app.web.uploads", "shelve"),
}


def calls() -> list[tuple[str, str]]:
    """The modules and functions of all calls in bounds."""
    folder = Path(app.__file__).parent
    return [
        (".".join(("app", *path.relative_to(folder).with_suffix("").parts)), name)
        for path in folder.rglob("*.py")
        for found in CALL.findall(path.read_text(encoding="utf-8"))
        for name in filter(None, found)
        if name != "read"  # the parameter of `in_bounds` itself
    ]


def test_what_comes_from_outside_is_read_in_bounds_wherever_it_comes_in() -> None:
    assert set(calls()) == READ_IN_BOUNDS
    assert calls().count(("app.operations.foreign_tables", "_analyse")) == 2


def test_every_reader_is_at_hand_in_a_process_that_has_loaded_the_readers() -> None:
    in_bounds = [(module, name) for module, name in calls() if name not in ("check", "parse_study_file")]
    probe = f"""
import importlib, sys
for reader in {READERS}: importlib.import_module(reader)
known = set(sys.modules)
late = []
for module, name in {in_bounds}:
    function = getattr(importlib.import_module(module), name)
    home = function.__module__
    if home not in known and home + "." + name != {WITH_ROWS!r}:
        late.append(home + "." + name)
print(*late)
"""
    late = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True).stdout.split()
    light = ("app.operations.foreign_tables.",)  # which loads nothing besides the readers
    assert [name for name in late if not name.startswith(light)] == []

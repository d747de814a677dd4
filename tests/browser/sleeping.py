"""Puts a browser to sleep, as closing a laptop does: all its processes are stopped for a while, and go on."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

ASLEEP_S = 2.5


def sleep(pids: Sequence[int]) -> None:
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(ASLEEP_S)
    for pid in pids:
        os.kill(pid, signal.SIGCONT)


def descendants(ancestor: int, name: str = "") -> list[int]:
    """A process and all below it whose name holds this."""
    parents, names = {}, {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            told, fields = (entry / "stat").read_text().split("(", 1)[1].rsplit(")", 1)
        except (OSError, IndexError):
            continue
        parents[int(entry.name)], names[int(entry.name)] = int(fields.split()[1]), told
    family = {ancestor}
    while more := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= more
    return sorted(pid for pid in family if name in names.get(pid, ""))

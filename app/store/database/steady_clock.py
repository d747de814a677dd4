"""A clock that nobody sets: seconds since this machine was started, sleep included, and which start that was."""

from __future__ import annotations

import time
from datetime import timedelta
from functools import cache
from pathlib import Path

START = Path("/proc/sys/kernel/random/boot_id")  # Linux; elsewhere nothing tells one start from the next


@cache
def this_start() -> str | None:
    """Name this start of the machine; None where it has no name."""
    try:
        return START.read_text(encoding="ascii").strip()
    except OSError:
        return None


def running_s() -> float:
    """Return the seconds since the machine was started."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if this_start() else time.monotonic()


def running_s_before(passed: timedelta) -> float:
    """Return what `running_s` was so long ago."""
    return running_s() - passed.total_seconds()

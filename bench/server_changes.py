"""Changes to a study server before it serves, for measuring: named in `--first` of tests/study_server.py."""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

import app.main
from app.store.trials import vote_writer
from app.web.limits.throttle import Throttle
from tests import sqlite_disk

SLOW_MS = 5.0
CLOCK = "RECONSTUDY_BENCH_CLOCK"
JUMPS_S = (0.0, 86_400.0, -86_400.0)


def slow_disk() -> None:
    """Let each sync of SQLite's log take longer."""
    sqlite_disk.install(None, partial(time.sleep, SLOW_MS / 1000))


def no_limits() -> None:
    """Let everybody ask as often as they like."""
    Throttle.hit = lambda *_, **__: True  # type: ignore[method-assign]  # this process is for nothing else
    Throttle.check = lambda *_: None  # type: ignore[method-assign]


def a_commit_each() -> None:
    """Keep one vote in a transaction."""
    vote_writer.LARGEST_BATCH = 1


def clock_of_a_file() -> None:
    """Let the wall clock be as many seconds off as the file says that `CLOCK` names."""
    file, right_s = Path(os.environ[CLOCK]), time.time
    vars(time)["time"] = lambda: right_s() + float(file.read_text() or 0)
    vars(app.main)["utc_now"] = lambda: datetime.fromtimestamp(time.time(), UTC)


def jumping_clock() -> None:
    """Set the clock wrong, right, and wrong again ten times a second."""
    vars(app.main)["utc_now"] = lambda: (
        datetime.now(UTC) + timedelta(seconds=JUMPS_S[int(10 * time.monotonic()) % len(JUMPS_S)])
    )

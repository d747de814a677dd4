"""Changes to a study server before it serves, for measuring: named in `--first` of tests/study_server.py."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from functools import partial

import app.main
from app.store.trials import vote_writer
from tests import sqlite_disk

SLOW_MS = 5.0
JUMPS_S = (0.0, 86_400.0, -86_400.0)


def slow_disk() -> None:
    """Let each sync of SQLite's log take longer."""
    sqlite_disk.install(None, partial(time.sleep, SLOW_MS / 1000))


def a_commit_each() -> None:
    """Keep one vote in a transaction."""
    vote_writer.LARGEST_BATCH = 1


def jumping_clock() -> None:
    """Set the clock wrong, right, and wrong again ten times a second."""
    vars(app.main)["utc_now"] = lambda: (
        datetime.now(UTC) + timedelta(seconds=JUMPS_S[int(10 * time.monotonic()) % len(JUMPS_S)])
    )

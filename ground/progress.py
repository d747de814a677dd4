"""How work tells of its progress."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]  # what is being done, how many are done, how many there are


def no_progress(*_told: str | int) -> None:
    """Ignore progress."""


def duration(seconds: float) -> str:
    """Say how long something takes, as people do: "80 s", "25 min", "2.0 h"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"

"""How work tells of its progress."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]  # what is being done, how many are done, how many there are


def no_progress(*_told: str | int) -> None:
    """Ignore progress."""

"""What every command prints: progress on standard error, results on standard output."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer

PLAIN_LINE_EVERY_S = 5.0

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on standard output.")]


class ProgressLine:
    """Shows how far a command is: one line that rewrites itself on a terminal, plain lines otherwise.

    An instance is a `Progress`. What is left is estimated from the time that the part so far took.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._what = ""
        self._started = self._printed = clock()
        self._already_done = 0
        self._open = False

    def __call__(self, what: str, done: int, total: int) -> None:
        now = self._clock()
        if what != self._what:
            self.close()
            self._what, self._started, self._printed = what, now, now - PLAIN_LINE_EVERY_S
            self._already_done = done
        times = self._times(now - self._started, done, total)
        if sys.stderr.isatty():
            self._rewrite(f"{what}: {done}/{total} {_bar(done, total)} {times}")
            if done >= total:
                self.close()
        elif done >= total or now - self._printed >= PLAIN_LINE_EVERY_S:
            self._printed = now
            print(f"{what}: {done}/{total} ({times})", file=sys.stderr, flush=True)

    def say(self, sentence: str) -> None:
        """Print one whole line on standard error."""
        self.close()
        print(sentence, file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line that is being rewritten."""
        if self._open:
            print(file=sys.stderr)
            self._open = False

    def _times(self, taken: float, done: int, total: int) -> str:
        counted = done - self._already_done
        if counted <= 0 or done >= total:
            return _duration(taken)
        return f"{_duration(taken)}, about {_duration(taken / counted * (total - done))} left"

    def _rewrite(self, line: str) -> None:
        print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)
        self._open = True


def print_result(result: Mapping[str, Any], sentences: str, *, as_json: bool) -> None:
    """Print a command's result: as one JSON object, or as the sentences a person reads."""
    print(json.dumps(result, default=str, allow_nan=False) if as_json else sentences, flush=True)


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _bar(done: int, total: int, width: int = 20) -> str:
    filled = width * done // max(total, 1)
    return "█" * filled + "░" * (width - filled)

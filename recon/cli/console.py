"""What every command prints: progress on standard error, results on standard output, errors as one sentence."""

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
    """Progress of one command: a line that rewrites itself on a terminal, plain lines otherwise.

    An instance is called as (what is being done, how many are done, how many there are); `note` adds what is known
    besides to every line.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, note: Callable[[], str] | None = None) -> None:
        self._clock = clock
        self._note = note
        self._what = ""
        self._started = self._printed = clock()
        self._open = False

    def __call__(self, what: str, done: int, total: int) -> None:
        now = self._clock()
        if what != self._what:
            self.close()
            self._what, self._started, self._printed = what, now, now - PLAIN_LINE_EVERY_S
        if sys.stderr.isatty():
            self._rewrite(f"{what}: {done}/{total} {_bar(done, total)} {self._time(now)}")
            if done >= total:
                self.close()
        elif done >= total or now - self._printed >= PLAIN_LINE_EVERY_S:
            self._printed = now
            print(f"{what}: {done}/{total} ({self._time(now)})", file=sys.stderr, flush=True)

    def say(self, sentence: str) -> None:
        """Print one whole line on standard error."""
        self.close()
        print(sentence, file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line that is being rewritten."""
        if self._open:
            print(file=sys.stderr)
            self._open = False

    def _time(self, now: float) -> str:
        taken = f"{now - self._started:.0f} s"
        return f"{taken}; {self._note()}" if self._note else taken

    def _rewrite(self, line: str) -> None:
        print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)
        self._open = True


def print_result(result: Mapping[str, Any], sentences: str, *, as_json: bool) -> None:
    """Print a command's result: as one JSON object, or as the sentences a person reads."""
    print(json.dumps(result, default=str, allow_nan=False) if as_json else sentences, flush=True)


def _bar(done: int, total: int, width: int = 20) -> str:
    filled = width * done // max(total, 1)
    return "█" * filled + "░" * (width - filled)

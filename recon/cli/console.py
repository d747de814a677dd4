"""What every command prints: progress on standard error, results on standard output."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import typer

from ground.progress import duration
from recon.runtime.files import write_json

PLAIN_LINE_EVERY_S = 5.0
PROGRESS_FILE = "RECONSTUDY_PROGRESS_FILE"  # names a file to which a command writes how far it is, for programs
FILE_EVERY_S = 0.5
# What of a part tells how long the rest takes: its first takes longest, as it starts processes and compiles kernels.
TELLING_SHARE, TELLING = 0.1, 20

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on standard output.")]


class ProgressLine:
    """Shows how far a command is: one line that rewrites itself on a terminal, plain lines otherwise.

    An instance is a `Progress`; where a `with` block ends, so does its line, whatever happened. What is left is
    estimated from the time that the part so far took. The file that `RECONSTUDY_PROGRESS_FILE` names, if it is set,
    is replaced by `{"step", "done", "total", "left_s"}`.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._file = Path(os.environ[PROGRESS_FILE]) if os.environ.get(PROGRESS_FILE) else None
        self._written = -FILE_EVERY_S
        self._what = ""
        self._started = self._printed = clock()
        self._already_done = 0
        self._open = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, what: str, done: int, total: int) -> None:
        now = self._clock()
        if what != self._what:
            self.close()
            self._what, self._started, self._printed = what, now, now - PLAIN_LINE_EVERY_S
            self._already_done = done
        left_s = self._left_s(now - self._started, done, total)
        self._write(now, {"step": what, "done": done, "total": total, "left_s": left_s})
        times = duration(now - self._started) + ("" if left_s is None else f", about {duration(left_s)} left")
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

    def _left_s(self, taken: float, done: int, total: int) -> float | None:
        """Estimate the seconds that are left of this part; None where nothing tells, or nothing is left."""
        counted = done - self._already_done
        is_telling = counted > 0 and counted >= min(TELLING_SHARE * (total - self._already_done), TELLING)
        return taken / counted * (total - done) if is_telling and done < total else None

    def _write(self, now: float, progress: Mapping[str, Any]) -> None:
        """Tell programs; not every time, but when a part begins or ends."""
        is_due = now - self._written >= FILE_EVERY_S or not 0 < progress["done"] < progress["total"]
        if self._file is not None and is_due:
            self._written = now
            write_json(self._file, progress)

    def _rewrite(self, line: str) -> None:
        print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)
        self._open = True


def counted(n: int, noun: str) -> str:
    """Say how many things there are: "1 frame", "2 frames"."""
    return f"{n} {noun}{'s' * (n != 1)}"


def print_result(result: Mapping[str, Any], sentences: str, *, as_json: bool) -> None:
    """Print a command's result: as one JSON object, or as the sentences a person reads."""
    print(json.dumps(result, default=str, allow_nan=False) if as_json else sentences, flush=True)


def _bar(done: int, total: int, width: int = 20) -> str:
    filled = width * done // max(total, 1)
    return "█" * filled + "░" * (width - filled)

"""What every command prints: progress on standard error, results on standard output."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import typer

from ground.progress import Pace, duration
from recon.runtime.files import write_json

PLAIN_LINE_EVERY_S = 5.0
BEAT_S = 1.0  # how often a terminal is told the time while nothing moves
PROGRESS_FILE = "RECONSTUDY_PROGRESS_FILE"  # names a file to which a command writes how far it is, for programs
FILE_EVERY_S = 0.5
CLEARED = "\r\x1b[K"  # what lets a terminal's line begin anew

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on standard output.")]


class ProgressLine:
    """Shows how far a command is: one line that rewrites itself on a terminal, plain lines otherwise.

    An instance is a `Progress`; where a `with` block ends, so does its line, whatever happened. Within one, a terminal
    is told the time while nothing moves. The file that `RECONSTUDY_PROGRESS_FILE` names,
    if it is set, is replaced by `{"step", "done", "total", "left_s"}`.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._file = Path(os.environ[PROGRESS_FILE]) if os.environ.get(PROGRESS_FILE) else None
        self._written = -FILE_EVERY_S
        self._what = ""
        self._started = self._printed = self._told = clock()
        self._pace = Pace()
        self._shown: Callable[[], str] | None = None  # the line that is being rewritten, as it reads now
        self._lock = threading.RLock()
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            threading.Thread(target=self._beat, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self.close()

    def __call__(self, what: str, done: int, total: int) -> None:
        now = self._clock()
        if what != self._what:
            self.close()
            self._what, self._started, self._printed = what, now, now - PLAIN_LINE_EVERY_S
            self._pace = Pace()
        left_s = self._pace.left_s(done, total, now)
        self._write(now, {"step": what, "done": done, "total": total, "left_s": left_s})
        if sys.stderr.isatty():
            self._rewrite(lambda: f"{what}: {done}/{total} {_bar(done, total)} {self._times(now, left_s)}")
            if done >= total:
                self.close()
        elif done >= total or now - self._printed >= PLAIN_LINE_EVERY_S:
            self._printed = now
            print(f"{what}: {done}/{total} ({self._times(now, left_s)})", file=sys.stderr, flush=True)

    def say(self, sentence: str) -> None:
        """Print one whole line on standard error."""
        with self._lock:
            self.close()
            print(sentence, file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line that is being rewritten; one that says only that something is under way goes."""
        with self._lock:
            if self._shown is not None:
                print(end=CLEARED if self._shown == self._working else "\n", file=sys.stderr, flush=True)
            self._shown, self._told = None, self._clock()

    def _beat(self) -> None:
        """Tell a terminal the time while nothing moves."""
        while not self._ended.wait(BEAT_S):
            with self._lock:
                if not self._ended.is_set():
                    self._rewrite(self._shown or self._working)

    def _working(self) -> str:
        return f"working: {duration(self._clock() - self._told)}"

    def _times(self, told: float, left_s: float | None) -> str:
        """Say how long a part has taken, and what is left of what was so when it moved last, until that has passed."""
        now = self._clock()
        still_s = -1.0 if left_s is None else left_s - (now - told)
        return duration(now - self._started) + (f", about {duration(still_s)} left" if still_s >= 0 else "")

    def _write(self, now: float, progress: Mapping[str, Any]) -> None:
        """Tell programs; not every time, but when a part begins or ends."""
        is_due = now - self._written >= FILE_EVERY_S or not 0 < progress["done"] < progress["total"]
        if self._file is not None and is_due:
            self._written = now
            write_json(self._file, progress)

    def _rewrite(self, line: Callable[[], str]) -> None:
        with self._lock:
            print(CLEARED + line(), end="", file=sys.stderr, flush=True)
            self._shown = line


def counted(n: int, noun: str) -> str:
    """Say how many things there are: "1 frame", "2 frames"."""
    return f"{n} {noun}{'s' * (n != 1)}"


def print_result(result: Mapping[str, Any], sentences: str, *, as_json: bool) -> None:
    """Print a command's result: as one JSON object, or as the sentences a person reads."""
    print(json.dumps(result, default=str, allow_nan=False) if as_json else sentences, flush=True)


def _bar(done: int, total: int, width: int = 20) -> str:
    filled = width * done // max(total, 1)
    return "█" * filled + "░" * (width - filled)

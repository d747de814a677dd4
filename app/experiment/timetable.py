"""Steps that a command takes one after another, and how long the rest of them will take."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.files import read_json, write_json

LEAST_WORK = 0.1  # share of the expected seconds below which a step's work counts as there already
TRUSTED_S = 30.0  # seconds of work at the expected pace that a first, short step has to outweigh


@dataclass(frozen=True)
class Step:
    """A part of the experiment; it makes only what is missing.

    Parameters
    ----------
    seconds : it is expected to take
    look : where to look at what it made; empty: nowhere
    """

    name: str
    seconds: float
    run: Callable[[], None]
    look: str = ""


class Timetable:
    """How far the steps are, and how long the rest will take at the pace so far.

    Parameters
    ----------
    notes : file that keeps how long each step took, over all starts the longest
    """

    def __init__(self, steps: Sequence[Step], notes: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._steps = steps
        self._notes = notes
        self._clock = clock
        self._began = self._step_began = clock()
        self._taken: list[float] = []  # seconds of each step that is done

    def run(self, say: Callable[[str], None]) -> dict[str, float]:
        """Run every step, say which one comes and what is left; seconds by name, of the start that made it."""
        kept: dict[str, float] = read_json(self._notes) if self._notes.is_file() else {}
        for number, step in enumerate(self._steps, start=1):
            self._step_began = self._clock()
            say(f"{number} of {len(self._steps)}: {step.name} ({self.left()})")
            step.run()
            self._taken.append(self._clock() - self._step_began)
            kept[step.name] = max(kept.get(step.name, 0.0), round(self._taken[-1], 1))
            write_json(self._notes, kept)
            self._step_began = self._clock()
            if step.look:
                say(f"   look at {step.look}")
        return {step.name: kept[step.name] for step in self._steps}

    def left(self) -> str:
        """For example "about 7 min to go"."""
        return f"about {duration(self.seconds_left())} to go"

    def seconds_left(self) -> float:
        """Seconds that the rest takes, if it keeps to the pace of the steps that had work to do."""
        done = len(self._taken)
        worked = [
            (taken, step.seconds)
            for taken, step in zip(self._taken, self._steps[:done], strict=True)
            if taken > LEAST_WORK * step.seconds
        ]
        expected = TRUSTED_S + sum(seconds for _, seconds in worked)
        pace = (TRUSTED_S + sum(taken for taken, _ in worked)) / expected
        now, *later = [pace * step.seconds for step in self._steps[done:]] or [0.0]
        return max(now - (self._clock() - self._step_began), 0.0) + sum(later)


def duration(seconds: float) -> str:
    """Seconds as a person says them."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"

"""How work tells of its progress, and how long the rest takes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from statistics import linear_regression

Progress = Callable[[str, int, int], None]  # what is being done, how many are done, how many there are
TELLING_SHARE, TELLING = 0.1, 20  # so much of a step, or so many, tell how long the rest takes
TELLING_TIME = 0.25  # of the first's time: what is done within it may have been made beside the first
MOST_MOMENTS = 200  # of a step that are kept; a line through half of them takes 0.1 ms


class Pace:
    """Estimates what is left of a step, from a line through when things were done in the latest half of all.

    Such a line bends little where several workers end together. The first also starts processes, loads and compiles:
    it counts as no longer than the longest since. Another step begins where less is done, or more is to be done.
    """

    def __init__(self) -> None:
        self._total = -1
        self._moments: list[tuple[int, float]] = []  # how many were done, and when, s
        self._part_s: float | None = None  # what one takes

    def left_s(self, done: int, total: int, now_s: float) -> float | None:
        """Return about how many seconds are left; None while nothing tells, or nothing is left.

        Parameters
        ----------
        done, total : how many are done, and how many there are
        now_s : the time, by a clock that only goes on
        """
        if total > self._total or done < self._moments[-1][0]:
            self._moments, self._part_s = [(done, now_s)], None
        self._total = total
        if done - self._moments[-1][0] >= max(1, (total - self._moments[0][0]) / MOST_MOMENTS):
            self._moments.append((done, now_s))
            self._part_s = self._estimated()
        return None if self._part_s is None or done >= total else self._part_s * (total - done)

    def _estimated(self) -> float | None:
        (already, began_s), (n_first, first_s), *_ = self._moments
        done, now_s = self._moments[-1]
        n_all = self._total - already
        is_telling = done > n_first and done - already >= min(TELLING_SHARE * n_all, TELLING)
        if not is_telling or now_s - first_s < TELLING_TIME * (first_s - began_s):
            return None
        longest_s = max((b_s - a_s) / (b - a) for (a, a_s), (b, b_s) in pairwise(self._moments[1:]))
        first = already, max(began_s, first_s - longest_s * (n_first - already))
        since = min(done - n_all / 2, self._moments[-2][0])
        recent = [moment for moment in (first, *self._moments[1:]) if moment[0] >= since]
        return linear_regression(*zip(*recent, strict=True)).slope


def no_progress(*_told: str | int) -> None:
    """Ignore progress."""


def duration(seconds: float) -> str:
    """Say how long something takes, as people do: "80 s", "25 min", "2.0 h"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"

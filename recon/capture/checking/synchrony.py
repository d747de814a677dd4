"""Synchrony: whether all cameras recorded the same instants.

Motion makes all cameras' pictures change at the same time; where one camera's changes come later, it is late.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.continuity import Glance, Glances
from recon.capture.recording import SensorStream

MAX_LAG = 3  # frames
MIN_FRAMES = 10  # that both cameras have at the largest lag, plus MAX_LAG
MIN_LIKE = 0.85  # correlation at the lag that is believed; cameras of a sensor reach 0.92 to 1 in the studio's scenes
MIN_MARGIN = 0.15  # above the correlation without lag


def synchrony_problems(sensors: Sequence[SensorStream], glances: Glances) -> Iterator[str]:
    """Say one sentence for every sensor whose cameras, and every two neighbours that, recorded different instants."""
    motion = {pattern: motion_signal(by_frame) for pattern, by_frame in glances.items()}
    for stream in sensors:
        late = lag([(motion.get(stream.left.image), motion.get(stream.right.image))]) if stream.right else 0
        if late:
            yield (
                f"sensor {stream.id}: its cameras are not synchronised, the right pictures are {_frames(late)} "
                "the left ones; start both by one trigger"
            )
    for first, second in pairwise(sensors):
        sides = [(a, b) for a in first.cameras for b in second.cameras]
        late = lag([(motion.get(a.image), motion.get(b.image)) for a, b in sides])
        if late:
            yield (
                f"sensors {first.id} and {second.id} are not synchronised, {second.id} is {_frames(late)} "
                f"{first.id}; start all by one trigger"
            )


def motion_signal(by_frame: Mapping[int, Glance]) -> NDArray[np.float64] | None:
    """Measure the change from frame to frame, float64 (N - 1,), grey levels; None if frames are missing."""
    frames = sorted(by_frame)
    if len(frames) < MIN_FRAMES + MAX_LAG or frames[-1] - frames[0] + 1 != len(frames):
        return None
    return np.array([np.abs(by_frame[b].thumbnail - by_frame[a].thumbnail).mean() for a, b in pairwise(frames)])


def lag(pairs: Sequence[tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]]) -> int:
    """Count the frames by which the second of every pair of signals (N - 1,) is late; 0 if nothing tells."""
    known = [(a, b) for a, b in pairs if a is not None and b is not None and min(a.std(), b.std()) > 0]
    if not known:
        return 0
    lags = range(-MAX_LAG, MAX_LAG + 1)
    likeness = {k: float(np.median([_correlation(a, b, k) for a, b in known])) for k in lags}
    best = max(likeness, key=likeness.__getitem__)
    return best if likeness[best] >= MIN_LIKE and likeness[best] - likeness[0] >= MIN_MARGIN else 0


def _correlation(a: NDArray[np.float64], b: NDArray[np.float64], late: int) -> float:
    """Correlate a with what b shows `late` frames later."""
    n = min(len(a), len(b)) - abs(late)
    first, second = a[max(0, -late) :][:n], b[max(0, late) :][:n]
    return float(np.corrcoef(first, second)[0, 1]) if min(first.std(), second.std()) > 0 else 0.0


def _frames(late: int) -> str:
    plural = "" if abs(late) == 1 else "s"
    return f"{abs(late)} frame{plural} {'behind' if late > 0 else 'ahead of'}"

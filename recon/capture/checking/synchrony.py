"""Synchrony: whether all cameras recorded the same instants.

Motion makes all cameras' pictures change at the same time; where one camera's changes come later, it is late.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.continuity import Glance, Glances
from recon.capture.checking.lag import HALF_FRAME, Lag, TangentPlanes, lag_between
from recon.capture.checking.protrusions import Seen, lag_of_protrusions
from recon.capture.checking.silhouettes import Silhouette, Silhouettes
from recon.capture.recording import SensorStream
from recon.capture.schema import Draft

MAX_LAG = 3  # frames
MIN_FRAMES = 10  # that both cameras have at the largest lag, plus MAX_LAG
MIN_LIKE = 0.85  # correlation at the lag that is believed; cameras of a sensor reach 0.92 to 1 in the studio's scenes
RESAMPLE = "write the recording anew by `capture check --resample`"
MIN_MARGIN = 0.15  # above the correlation without lag


def synchrony_problems(
    sensors: Sequence[SensorStream], glances: Glances, decided: Collection[tuple[str, str]] = ()
) -> Iterator[str]:
    """Say one sentence for every sensor whose cameras, and every two neighbours that, recorded different instants.

    Parameters
    ----------
    sensors, glances : of the capture
    decided : ids of two neighbours each, that are left out
    """
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
        if (first.id, second.id) in decided:
            continue
        late = lag([(motion.get(a.image), motion.get(b.image)) for a, b in sides])
        if late:
            yield (
                f"sensors {first.id} and {second.id} are not synchronised, {second.id} is {_frames(late)} "
                f"{first.id}; start all by one trigger"
            )


@dataclass
class SilhouetteFindings:
    """What the masks say of the instants that neighbouring sensors recorded.

    Parameters
    ----------
    problems, warnings : of lags from half a frame on; of smaller ones, and where the masks cannot tell
    decided : how late the second of two neighbours is, by their ids, of those of which they can
    """

    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    decided: dict[tuple[str, str], Lag] = field(default_factory=dict)


def silhouette_findings(draft: Draft, silhouettes: Silhouettes) -> SilhouetteFindings:
    """Say which neighbouring sensors recorded other instants, to parts of a frame, by the masks of their cameras.

    Parameters
    ----------
    draft : the capture
    silhouettes : of its masks
    """
    n_frames, findings = draft.n_frames or 0, SilhouetteFindings()
    if draft.bounds is None or len(draft.sensors) < 2:
        return findings
    if n_frames < MIN_FRAMES + MAX_LAG:
        if n_frames == 1:
            return findings
        findings.warnings.append(
            "whether the sensors recorded the same instants could not be checked, which matters if something moved: "
            f"that takes at least {MIN_FRAMES + MAX_LAG} frames, the recording has {n_frames}"
        )
        return findings
    if unmasked := [stream.id for stream in draft.sensors if not stream.mask]:
        findings.warnings.append(
            f"whether the sensors recorded the same instants could not be checked by silhouettes: {unmasked[0]} has "
            "no masks; make them by `capture segment`, then check again"
        )
        return findings
    middle = draft.bounds.mean(axis=0)
    for first, second in pairwise(draft.sensors):
        late = _lag((first, second), silhouettes, n_frames, middle)
        names = f"sensors {first.id} and {second.id}"
        if late is None or not late.is_known:
            between = "" if late is None else f" ({late.low:+z.1f} to {late.high:+z.1f} frames are possible)"
            findings.warnings.append(
                f"whether {names} recorded the same instants could not be checked: their silhouettes move too little, "
                f"are cut by the pictures' edges, or the sensors face each other{between}"
            )
            continue
        findings.decided[first.id, second.id] = late
        if late.is_late:
            side = "behind" if late.frames > 0 else "ahead of"
            likely = sorted((abs(late.low), abs(late.high)))
            least, certain, otherwise = (
                ("at least ", "where the search ends", "shift one by whole frames, then check again")
                if late.is_beyond
                else ("", f"{likely[0]:.2f} to {likely[1]:.2f} with 95 %", RESAMPLE)
            )
            sentence = (
                f"{names} are not synchronised, {second.id} is {least}{abs(late.frames):.2f} frames {side} {first.id} "
                f"by their silhouettes ({certain}); start all by one trigger, or {otherwise}"
            )
            (findings.problems if abs(late.frames) >= HALF_FRAME else findings.warnings).append(sentence)
    return findings


def _lag(
    sensors: tuple[SensorStream, SensorStream], silhouettes: Silhouettes, n_frames: int, middle: NDArray[np.float64]
) -> Lag | None:
    """Estimate the lag of two sensors by the ends of silhouettes, or where these hardly move by what stands out."""
    pairs = list(_seen_by_both(sensors, silhouettes, n_frames, middle))
    late = lag_between([(planes.tangents(*first), planes.tangents(*second)) for planes, first, second in pairs])
    if late is not None and late.is_known:
        return late
    return lag_of_protrusions(pairs) or late


def _seen_by_both(
    sensors: tuple[SensorStream, SensorStream], silhouettes: Silhouettes, n_frames: int, middle: NDArray[np.float64]
) -> Iterator[tuple[TangentPlanes, Seen, Seen]]:
    def over_time(pattern: str) -> list[Silhouette | None]:
        return [silhouettes.get(pattern, {}).get(frame) for frame in range(n_frames)]

    first, second = ([*zip(each.cameras, map(over_time, each.mask or ()), strict=True)] for each in sensors)
    for camera, its in first:
        for other, others in second:
            planes = TangentPlanes(camera.camera, other.camera, middle)
            if planes.is_usable:
                yield planes, (camera.camera, its), (other.camera, others)


def motion_signal(by_frame: Mapping[int, Glance]) -> NDArray[np.float64] | None:
    """Measure the change from frame to frame, float64 (N - 1,), grey levels; None if frames are missing."""
    frames = sorted(by_frame)
    if len(frames) < MIN_FRAMES + MAX_LAG or frames[-1] - frames[0] + 1 != len(frames):
        return None
    return np.array([np.abs(by_frame[b].thumbnail - by_frame[a].thumbnail).mean() for a, b in pairwise(frames)])


def lag(pairs: Sequence[tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]]) -> int:
    """Count the frames by which the second of every pair of signals (N - 1,) is late; 0 if nothing tells."""
    likeness = _likeness(pairs)
    if not likeness:
        return 0
    best = max(likeness, key=likeness.__getitem__)
    return best if likeness[best] >= MIN_LIKE and likeness[best] - likeness[0] >= MIN_MARGIN else 0


def would_lag_show(stream: SensorStream, glances: Glances) -> bool | None:
    """Tell whether motion would show that one camera of a pair is late; None without a pair, or with one frame."""
    by_frame = [glances.get(side.image, {}) for side in stream.cameras]
    if stream.right is None or max(map(len, by_frame)) < 2:
        return None
    left, right = map(motion_signal, by_frame)
    likeness = _likeness([(left, right)]).values()
    return bool(likeness) and max(likeness) >= MIN_LIKE and max(likeness) - min(likeness) >= MIN_MARGIN


def _likeness(pairs: Sequence[tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]]) -> dict[int, float]:
    """Correlate every pair of signals at each lag; empty if nothing moves."""
    known = [(a, b) for a, b in pairs if a is not None and b is not None and min(a.std(), b.std()) > 0]
    lags = range(-MAX_LAG, MAX_LAG + 1) if known else ()
    return {k: float(np.median([_correlation(a, b, k) for a, b in known])) for k in lags}


def _correlation(a: NDArray[np.float64], b: NDArray[np.float64], late: int) -> float:
    """Correlate a with what b shows `late` frames later."""
    n = min(len(a), len(b)) - abs(late)
    first, second = a[max(0, -late) :][:n], b[max(0, late) :][:n]
    return float(np.corrcoef(first, second)[0, 1]) if min(first.std(), second.std()) > 0 else 0.0


def _frames(late: int) -> str:
    least, plural = "at least " * (abs(late) == MAX_LAG), "" if abs(late) == 1 else "s"
    return f"{least}{abs(late)} frame{plural} {'behind' if late > 0 else 'ahead of'}"

"""By how many frames a sensor is late, from what stands out of silhouettes: hands move where heads hardly do.

Where a plane through both centres touches a silhouette locally, it touches the other camera's, too, at the same point
of the body. The angle of such a plane, followed over time, is one signal that both cameras measure.

Source: Sinha, Pollefeys, "Camera network calibration and synchronization from silhouettes in archived video", 2010.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from recon.capture.checking.lag import (
    LARGEST_FRAMES,
    Lag,
    TangentPlanes,
    lags_to,
    likeliest_lag,
    log_likelihood,
    spread_by_lag,
)
from recon.capture.checking.silhouettes import Silhouette
from recon.geometry.rig import Camera

PROMINENCE_PX = 3.0  # by which a protrusion stands out
SHORTEST_OUTLINE = 30  # pixels
BESIDE = 4  # outline pixels from a protrusion's tip, at which its sides are looked at; their mean is where it is
LONGEST_JUMP_PX = 8.0  # of a tip from where it was expected
SHORTEST_TRACK, LEAST_OVERLAP = 9, 8  # frames
LEAST_MOTION_PX = 1.0  # standard deviation
FARTHEST_PX = 12.0  # between the medians of two tracks that may show one tip
WORST_FIT_PX, LEAST_CONTRAST = 0.6, 2.5  # root mean square at the best lag; motion as a multiple of it
UNSEEN_PX = 0.8  # as which a lag counts at which two tracks hardly overlap, or as the nearest at which they do
FEWEST_LAGS = 60  # at which they overlap
FEWEST_PAIRS = 2  # of tracks that fit; one may be chance
MOST_TRACKS = 24  # the longest of each camera

LAGS = lags_to(LARGEST_FRAMES)


@dataclass
class _Track:
    """A tip over time: its sense (1 highest, -1 lowest), where it was last and how it moves, and angles in pixels."""

    sense: int
    place: NDArray[np.float64]
    motion: NDArray[np.float64]
    frame: int
    angles: dict[int, float] = field(default_factory=dict)

    def signal(self, n_frames: int) -> NDArray[np.float64]:
        """Return its angles (N,), NaN where it was not seen."""
        signal = np.full(n_frames, np.nan)
        signal[list(self.angles)] = list(self.angles.values())
        return signal


Seen = tuple[Camera, Sequence[Silhouette | None]]
"""A camera and its silhouettes, None for what is not known."""


def lag_of_protrusions(pairs: Sequence[tuple[TangentPlanes, Seen, Seen]]) -> Lag | None:
    """Estimate the lag of one sensor behind another from what stands out of its silhouettes; None if too little does.

    Parameters
    ----------
    pairs : the planes through a camera of the first and one of the second sensor, and both with their silhouettes
    """
    fits = [fit for planes, first, second in pairs for fit in _fits(_tracks(planes, first), _tracks(planes, second))]
    if len(fits) < FEWEST_PAIRS:
        return None
    return likeliest_lag(LAGS, np.sum(fits, axis=0))


def _fits(first: list[NDArray[np.float64]], second: list[NDArray[np.float64]]) -> Iterator[NDArray[np.float64]]:
    """Yield the log-likelihood of each lag by every two tracks that show one tip."""
    for a, b in product(first, second):
        if a[0] == b[0] and abs(np.nanmedian(a[1:]) - np.nanmedian(b[1:])) <= FARTHEST_PX:
            fit = _fit(a[1:], b[1:])
            if fit is not None:
                yield fit


def _fit(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the log-likelihood of each lag (L,) by two tracks (N,), less a constant; None if they do not fit."""
    spread, counts = spread_by_lag(first, second, LAGS, fewest=LEAST_OVERLAP)
    is_known = np.isfinite(spread)
    if not is_known[len(LAGS) // 2] or is_known.sum() < FEWEST_LAGS:
        return None
    best = float(np.sqrt(np.nanmin(spread)))
    if best > WORST_FIT_PX or min(np.nanstd(first), np.nanstd(second)) < LEAST_CONTRAST * best:
        return None
    nearest = np.interp(LAGS, LAGS[is_known], spread[is_known])
    spread = np.where(is_known, spread, np.maximum(nearest, UNSEEN_PX**2))
    return log_likelihood(spread, int(counts[is_known].min()), 1.0)


def _tracks(planes: TangentPlanes, seen: Seen) -> list[NDArray[np.float64]]:
    """Follow what stands out of a camera's silhouettes: of each tip that moves, its sense and angles, (1 + N,)."""
    camera, silhouettes = seen
    live: list[_Track] = []
    ended: list[_Track] = []
    for frame, shape in enumerate(silhouettes):
        tips = [] if shape is None else list(_tips(planes, camera, shape))
        for track in live:
            expected = track.place + track.motion
            ways = [np.hypot(*(tip[2] - expected)) if tip[0] == track.sense else np.inf for tip in tips]
            if ways and min(ways) < LONGEST_JUMP_PX:
                _, angle, place = tips.pop(int(np.argmin(ways)))
                track.motion, track.place, track.frame = place - track.place, place, frame
                track.angles[frame] = angle
        live += [_Track(sense, place, np.zeros(2), frame, {frame: angle}) for sense, angle, place in tips]
        ended += [track for track in live if track.frame < frame - 1]
        live = [track for track in live if track.frame >= frame - 1]
    kept = [track for track in (*ended, *live) if len(track.angles) >= SHORTEST_TRACK]
    moving = [track for track in kept if np.std(list(track.angles.values())) >= LEAST_MOTION_PX]
    longest = sorted(moving, key=lambda track: -len(track.angles))[:MOST_TRACKS]
    return [np.append(track.sense, track.signal(len(silhouettes))) for track in longest]


def _tips(
    planes: TangentPlanes, camera: Camera, silhouette: Silhouette
) -> Iterator[tuple[int, float, NDArray[np.float64]]]:
    """Yield the sense, the angle in pixels and the place of all that stands out of a silhouette, within the picture."""
    pixels = silhouette.outline.astype(np.float64)
    steps = np.abs(np.diff(pixels, axis=0)).max(axis=1, initial=0.0)
    for outline in np.split(pixels, np.flatnonzero(steps > 1) + 1):
        if len(outline) < SHORTEST_OUTLINE:
            continue
        angles, n = planes.angles(camera, outline) * float(camera.K[0, 0]), len(outline)
        x, y = (outline - outline.mean(axis=0)).T
        turning = np.sign(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))  # the way around it
        for sense in (1, -1):
            peaks, _ = find_peaks(np.tile(sense * angles, 3), prominence=PROMINENCE_PX)
            for tip in peaks[(peaks >= n) & (peaks < 2 * n)] - n:
                before, after = outline[tip] - outline[tip - BESIDE], outline[(tip + BESIDE) % n] - outline[tip]
                is_inside = ((outline[tip] > 0) & (outline[tip] < np.array(silhouette.size) - 1)).all()
                if is_inside and turning * (before[0] * after[1] - before[1] * after[0]) >= 0:  # a dent is no tip
                    yield sense, float(angles[np.arange(tip - BESIDE, tip + BESIDE + 1) % n].mean()), outline[tip]

"""By how many frames, and parts of one, a sensor is late: from what silhouettes of two cameras must have in common.

A plane through both centres that touches the object touches both silhouettes. Its angle about the baseline, followed
over time, is one signal that both cameras measure; where one is late, its signal is.

Source: Sinha, Pollefeys, "Synchronization and calibration of camera networks from silhouettes", ICPR 2004.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, median_filter

from recon.capture.checking.silhouettes import Silhouette
from recon.capture.rectify import viewing_directions
from recon.geometry.rig import Camera

LARGEST_FRAMES = 3.5  # that are searched, of recordings that are so much longer than the fewest frames
STEP = 0.025  # frames
FEWEST_FRAMES = 10
NEAREST_TO_BASELINE = 0.4  # sine of the angle between the baseline and the way to the object; below, planes graze it
HALF_FRAME = 0.5  # of lag; more spoils fusion, less costs accuracy
LEAST_EVIDENCE = 2.0  # as of the interval: twice that is chi-square with one degree of freedom
LEAST_FRAMES = 0.2  # that matter
CORRELATED = 6.0  # residuals of neighbouring frames, and of both cameras of a sensor, are alike: as many count as one
NOISE_PX = 0.25  # of a tangent; what fits better is chance
AT_A_TIP = 9  # outline pixels, whose mean is where a plane touches: of one, whole pixels make whole lags likely
SMALL_MOTION_PX = 0.5  # standard deviation of a signal; below, it tells nothing


@dataclass(frozen=True)
class Lag:
    """By how many frames the second of two sensors is behind the first.

    Parameters
    ----------
    low, high : between which it lies with 95 %, as far as the search goes
    evidence : how much more likely it is than none, natural logarithm
    is_beyond : whether it is where the search ends, and may be more
    """

    frames: float
    low: float
    high: float
    evidence: float
    is_beyond: bool = False

    def __str__(self) -> str:
        """Say it with its interval."""
        if self.is_beyond:
            return f"{self.frames:.2f} frames or more, as far as the search goes,"
        return f"{self.frames:.2f} frames ({self.low:.2f} to {self.high:.2f} with 95 %)"

    @property
    def is_known(self) -> bool:
        """True if the sensors are certain to be late, or certain to be less than half a frame apart."""
        return self.is_late or max(-self.low, self.high) < HALF_FRAME

    @property
    def is_late(self) -> bool:
        """True if the sensors did not record the same instants."""
        return self.evidence >= LEAST_EVIDENCE and abs(self.frames) >= LEAST_FRAMES


@dataclass(frozen=True, eq=False)
class Tangents:
    """Where the planes through two cameras touch the silhouettes of one, over time.

    Parameters
    ----------
    angles : float64 (N, 2), radians, the lowest and the highest of each frame; NaN where the picture's edge cuts them
    pixel : radians that a pixel spans
    """

    angles: NDArray[np.float64]
    pixel: float


class TangentPlanes:
    """The planes through the centres of two cameras, by their angle about the way from one to the other.

    Parameters
    ----------
    first, second : cameras of two sensors
    towards : float64 (3,), mm, a point in the middle of the object, which has the angle zero
    """

    def __init__(self, first: Camera, second: Camera, towards: NDArray[np.float64]) -> None:
        between = second.centre - first.centre
        baseline = between / max(float(np.linalg.norm(between)), 1e-9)
        ways = [towards - camera.centre for camera in (first, second)]
        across = ways[0] - baseline * (ways[0] @ baseline)
        self.is_usable = all(
            float(np.linalg.norm(np.cross(baseline, way))) > NEAREST_TO_BASELINE * float(np.linalg.norm(way))
            for way in ways
        )
        self._across = across / max(float(np.linalg.norm(across)), 1e-9)
        self._up = np.cross(baseline, self._across)

    def tangents(self, camera: Camera, silhouettes: Sequence[Silhouette | None]) -> Tangents:
        """Find the planes that touch a camera's silhouettes; None for what is not known."""
        angles = [(np.nan, np.nan) if shape is None else self._angles(camera, shape) for shape in silhouettes]
        return Tangents(np.array(angles), 1.0 / float(camera.K[0, 0]))

    def angles(self, camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angles (N,), radians, of the planes through a camera's pixels (N, 2)."""
        rays = viewing_directions(camera, pixels) @ camera.rotation
        return np.asarray(np.arctan2(rays @ self._up, rays @ self._across))

    def _angles(self, camera: Camera, silhouette: Silhouette) -> tuple[float, float]:
        """Return the lowest and the highest angle of a silhouette; NaN where the picture's edge cuts it."""
        pixels = silhouette.outline.astype(np.float64)
        if not len(pixels):
            return np.nan, np.nan
        angle = self.angles(camera, pixels)
        width, height = silhouette.size
        ends = (int(angle.argmin()), int(angle.argmax()))
        is_cut = [not (0 < pixels[end][0] < width - 1 and 0 < pixels[end][1] < height - 1) for end in ends]
        angle.sort()
        touched = angle[:AT_A_TIP].mean(), angle[-AT_A_TIP:].mean()
        low, high = (float(np.nan if cut else at) for at, cut in zip(touched, is_cut, strict=True))
        return low, high


def lag_between(pairs: Sequence[tuple[Tangents, Tangents]]) -> Lag | None:
    """Estimate the lag of one sensor behind another from the tangents of their cameras; None if nothing moves enough.

    The signals' noise is estimated with it: the profile likelihood of all of them together is maximised.

    Parameters
    ----------
    pairs : of a camera of the first and one of the second sensor, of planes through both
    """
    longer = min((len(each.angles) - FEWEST_FRAMES for pair in pairs for each in pair), default=0)
    if longer <= 0:
        return None
    largest = min(LARGEST_FRAMES, longer)
    lags = lags_to(largest)
    total = np.zeros(len(lags))
    for first, second in pairs:
        for end in (0, 1):
            signals = first.angles[:, end], second.angles[:, end]
            total += _of_tangents(*signals, max(first.pixel, second.pixel), lags)
    return likeliest_lag(lags, total) if total.any() else None


def lags_to(largest: float) -> NDArray[np.float64]:
    """Return the lags (L,) that are searched, in frames, around none, which is exactly 0."""
    n = round(largest / STEP)
    return np.arange(-n, n + 1, dtype=np.float64) * STEP


def likeliest_lag(lags: NDArray[np.float64], total: NDArray[np.float64]) -> Lag:
    """Return the lag of the highest log-likelihood, of lags (L,) around none, with those that are about as likely."""
    best = int(total.argmax())
    likely = lags[total >= total[best] - LEAST_EVIDENCE]
    evidence = float(total[best] - total[len(lags) // 2])
    is_beyond = best in (0, len(lags) - 1)
    return Lag(float(lags[best]), float(likely.min()), float(likely.max()), evidence, is_beyond)


def spread_by_lag(
    first: NDArray[np.float64], second: NDArray[np.float64], lags: NDArray[np.float64], *, fewest: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the trimmed mean square (L,) by which two signals differ at each lag, and over how many frames (L,).

    The median difference, an error of the calibration, is left out.

    Parameters
    ----------
    first, second : float64 (N,), NaN where not known
    lags : float64 (L,), frames by which the second is behind
    fewest : frames; the mean square over fewer is NaN
    """
    frames, is_seen = np.arange(len(first), dtype=np.float64), np.isfinite(second)
    places = frames + lags[:, None]  # (L, N)
    filled = np.interp(frames, frames[is_seen], second[is_seen])
    shifted = map_coordinates(filled, places[None], order=3, mode="nearest")
    near = map_coordinates(is_seen.astype(np.float64), places[None], order=1, cval=0.0)
    is_both = np.isfinite(first) & (near > 1 - 1e-6)
    counts = is_both.sum(axis=1)
    is_known = counts >= fewest
    apart = np.where(is_both, first - shifted, np.nan)[is_known]
    apart = np.abs(apart - np.nanmedian(apart, axis=1, keepdims=True))
    spread = np.full(len(lags), np.nan)
    spread[is_known] = np.nanmean(np.minimum(apart, 3 * np.nanmedian(apart, axis=1, keepdims=True)) ** 2, axis=1)
    return spread, counts


def log_likelihood(spread: NDArray[np.float64], n_frames: int, pixel: float) -> NDArray[np.float64]:
    """Return the log-likelihood of each lag (L,), less a constant.

    Parameters
    ----------
    spread : float64 (L,), mean square of the signals' difference
    n_frames : over which it was taken
    pixel : in the unit of the signals
    """
    return np.asarray(-n_frames / CORRELATED / 2 * np.log(spread + (NOISE_PX * pixel) ** 2))


def _of_tangents(
    first: NDArray[np.float64], second: NDArray[np.float64], pixel: float, lags: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the log-likelihood of each lag (L,) by two signals (N,); zeros if they tell nothing."""
    if not all(_known(signal) and _spread(signal) >= SMALL_MOTION_PX * pixel for signal in (first, second)):
        return np.zeros(len(lags))
    spread, counts = spread_by_lag(first, second, lags, fewest=FEWEST_FRAMES)
    return log_likelihood(spread, int(counts.min()), pixel) if np.isfinite(spread).all() else np.zeros(len(lags))


def _spread(signal: NDArray[np.float64]) -> float:
    """Return the standard deviation of a known signal, in which masks of single frames do not count."""
    return float(np.std(median_filter(signal[np.isfinite(signal)], 3)))


def _known(signal: NDArray[np.float64]) -> bool:
    return int(np.isfinite(signal).sum()) >= FEWEST_FRAMES

"""Measure visual acuity by an adaptive test with Landolt rings, before the trials (screening, not a diagnosis).

Each ring has a gap in one of eight directions; its size is chosen to be most informative after the answers so far. The
server chooses direction and size and marks the answer. Sizes are logMAR: the common logarithm of the gap in arc
minutes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

N_DIRECTIONS = 8  # ISO 8596
GUESSING = 1 / N_DIRECTIONS
LAPSING = 0.02  # share of wrong answers however large the ring is
SLOPE = 18.0  # of the logistic, per logMAR: from 20 to 80 % seen within 0.15 logMAR
PRIOR_MEAN, PRIOR_SD = 0.0, 0.4  # logMAR, wide: it only limits the effect of an early slip or lucky guess
THRESHOLDS = np.round(np.arange(-0.6, 1.6001, 0.01), 2)  # logMAR
LARGEST_FIRST = 1.0  # logMAR of the first ring: nearly everybody sees it
EASY_EVERY = 6  # every sixth ring is easier, which keeps people motivated
EASIER_BY = 0.3  # logMAR
FEWEST_GAP_PIXELS = 2.0  # a smaller gap is drawn by grey levels rather than by its shape
INTERVAL = 0.95
CERTAIN = 0.995  # probability of a verdict at which no more rings are shown
FEWEST_RINGS = 10  # before the test may stop by its own certainty: an early slip or lucky guess still weighs

Verdict = Literal["passed", "failed", "cannot be certified"]


@dataclass(frozen=True)
class AcuityTest:
    """Settings of an acuity test.

    Parameters
    ----------
    limit : logMAR that must be reached; larger is worse
    n_trials : number of rings at most
    smallest : logMAR of the smallest ring that this display can draw at this distance
    largest : logMAR of the largest ring that fits
    """

    limit: float = 0.0
    n_trials: int = 24
    smallest: float = -0.6
    largest: float = 1.6

    @property
    def can_certify(self) -> bool:
        """Can the display draw the ring at the limit?"""
        return self.smallest <= self.limit


@dataclass(frozen=True)
class Ring:
    """A ring: its size (logMAR), its gap's direction (0 right, then anticlockwise by 45 degrees), and the answer."""

    size: float
    gap: int
    answer: int

    @property
    def is_right(self) -> bool:
        return self.gap == self.answer


@dataclass(frozen=True)
class Acuity:
    """Result of an acuity test, in logMAR; smaller is better.

    Parameters
    ----------
    logmar : never below the smallest ring that was drawn
    low, high : ends of the 95 % interval, within the same bound
    n_trials : rings answered
    verdict : is the limit reached?
    is_bound : is the acuity this or better, because the display draws no smaller rings?
    """

    logmar: float
    low: float
    high: float
    n_trials: int
    verdict: Verdict
    is_bound: bool = False


def gap_arcmin(gap_mm: float, distance_mm: float) -> float:
    """Return the visual angle of a gap, arc minutes."""
    return 60 * math.degrees(2 * math.atan(gap_mm / (2 * distance_mm)))


def smallest_size(pixel_mm: float, distance_mm: float) -> float:
    """Return the smallest ring that a display can draw in shape, logMAR.

    Parameters
    ----------
    pixel_mm : pitch of the display's own pixels
    distance_mm : from the eye to the display
    """
    if not (0 < pixel_mm < math.inf and 0 < distance_mm < math.inf):
        raise ValueError(f"pixel {pixel_mm} mm at {distance_mm} mm: expected positive lengths")
    return math.log10(gap_arcmin(FEWEST_GAP_PIXELS * pixel_mm, distance_mm))


def gap_mm(size: float, distance_mm: float) -> float:
    """Return the gap of a ring of a size (logMAR) at a distance; the inverse of `gap_arcmin`."""
    return 2 * distance_mm * math.tan(math.radians(10**size / 60) / 2)


def certifying_distance_mm(pixel_mm: float, limit: float) -> float:
    """Return the distance from which a display can draw the ring at the limit (logMAR)."""
    return FEWEST_GAP_PIXELS * pixel_mm / gap_mm(limit, 1.0)


def probability_right(size: float | NDArray[np.float64], threshold: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the probability of a right answer to a ring, for each threshold.

    Parameters
    ----------
    size : of the ring, logMAR
    threshold : float64 (n,), logMAR

    Returns
    -------
    float64 (n,)
    """
    seen = 1 / (1 + np.exp(-SLOPE * (np.asarray(size) - threshold)))
    return np.asarray(GUESSING + (1 - GUESSING - LAPSING) * seen)


def posterior(rings: Sequence[Ring]) -> NDArray[np.float64]:
    """Return the probability of each of THRESHOLDS given the answers, with a wide prior.

    Returns
    -------
    float64 (221,), sums to 1
    """
    log_posterior = -0.5 * ((THRESHOLDS - PRIOR_MEAN) / PRIOR_SD) ** 2
    for ring in rings:
        right = probability_right(ring.size, THRESHOLDS)
        log_posterior += np.log(right if ring.is_right else 1 - right)
    weights = np.exp(log_posterior - log_posterior.max())
    return np.asarray(weights / weights.sum())


def is_over(rings: Sequence[Ring], test: AcuityTest) -> bool:
    """Has a participant seen all rings, or enough of them to know on which side of the limit the acuity lies?

    A display that cannot draw the ring at the limit cannot decide, so there all rings are shown.
    """
    if len(rings) >= test.n_trials:
        return True
    if len(rings) < FEWEST_RINGS:
        return False
    reached = float(posterior(rings)[test.limit >= THRESHOLDS].sum())
    return test.can_certify and not 1 - CERTAIN < reached < CERTAIN


def next_size(rings: Sequence[Ring], test: AcuityTest) -> float | None:
    """Return the size of the next ring, logMAR: the most probable threshold so far; None when the test is over.

    Source
    ------
    Lieberman and Pentland 1982 (Best-PEST); Bach 1996. Unlike theirs, the maximum is a posteriori: see `posterior`.
    """
    if is_over(rings, test):
        return None
    if not rings:
        return min(max(LARGEST_FIRST, test.smallest), max(test.largest, test.smallest))
    size = float(THRESHOLDS[int(np.argmax(posterior(rings)))])
    if len(rings) % EASY_EVERY == EASY_EVERY - 1:
        size += EASIER_BY
    return round(max(min(size, test.largest), test.smallest), 3)


def judge(rings: Sequence[Ring], test: AcuityTest) -> Acuity:
    """Return the acuity estimated from the answers, and whether the limit is reached.

    A display that cannot draw the ring at the limit never yields a pass; it may still show that a participant
    fails. Below the smallest ring nothing was seen, so nothing is extrapolated: the result is that bound.

    Raises
    ------
    ValueError
        If the test is not over.
    """
    if not is_over(rings, test):
        raise ValueError(f"{len(rings)} of {test.n_trials} rings answered; the test is not over")
    probability = posterior(rings)
    logmar = round(float(THRESHOLDS @ probability), 3)  # as it is told beside the limit
    cumulative = np.cumsum(probability)
    tail = (1 - INTERVAL) / 2
    low, high = (float(THRESHOLDS[np.searchsorted(cumulative, share)]) for share in (tail, 1 - tail))
    verdict: Verdict = "passed" if logmar <= test.limit else "failed"
    if not test.can_certify and low <= test.smallest:
        verdict = "cannot be certified"
    smallest = round(test.smallest, 3)
    return Acuity(
        logmar=max(logmar, smallest),
        low=max(low, smallest),
        high=max(high, smallest),
        n_trials=len(rings),
        verdict=verdict,
        is_bound=logmar < test.smallest,
    )

"""Simulate a person who takes the screening by looking at its pictures, with a known acuity and colour vision."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.study.screening.acuity import LAPSING, N_DIRECTIONS, probability_right
from app.study.screening.colour_vision import AXES, CONE_OF, DIRECTIONS, NOTHING, Axis, cone_signals, is_on_ring

GROUND = 128  # grey level between the dots
VISIBLE = 0.6  # least difference of ring and ground that is noticed, in standard deviations of the dots
STEP = 4  # pixels between the places of a plate that are looked at


@dataclass(frozen=True)
class Observer:
    """What an artificial person sees.

    Parameters
    ----------
    acuity : logMAR; smaller is better
    lacks : the axis whose cone is missing; None: normal colour vision
    slips : share of plates that are answered by a slip of the finger
    """

    acuity: float = -0.1
    lacks: Axis | None = None
    slips: float = LAPSING

    def answer_ring(self, picture: NDArray[np.uint8], size: float, rng: np.random.Generator) -> int:
        """Return the direction that is seen or guessed.

        Parameters
        ----------
        picture : uint8 (H, H), grey levels
        size : logMAR of the gap
        """
        seen = gap_of_ring(picture)
        if rng.random() < float(probability_right(size, np.array([self.acuity]))[0]):
            return seen
        return (seen + int(rng.integers(1, N_DIRECTIONS))) % N_DIRECTIONS

    def answer_plate(self, picture: NDArray[np.uint8], rng: np.random.Generator) -> int:
        """Return the direction of the gap, or NOTHING where no ring stands out; sometimes a slip.

        Parameters
        ----------
        picture : uint8 (H, W, 3), sRGB
        """
        if rng.random() < self.slips:
            return int(rng.choice(DIRECTIONS))
        place, features = self._look(picture)
        contrast = {gap: _contrast(features, is_on_ring(place, len(picture), gap)) for gap in DIRECTIONS}
        best = max(DIRECTIONS, key=contrast.__getitem__)
        return best if contrast[best] >= VISIBLE else NOTHING

    def _look(self, picture: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return places (N, 2) of a plate's dots, and lightness and ratios of the cones there (N, K)."""
        seen = picture[::STEP, ::STEP]
        rows, columns = np.nonzero(np.any(seen != GROUND, axis=-1))
        cones = np.log(cone_signals(seen[rows, columns]) + 1e-6)  # (N, 3)
        if self.lacks is not None:
            cones = np.delete(cones, CONE_OF[self.lacks], axis=1)
        lightness = cones[:, :-1].mean(axis=1) if self.lacks != AXES[2] else cones.mean(axis=1)
        features: NDArray[np.float64] = np.column_stack([lightness, np.diff(cones, axis=1)])
        places: NDArray[np.float64] = STEP * np.column_stack([columns, rows]).astype(np.float64)
        return places, features


def gap_of_ring(picture: NDArray[np.uint8]) -> int:
    """Find the gap of a ring, uint8 (H, H): opposite of the side to which its ink leans."""
    ink = 255.0 - picture
    at = np.arange(len(picture)) - (len(picture) - 1) / 2
    x, y = float((ink * at[None, :]).sum()), -float((ink * at[:, None]).sum())
    return round(math.atan2(-y, -x) / (math.pi / 4)) % N_DIRECTIONS


def _contrast(features: NDArray[np.float64], is_ring: NDArray[np.bool_]) -> float:
    """Return the largest difference between ring and rest over the features, in standard deviations within each."""
    ring, rest = features[is_ring], features[~is_ring]
    spread = np.sqrt((ring.var(axis=0) + rest.var(axis=0)) / 2)
    return float(np.max(np.abs(ring.mean(axis=0) - rest.mean(axis=0)) / spread))

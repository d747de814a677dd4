"""Simulate ratings: the quality of what participants see, with a bias and an inconsistency of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BIAS_SPREAD = 0.4  # standard deviation over participants, natural log-odds
MEDIAN_INCONSISTENCY = 0.6  # standard deviation of a participant's repeated ratings, natural log-odds
INCONSISTENCY_SPREAD = 0.3  # of its logarithm over participants
LOG_ODDS_OF_SCALE = 4.0  # between the ends of a scale


@dataclass(frozen=True)
class Rater:
    """How a participant rates.

    Parameters
    ----------
    bias : added to every rating, natural log-odds
    inconsistency : standard deviation of repeated ratings, natural log-odds
    """

    bias: float
    inconsistency: float

    def rate(self, quality: float, low: int, high: int, rng: np.random.Generator) -> int:
        """Return a whole number on a scale.

        Parameters
        ----------
        quality : natural log-odds, 0 in the middle of the scale
        low, high : worst and best rating
        rng : Generator
        """
        perceived = quality + self.bias + self.inconsistency * rng.standard_normal()
        rating = (low + high) / 2 + perceived * (high - low) / LOG_ODDS_OF_SCALE
        return int(np.clip(np.rint(rating), low, high))


def draw_rater(rng: np.random.Generator) -> Rater:
    """Draw a participant at random."""
    inconsistency = MEDIAN_INCONSISTENCY * float(np.exp(INCONSISTENCY_SPREAD * rng.standard_normal()))
    return Rater(BIAS_SPREAD * float(rng.standard_normal()), inconsistency)

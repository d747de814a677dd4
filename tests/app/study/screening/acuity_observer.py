"""Artificial people who look at rings."""

from __future__ import annotations

import numpy as np

from app.study.screening.acuity import N_DIRECTIONS, AcuityTest, Ring, next_size, probability_right


def simulate_test(threshold: float, test: AcuityTest, rng: np.random.Generator) -> list[Ring]:
    """The answers of an artificial person with a known threshold (logMAR), who guesses what is not seen."""
    looks: list[Ring] = []
    while (size := next_size(looks, test)) is not None:
        gap = int(rng.integers(N_DIRECTIONS))
        is_right = rng.random() < float(probability_right(size, np.array([threshold]))[0])
        wrong = (gap + int(rng.integers(1, N_DIRECTIONS))) % N_DIRECTIONS
        looks.append(Ring(size, gap, gap if is_right else wrong))
    return looks

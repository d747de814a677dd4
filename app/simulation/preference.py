"""Simulate choices by Davidson's model with known abilities."""

from __future__ import annotations

import math

import numpy as np

from app.study.trial.valid_vote import Choice


def tie_weight(tie_rate: float) -> float:
    """Return Davidson's nu for which two equal items tie with probability `tie_rate`.

    Source
    ------
    Davidson 1970, eq. 2.2: for equal abilities P(tie) = nu / (2 + nu).
    """
    if not 0 <= tie_rate < 1:
        raise ValueError(f"tie rate {tie_rate}: expected at least 0 and less than 1")
    return 2 * tie_rate / (1 - tie_rate)


def choice_probabilities(ability_a: float, ability_b: float, tie_rate: float) -> tuple[float, float, float]:
    """Return the probabilities of (a, b, none), proportional to (exp a, exp b, nu exp((a + b) / 2)).

    Parameters
    ----------
    ability_a, ability_b : natural log-odds
    tie_rate : probability of a tie between equals

    Source
    ------
    Davidson 1970, eq. 2.2.
    """
    half = (ability_a - ability_b) / 2
    log_weights = (half, -half, math.log(nu) if (nu := tie_weight(tie_rate)) > 0 else -math.inf)
    largest = max(log_weights)
    weights = [math.exp(w - largest) for w in log_weights]  # cannot overflow, however far the abilities are apart
    total = sum(weights)
    return weights[0] / total, weights[1] / total, weights[2] / total


def choose(ability_a: float, ability_b: float, tie_rate: float, rng: np.random.Generator) -> Choice:
    """Draw one choice between two items."""
    p_a, p_b, _ = choice_probabilities(ability_a, ability_b, tie_rate)
    draw = rng.random()
    if draw < p_a:
        return "a"
    return "b" if draw < p_a + p_b else "none"

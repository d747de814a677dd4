"""Subpixel disparities: the vertex of a parabola through three costs."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

MAX_OFFSET = 0.4999  # pixels from a winner to its parabola's vertex: the vertex rounds to the winner


@njit(inline="always")
def vertex(costs: NDArray[np.float32], lane: int) -> np.float32:
    """Return the vertex of the parabola through costs, float32 (n,), at a lane and its two neighbours.

    In pixels from the lane, less than a half.
    """
    before, here, after = costs[lane - 1], costs[lane], costs[lane + 1]
    bend = before - np.float32(2) * here + after
    if bend <= 0:
        return np.float32(0)
    offset = np.float32(0.5) * (before - after) / bend
    return min(max(offset, np.float32(-MAX_OFFSET)), np.float32(MAX_OFFSET))

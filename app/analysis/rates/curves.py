"""Curves of methods over the size of their models: which condition belongs to which, the best ones, and their distance.

A method is all that a condition's factors say but for a factor whose levels are all numbers, such as a share of pruned
splats: this one says where on its method's curve a condition stands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import number
from app.analysis.reading.votes_table import VotesError

Array = NDArray[np.float64]
BYTES = "bytes"  # the measure that is a model's size
Factors = Mapping[str, Mapping[str, str]]  # factor -> item -> level

FEWEST_LEVELS = 2  # of a curve, and of a factor of numbers


class Curve(NamedTuple):
    """A method's conditions from the smallest to the largest: places among the items, and their sizes' logarithms."""

    items: NDArray[np.intp]
    logs: Array


def numeric_factor(factors: Factors) -> str | None:
    """Return the only factor whose levels are all numbers, None where there is none, or several."""
    numeric = [factor for factor, levels in factors.items() if _are_numbers(list(levels.values()))]
    return numeric[0] if len(numeric) == 1 else None


def method_of(item: str, factors: Factors, numeric: str | None) -> str:
    """Return the method of a condition: its levels of all factors but the one of numbers, else its own name.

    Parameters
    ----------
    item : the condition
    factors : of all
    numeric : the factor of numbers
    """
    if numeric is None or item not in factors[numeric]:
        return item
    levels = [levels[item] for factor, levels in factors.items() if factor != numeric and item in levels]
    return " ".join(levels) or "all"


def level_of(item: str, factors: Factors, numeric: str | None) -> float | None:
    """Return a condition's level of the factor of numbers, None where it has none.

    Parameters
    ----------
    item, factors, numeric : as in `method_of`
    """
    return float(number(factors[numeric][item])) if numeric is not None and item in factors[numeric] else None


def best_at_their_size(sizes: Sequence[float], scores: Sequence[float]) -> list[bool]:
    """Tell which conditions lie on the Pareto front: no other is as small and scores as high, and one of them better.

    Parameters
    ----------
    sizes : bytes, one for each condition
    scores : in their unit
    """
    pairs = list(zip(sizes, scores, strict=True))
    return [not any(s <= size and q >= score and (s < size or q > score) for s, q in pairs) for size, score in pairs]


def curve_of(items: Sequence[int], sizes: Sequence[float]) -> Curve | None:
    """Return the curve of a method's conditions, None where there are less than two sizes, or one of two conditions.

    Parameters
    ----------
    items : places of its conditions among all
    sizes : bytes, of all
    """
    places = np.array(sorted(items, key=lambda place: sizes[place]), np.intp)
    logs = np.log(np.array(sizes, np.float64)[places])
    return Curve(places, logs) if len(np.unique(logs)) >= FEWEST_LEVELS and len(np.unique(logs)) == len(logs) else None


def difference_weights(first: Curve, second: Curve, n_items: int) -> tuple[Array, float, float] | None:
    """Return by how much each item's score counts in the mean difference of two curves over the sizes that both have.

    Between its conditions a curve is straight over the logarithm of the size, so that the mean is linear in the
    scores, and its error follows from theirs. Bjontegaard's cubics would follow the noise of four scores.

    Parameters
    ----------
    first, second : the curves; the difference is the first less the second
    n_items : length of the weights

    Returns
    -------
    weights float64 (n_items,), and the lowest and highest size in common, bytes; None where they have none in common

    Source
    ------
    Bjontegaard (2001), "Calculation of average PSNR differences between RD-curves", VCEG-M33; with scores for PSNR.
    """
    low, high = max(first.logs[0], second.logs[0]), min(first.logs[-1], second.logs[-1])
    if not high > low:
        return None
    weights = np.zeros(n_items)
    for curve, sign in ((first, 1.0), (second, -1.0)):
        np.add.at(weights, curve.items, sign * _mean_weights(curve.logs, low, high))
    return weights, float(np.exp(low)), float(np.exp(high))


def _mean_weights(knots: Array, low: float, high: float) -> Array:
    """Return how much the value at each knot counts in the mean of the line through all of them from low to high."""
    corners = np.unique(np.concatenate([[low, high], knots[(knots > low) & (knots < high)]]))
    unit = np.eye(len(knots))
    at_corners = np.array([np.interp(corners, knots, row) for row in unit])  # (K, C)
    steps = np.diff(corners)
    return np.asarray(((at_corners[:, :-1] + at_corners[:, 1:]) / 2) @ steps / (high - low))


def _are_numbers(levels: Sequence[str]) -> bool:
    try:
        return len({number(level) for level in levels}) >= FEWEST_LEVELS
    except (ValueError, VotesError):
        return False

"""Pair a measure's values with the scores: the points of a comparison, on a dataset or over several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from app.analysis.model.contrasts import SIGNIFICANT, Contrast

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

FEWEST_OF_A_DATASET = 2  # points
ROUNDING = 1e-12  # of the largest value; differences that are closer are equal but for rounding errors


@dataclass(frozen=True)
class ScoreSet:
    """Scores of a dataset.

    Parameters
    ----------
    items : names
    scores : float64 (n,), log-odds of pair comparisons, or grades of ratings
    half_widths : float64 (n,), in the same unit, of the scores' 95 % intervals; NaN where there are none
    different : pairs of indices of items that differ significantly, the better first
    similar : the other pairs that were tested
    """

    items: tuple[str, ...]
    scores: Array
    half_widths: Array
    different: Sequence[tuple[int, int]] = ()
    similar: Sequence[tuple[int, int]] = ()


def score_set(
    items: tuple[str, ...], scores: Array, half_widths: Array, contrasts: Sequence[Contrast] = ()
) -> ScoreSet:
    """Return the scores of a dataset with the pairs of items that were tested.

    Parameters
    ----------
    items, scores, half_widths : as in `ScoreSet`
    contrasts : of the pairs that were tested
    """
    place = {item: index for index, item in enumerate(items)}
    different: list[tuple[int, int]] = []
    similar: list[tuple[int, int]] = []
    for contrast in contrasts:
        a, b = place[contrast.item_a], place[contrast.item_b]
        better_first = (a, b) if contrast.difference > 0 else (b, a)
        (different if contrast.p_holm < SIGNIFICANT else similar).append(better_first)
    return ScoreSet(items, scores, half_widths, different, similar)


@dataclass(frozen=True)
class Points:
    """A measure and the scores, point by point: a point is a condition on a dataset.

    Parameters
    ----------
    values : float64 (N,), of the measure
    scores : float64 (N,), in the unit of their sets
    half_widths : float64 (N,), in the same unit, of the scores' 95 % intervals; NaN where there are none
    dataset, condition : intp (N,), which of each a point belongs to
    different : intp (M, 2), points of one dataset that differ significantly, the better first
    similar : intp (S, 2), points of one dataset that were tested and do not
    """

    values: Array
    scores: Array
    half_widths: Array
    dataset: Indices
    condition: Indices
    different: Indices
    similar: Indices

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def key(self) -> bytes:
        """Which conditions of which datasets these are, to tell whether two measures have the same points."""
        return self.dataset.tobytes() + self.condition.tobytes()

    @cached_property
    def n_conditions(self) -> int:
        """Number of different conditions."""
        return len(np.unique(self.condition))

    def where(self, is_kept: NDArray[np.bool_]) -> Points:
        """Return the points to keep, bool (N,), with the pairs among them."""
        place = np.cumsum(is_kept) - 1
        different, similar = (place[pairs[is_kept[pairs].all(axis=1)]] for pairs in (self.different, self.similar))
        return Points(
            self.values[is_kept],
            self.scores[is_kept],
            self.half_widths[is_kept],
            self.dataset[is_kept],
            self.condition[is_kept],
            different,
            similar,
        )

    @cached_property
    def relative_values(self) -> Array:
        """Values relative to their dataset's mean, float64 (N,)."""
        return _relative(self.values, self.dataset)

    @cached_property
    def relative_scores(self) -> Array:
        """Scores relative to their dataset's mean, float64 (N,), in their unit: datasets have no common zero."""
        return _relative(self.scores, self.dataset)


def matched(score_sets: Mapping[str, ScoreSet], values: Mapping[str, Mapping[str, float]]) -> Points:
    """Return the points that have a score and a value, datasets in order; a single point of a dataset is left out,
    because relative to its dataset's mean it says nothing.

    Parameters
    ----------
    score_sets : dataset -> scores
    values : dataset -> item -> value
    """
    conditions = {item: None for score_set in score_sets.values() for item in score_set.items}
    place = {item: index for index, item in enumerate(conditions)}
    rows: list[tuple[float, float, float, int, int]] = []
    different: list[tuple[int, int]] = []
    similar: list[tuple[int, int]] = []
    for number, (dataset, score_set) in enumerate(score_sets.items()):
        known = values.get(dataset, {})
        if len(known.keys() & set(score_set.items)) < FEWEST_OF_A_DATASET:
            continue
        point = {}
        for index, item in enumerate(score_set.items):
            if item in known:
                point[index] = len(rows)
                score, half = float(score_set.scores[index]), float(score_set.half_widths[index])
                rows.append((known[item], score, half, number, place[item]))
        different += [(point[a], point[b]) for a, b in score_set.different if a in point and b in point]
        similar += [(point[a], point[b]) for a, b in score_set.similar if a in point and b in point]
    measured, scores, half_widths, datasets, places = zip(*rows, strict=True) if rows else [()] * 5
    return Points(
        np.array(measured, float),
        np.array(scores, float),
        np.array(half_widths, float),
        np.array(datasets, np.intp),
        np.array(places, np.intp),
        np.array(different, np.intp).reshape(-1, 2),
        np.array(similar, np.intp).reshape(-1, 2),
    )


def _relative(values: Array, dataset: Indices) -> Array:
    """Subtract each dataset's mean; equal values become exactly zero."""
    _, first, number = np.unique(dataset, return_index=True, return_inverse=True)
    shifted = values - values[first][number]
    means = np.bincount(number, shifted) / np.bincount(number)
    return without_noise(shifted - means[number], values)


def without_noise(differences: Array, values: Array) -> Array:
    """Return differences of values with rounding errors taken off, so that ranks take equal ones for equal."""
    step = ROUNDING * float(np.abs(values).max(initial=0.0)) or 1.0
    return np.asarray(np.round(differences / step) * step)

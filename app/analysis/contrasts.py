"""Which items differ: all pairwise contrasts of scores with one error rate, and letters that show the result at a
glance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from app.analysis.bradley_terry import Fit

Array = NDArray[np.float64]

MOST_ITEMS = 40  # 780 contrasts
SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Contrast:
    """The difference of two scores.

    Parameters
    ----------
    difference, se : float
        Log-odds; the error is clustered by participant where they are known.
    p_value, p_holm : float
        Two-sided, by itself and corrected for all contrasts of this fit.
    """

    item_a: str
    item_b: str
    difference: float
    se: float
    p_value: float
    p_holm: float


def contrasts(fit: Fit) -> list[Contrast]:
    """Compare every item with every other; empty without a finite maximum, without errors, or with too many items."""
    covariance = fit.covariance if fit.participant_covariance is None else fit.participant_covariance
    n = len(fit.items)
    if fit.status != "ok" or n > MOST_ITEMS or covariance is None or fit.scores is None:
        return []
    first, second = np.triu_indices(n, 1)
    variance = np.diag(covariance)[:n]
    difference = fit.scores[first] - fit.scores[second]
    se = np.sqrt(np.maximum(variance[first] + variance[second] - 2 * covariance[first, second], np.finfo(float).tiny))
    p_values = two_sided(difference / se, None if fit.participant_covariance is None else fit.n_participants)
    columns = difference.tolist(), se.tolist(), p_values.tolist(), holm(p_values).tolist()
    names = [(fit.items[a], fit.items[b]) for a, b in zip(first, second, strict=True)]
    return [Contrast(a, b, *numbers) for (a, b), *numbers in zip(names, *columns, strict=True)]


def two_sided(ratio: Array, n_participants: int | None) -> Array:
    """Return two-sided p-values of estimates in units of their errors, from t(J - 1) or the normal distribution."""
    tail = norm.sf(np.abs(ratio)) if n_participants is None else student.sf(np.abs(ratio), n_participants - 1)
    return np.asarray(2 * tail)


def holm(p_values: Array) -> Array:
    """Return p-values corrected for their number.

    Source: Holm (1979).
    """
    order = np.argsort(p_values)
    stepped = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    result = np.empty_like(p_values)
    result[order] = np.minimum(stepped, 1.0)
    return result


def letters(items: Sequence[str], found: Sequence[Contrast], level: float = SIGNIFICANT) -> dict[str, str]:
    """Return letters so that two items share one if and only if they do not differ significantly.

    Parameters
    ----------
    items : sequence of str
        In the order in which letters are given out, the best first.
    found : sequence of Contrast
        Of all pairs.

    Source
    ------
    Piepho (2004), insert and absorb: start with one group of all; every significant pair splits the groups that hold
    both.
    """
    groups = [frozenset(items)]
    for contrast in found:
        if contrast.p_holm < level:
            apart = {contrast.item_a, contrast.item_b}
            split = [group - {item} if apart <= group else group for group in groups for item in apart]
            groups = _absorbed(split)
    rank = {item: place for place, item in enumerate(items)}
    groups.sort(key=lambda group: sorted(rank[item] for item in group))
    return {item: "".join(_letter(place) for place, group in enumerate(groups) if item in group) for item in items}


def _absorbed(groups: Sequence[frozenset[str]]) -> list[frozenset[str]]:
    """Drop groups that are part of another."""
    different = list(dict.fromkeys(groups))
    return [group for group in different if not any(group < other for other in different)]


def _letter(place: int) -> str:
    return chr(ord("a") + place) if place < 26 else f"({place})"

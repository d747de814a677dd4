"""Name participants whose ratings differ from the others': suggestions, which the analysis never acts upon.

The rules of the recommendations name many honest people where conditions look alike; who is unlike the others is told
by how far the others agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from app.analysis.ratings.opinion_scores import person_means
from app.analysis.ratings.table import RatingTable
from app.analysis.screening.correlation import defined, pearson

Array = NDArray[np.float64]

# ITU-R BT.500, screening of the observers
NORMAL_KURTOSIS = (2.0, 4.0)
NORMAL_LIMIT, OTHER_LIMIT = 2.0, np.sqrt(20.0)  # standard deviations from the mean
LARGEST_SHARE, LARGEST_IMBALANCE = 0.05, 0.3

LOWEST_CORRELATION = 0.75  # VQEG HDTV test plan (2010), Annex I

FEWEST_PEOPLE, FEWEST_ITEMS = 6, 6  # to compare somebody's correlation with those of the others
MOST_UNLIKE = 0.25  # share of the participants who may be
NEARLY_ONE = 0.999  # larger correlations count as it
CALIBRATION = 2.0  # times as many honest people as nominally lie so far off, at most (docs/simulation.md)


@dataclass(frozen=True)
class Screening:
    """How often each participant's ratings lie far above (P) and below (Q) everybody's mean.

    Parameters
    ----------
    above, below : int64 (P,), the Recommendation's P and Q
    n_ratings : int64 (P,), of the participant
    """

    above: NDArray[np.int64]
    below: NDArray[np.int64]
    n_ratings: NDArray[np.int64]

    @property
    def share(self) -> Array:
        """(P + Q) / number of ratings, float64 (P,); NaN without ratings."""
        return np.where(self.n_ratings > 0, (self.above + self.below) / np.maximum(self.n_ratings, 1), np.nan)

    @property
    def imbalance(self) -> Array:
        """|P - Q| / (P + Q), float64 (P,); NaN where both are 0."""
        both = self.above + self.below
        return np.where(both > 0, np.abs(self.above - self.below) / np.maximum(both, 1), np.nan)

    @property
    def is_outlier(self) -> NDArray[np.bool_]:
        """Far from the mean in more than 5 % of ratings, and on both sides, bool (P,)."""
        return (self.share > LARGEST_SHARE) & (self.imbalance < LARGEST_IMBALANCE)


def screen_observers(table: RatingTable) -> Screening:
    """Count ratings far from the mean of their presentation, by the rule of ITU-R BT.500.

    The limit is 2 standard deviations (denominator n - 1) where the ratings of a presentation are about normal, which
    is a kurtosis m4 / m2^2 from 2 to 4; else the square root of 20. A participant who does not rate at random, but
    always higher or lower than others, has a large |P - Q| and is kept.

    Parameters
    ----------
    table : RatingTable

    Returns
    -------
    Screening

    Convention
    ----------
    The k-th ratings that participants give an item are a presentation. One with equal ratings says nothing.

    Source
    ------
    ITU-R BT.500-15 (05/2023), screening of the observers; in BT.500-14 (10/2019) Annex 1, clause A1-2.3.1.
    """
    people = len(table.participants)
    _, presentation = np.unique(table.item * (len(table) + 1) + _repetition(table), return_inverse=True)
    n = np.bincount(presentation)
    deviation = table.rating - (np.bincount(presentation, table.rating) / n)[presentation]
    second, fourth = (np.bincount(presentation, deviation**power) / n for power in (2, 4))
    varies = second > 0
    kurtosis = fourth / np.where(varies, second, 1) ** 2
    is_normal = (kurtosis >= NORMAL_KURTOSIS[0]) & (kurtosis <= NORMAL_KURTOSIS[1])
    limit = np.where(is_normal, NORMAL_LIMIT, OTHER_LIMIT) * np.sqrt(second * n / np.maximum(n - 1, 1))
    limit = np.where(varies, limit, np.inf)[presentation]
    return Screening(
        above=np.bincount(table.person[deviation >= limit], minlength=people),
        below=np.bincount(table.person[deviation <= -limit], minlength=people),
        n_ratings=np.bincount(table.person, minlength=people),
    )


def _repetition(table: RatingTable) -> NDArray[np.intp]:
    """Return how often the participant rated the item before, for each rating (N,)."""
    cell = table.person * len(table.items) + table.item
    order = np.argsort(cell, kind="stable")
    is_first = np.r_[True, np.diff(cell[order]) != 0]
    start = np.maximum.accumulate(np.where(is_first, np.arange(len(cell)), 0))
    repetition = np.empty(len(cell), np.intp)
    repetition[order] = np.arange(len(cell)) - start
    return repetition


def correlations_with_others(table: RatingTable) -> list[float | None]:
    """Return Pearson's correlation of each participant's ratings with the means of the others' ratings.

    Returns
    -------
    list of P; None for fewer than six items, or without any variation
    """
    values = person_means(table)
    n, total = (~np.isnan(values)).sum(axis=0), np.nansum(values, axis=0)
    rows = []
    for row in values:
        there = ~np.isnan(row) & (n > 1)
        others = (total[there] - row[there]) / (n[there] - 1)
        rows.append(defined(pearson, row[there], others) if there.sum() >= FEWEST_ITEMS else None)
    return rows


def false_alarms(correlations: Sequence[float | None]) -> list[float | None]:
    """Return how many honest people are expected to lie as far below the others, of as many as are compared.

    Correlations are taken to be normal after Fisher's transformation. The one that lies farthest below the mean is
    tested and left out, then the next, up to a quarter of all; several of them hide each other from the first tests,
    not from the last.

    Parameters
    ----------
    correlations : of P participants, as from `correlations_with_others`

    Returns
    -------
    list of P; None where there is no correlation, or with too few participants

    Source
    ------
    Rosner (1983), generalised extreme Studentized deviates, to one side.
    """
    known = [index for index, value in enumerate(correlations) if value is not None]
    result: list[float | None] = [None] * len(correlations)
    if len(known) < FEWEST_PEOPLE:
        return result
    z = np.arctanh(np.clip([value for value in correlations if value is not None], -NEARLY_ONE, NEARLY_ONE))
    order = np.argsort(z)
    alarms = np.full(len(z), float(len(z)))
    for step in range(max(1, int(MOST_UNLIKE * len(z)))):
        left = z[order[step:]]
        n, spread = len(left), left.std(ddof=1)
        deviation = (left.mean() - left[0]) / spread if spread > 0 else 0.0
        rest = (n - 1) ** 2 - n * deviation**2
        ratio = np.sqrt(n * (n - 2) * deviation**2 / rest) if rest > 0 else np.inf
        alarms[order[step]] = min(CALIBRATION * n * student.sf(ratio, n - 2), n)
    for step in reversed(range(len(z) - 1)):
        alarms[order[step]] = min(alarms[order[step]], alarms[order[step + 1]])
    for index, value in zip(known, alarms.tolist(), strict=True):
        result[index] = value
    return result


def correlations_with_means(table: RatingTable) -> list[float | None]:
    """Return Pearson's correlation of each participant's ratings with the mean opinion scores of the same items.

    The mean is over all participants, this one too. A participant below 0.75 would be discarded by the source.

    Returns
    -------
    list of P; None for fewer than three items, or without any variation

    Source
    ------
    VQEG (2010), test plan for evaluation of video quality models for use with high definition TV content, Annex I.
    """
    values = person_means(table)
    rated = ~np.isnan(values)
    n = rated.sum(axis=0)
    means = np.nansum(values, axis=0) / np.maximum(n, 1)
    return [defined(pearson, row[there], means[there]) for row, there in zip(values, rated, strict=True)]

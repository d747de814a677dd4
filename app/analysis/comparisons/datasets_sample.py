"""Test differences for datasets like those of the study: datasets, as well as people, are a sample.

Intervals and tests elsewhere hold for other people on the same datasets. Where datasets shift the scores, a difference
on five of them says little about the sixth; here the spread over datasets counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.stats import f as f_distribution
from scipy.stats import t as student

from app.analysis.comparisons.comparison import Comparison
from app.analysis.comparisons.factors import Factors, beyond, coding
from app.analysis.comparisons.homogeneity import Part
from app.analysis.model.contrasts import MOST_ITEMS, contrasts_of, holm, scores_of
from app.analysis.model.likelihood.fit import Fit
from app.analysis.reading.votes_table import ALL

Array = NDArray[np.float64]

FEWEST_DATASETS = 3  # the spread over two has one degree of freedom


class DatasetsTest(NamedTuple):
    """A test that a vector of contrasts is zero for datasets like these: F with its degrees of freedom."""

    f: float
    df1: float
    df2: float
    p_value: float


def over_datasets(by_dataset: Array, people: Array | None, votes: Array, n_people: int | None) -> DatasetsTest | None:
    """Test that contrasts are zero over datasets at large.

    The covariance of their means over datasets is that of the datasets' own estimates, and what people add, who are the
    same on all of them: the clustered covariance less that of the votes. With several contrasts the mean squares are
    compared (Box 1954, with his correction of the degrees of freedom); with one it is a t-test.

    Parameters
    ----------
    by_dataset : float64 (D, q), estimates of orthonormal contrasts on each dataset
    people, votes : float64 (q, q), covariance of the pooled estimates clustered by participant, and from the votes
    n_people : number of participants
    """
    n, q = by_dataset.shape
    if n < FEWEST_DATASETS or q == 0:
        return None
    mean, spread = by_dataset.mean(axis=0), np.atleast_2d(np.cov(by_dataset.T, ddof=1)) / n
    shared = np.zeros_like(spread)
    if people is not None:
        values, vectors = np.linalg.eigh(people - votes)
        shared = (vectors * np.maximum(values, 0.0)) @ vectors.T
    together = spread + shared
    total = float(np.trace(together))
    if total <= 0:
        return None
    epsilon = total**2 / (q * float(np.sum(together**2)))
    of_spread, of_shared = float(np.trace(spread)), float(np.trace(shared))
    df = total**2 / (of_spread**2 / (n - 1) + (of_shared**2 / (n_people - 1) if n_people and n_people > 1 else 0.0))
    f = float(mean @ mean) / total
    df1, df2 = q * epsilon, q * epsilon * df
    return DatasetsTest(f, df1, df2, float(f_distribution.sf(f, df1, df2)))


def _clustered(fit: Fit, directions: Array) -> tuple[Array | None, Array] | None:
    """Return the covariances of functions of the parameters, directions float64 (q, P)."""
    if fit.covariance is None:
        return None
    people = fit.participant_covariance
    wide = None if people is None else directions @ people @ directions.T
    return wide, directions @ fit.covariance @ directions.T


def factor_rows(additive: Mapping[str, Part], factors: Factors) -> Iterator[dict[str, Any]]:
    """Yield the test of every factor for datasets like these, corrected over the factors by Holm's method.

    Parameters
    ----------
    additive : dataset -> the additive model's fit, `all` among them
    factors : factor -> item -> level
    """
    if ALL not in additive:
        return
    pooled = additive[ALL].fit
    singles = [part.fit for name, part in additive.items() if name != ALL and part.fit.items == pooled.items]
    rows, column = list[dict[str, Any]](), 0
    for factor, names in coding(factors, pooled.items)[1]:
        size = len(names) - 1
        to_levels = np.r_[np.eye(size), -np.ones((1, size))]
        contrasts = null_space(np.ones((1, size + 1))).T @ to_levels  # orthonormal in the levels
        rows += _rows(f"factor {factor}", "additive", pooled, singles, slice(column, column + size), contrasts)
        column += size
    for row, corrected in zip(rows, holm(np.array([row["p_value"] for row in rows])), strict=True):
        yield row | {"p_holm": float(corrected)}


def _rows(
    name: str, model: str, pooled: Fit, singles: Sequence[Fit], places: slice, contrasts: Array
) -> Iterator[dict[str, Any]]:
    if len(singles) < FEWEST_DATASETS or pooled.theta is None:
        return
    directions = np.zeros((len(contrasts), len(pooled.theta)))
    directions[:, places] = contrasts
    known = _clustered(pooled, directions)
    if known is None:
        return
    values = np.stack([contrasts @ fit.theta[places] for fit in singles if fit.theta is not None])
    tested = over_datasets(values, *known, pooled.n_participants)
    if tested is not None:
        yield {"name": name, "model": model, "n_datasets": len(values), **tested._asdict()}


def interaction_rows(compared: Sequence[Comparison], additive: Mapping[str, Part]) -> Iterator[dict[str, Any]]:
    """Yield the test that factors add up on datasets like these.

    Parameters
    ----------
    compared : the fits of the items' scores
    additive : as in `factor_rows`
    """
    pooled, singles = _items(compared)
    if pooled is None or ALL not in additive or additive[ALL].fit.items != pooled.items:
        return
    directions = beyond(pooled, additive[ALL].fit)
    n = len(pooled.items)
    if len(directions):
        for row in _rows("interaction", "items", pooled, singles, slice(0, n), directions[:, :n]):
            yield row | {"p_holm": row["p_value"]}


def _items(compared: Sequence[Comparison]) -> tuple[Fit | None, list[Fit]]:
    """Return the fit of all conditions on all datasets, and those of single datasets with the same conditions."""
    whole = next((row.fit for row in compared if row.comparison == row.dataset == ALL), None)
    if whole is None or whole.status != "ok":
        return None, []
    singles = [row.fit for row in compared if row.comparison == ALL and row.dataset != ALL]
    return whole, [fit for fit in singles if fit.status == "ok" and fit.items == whole.items]


def pair_p_values(compared: Sequence[Comparison]) -> dict[tuple[str, str], tuple[float, float]]:
    """Return each pair's p-value for datasets like these, and that corrected by Holm's method; empty without.

    Datasets are taken to shift all conditions by as much, since a few tell little about each pair by itself.

    Parameters
    ----------
    compared : the fits of the items' scores
    """
    pooled, singles = _items(compared)
    if pooled is None or len(singles) < FEWEST_DATASETS or not 1 < len(pooled.items) <= MOST_ITEMS:
        return {}
    n, n_datasets = len(pooled.items), len(singles)
    values = np.stack([fit.theta[:n] for fit in singles if fit.theta is not None])
    spread = np.cov(values.T, ddof=1) / n_datasets
    common = float(np.trace(spread)) / (n - 1)
    if common <= 0:  # the datasets have the same votes
        return {}
    df_common = (n_datasets - 1) * float(np.trace(spread)) ** 2 / float(np.sum(spread**2))
    first, second = np.triu_indices(n, 1)
    contrasts = np.zeros((len(first), len(pooled.theta if pooled.theta is not None else ())))
    contrasts[:, :n] = (np.eye(n)[first] - np.eye(n)[second]) / np.sqrt(2)
    known = _clustered(pooled, contrasts)
    if known is None:
        return {}
    people, votes = known
    shared = np.zeros(len(first)) if people is None else np.maximum(np.diag(people - votes), 0.0)
    variance, n_people = common + shared, pooled.n_participants or 2
    df = variance**2 / (common**2 / df_common + shared**2 / max(n_people - 1, 1))
    ratios = np.abs(contrasts[:, :n] @ values.mean(axis=0)) / np.sqrt(variance)
    sampled = np.asarray(2 * student.sf(ratios, df), np.float64)
    alone = [row.p_value for row in contrasts_of(scores_of(pooled))]  # nothing is surer for more datasets than these
    p_values: Array = np.maximum(sampled, alone) if alone else sampled
    corrected = holm(p_values)
    names = [(pooled.items[a], pooled.items[b]) for a, b in zip(first, second, strict=True)]
    return {pair: (float(p), float(p_holm)) for pair, p, p_holm in zip(names, p_values, corrected, strict=True)}

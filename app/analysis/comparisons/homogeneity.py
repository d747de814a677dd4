"""Test whether parts of the votes (datasets, or groups of participants) share one set of scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, null_space
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from app.analysis.comparisons.factors import ModelTest
from app.analysis.model.likelihood.fit import ALIKE, Fit
from app.analysis.model.likelihood.participant_errors import participant_gradients
from app.analysis.reading.votes_table import VotesTable, numbered

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """A part of the votes and the model fitted to it."""

    votes: VotesTable
    fit: Fit


def parts_differ(name: str, model: str, dataset: str, pooled: Fit, parts: Sequence[Part]) -> ModelTest | None:
    """Test whether the parts share one set of parameters.

    Parameters
    ----------
    name, model, dataset : as in `ModelTest`
    pooled : Fit to all parts together
    parts : votes and fit of each part, of the same model; a participant is in several (datasets) or in one (groups of
        people)

    Returns
    -------
    ModelTest, the likelihood-ratio test and its correction for participants as the sample; None unless every fit has a
    maximum with the same parameters
    """
    fits = [pooled, *(part.fit for part in parts)]
    if len(parts) < 2 or any(fit.status != "ok" or not _are_alike(fit, pooled) for fit in fits):
        return None
    g2 = max(2 * (sum(part.fit.loglik or 0.0 for part in parts) - (pooled.loglik or 0.0)), 0.0)
    df = pooled.design.n_free * (len(parts) - 1)
    return ModelTest(name, model, dataset, g2, df, float(chi2.sf(g2, df)), rao_scott_p_value(g2, parts))


def _are_alike(fit: Fit, other: Fit) -> bool:
    return fit.items == other.items and fit.design.n_free == other.design.n_free


def rao_scott_p_value(g2: float, parts: Sequence[Part]) -> float | None:
    """Return the p-value of a likelihood-ratio statistic when the votes of a person depend on each other.

    Under the hypothesis, G2 is a sum of chi-squares weighted by the eigenvalues of V0^-1 V. V0 is the covariance of
    the differences between the parts from the information, V from participants. The statistic and its degrees of
    freedom are scaled to the first two moments of that sum and compared with F, whose second degrees of freedom come
    from the number of participants less one. A group's own participants vary around its own scores, and a small group
    varies most: groups have as many degrees of freedom as the sum of their variances has. Unlike Hotelling's test this
    needs no more participants than parameters.

    The second moment is estimated without the bias that few participants cause.

    Source
    ------
    Rao and Scott (1984), second-order correction; Thomas and Rao (1987) for F; Bai and Saranadasa (1996), section 3,
    for the trace of a squared covariance; Satterthwaite (1946) for groups.
    """
    if any(not part.votes.has_participants or part.fit.covariance is None for part in parts):
        return None
    sizes = [part.votes.n_voters for part in parts]
    if min(sizes) < 2:
        return None
    influence, information = _stacked(parts)
    differ = _differences(information.shape[0] // len(parts), len(parts))
    by_people = influence @ differ.T
    scaled = np.linalg.solve(differ @ information @ differ.T, by_people.T)
    ratio, by_person = scaled @ by_people, np.einsum("kj,jk->j", scaled, by_people)
    total = float(by_person.sum())
    if total <= ALIKE * len(ratio):  # all voted alike, or all of each group
        return None
    n = len(influence) - 1.0
    if sum(sizes) == len(influence):  # nobody is in two parts
        shares = np.add.reduceat(by_person, np.cumsum([0, *sizes[:-1]])) / total
        n = 1 / float(shares**2 @ (1 / (np.array(sizes) - 1)))
    if n < 2:
        return None
    squares = n**2 / ((n - 1) * (n + 2)) * (float(np.trace(ratio @ ratio)) - total**2 / n)
    df_scaled = min(total**2 / squares, len(ratio)) if squares > 0 else len(ratio)  # equal weights are the least uneven
    statistic = g2 / total  # of F: (G2 / mean eigenvalue) / df
    return float(f_distribution.sf(statistic, df_scaled, df_scaled * n))


def _stacked(parts: Sequence[Part]) -> tuple[Array, Array]:
    """Return the participants' influence on the free parameters of all parts (J, D f), and the covariance (D f, D
    f).

    The influence on a part has the factor J / (J - 1) of its J participants in its square. The covariance comes from
    the information; D is the number of parts, f that of a part's free parameters.
    """
    voters = [numbered(part.votes.participant, len(part.votes.participants))[0] for part in parts]
    present = [[part.votes.participants[who] for who in people] for part, people in zip(parts, voters, strict=True)]
    place = {name: index for index, name in enumerate(dict.fromkeys(name for names in present for name in names))}
    influences, covariances = [], []
    for part, names in zip(parts, present, strict=True):
        free = _free_directions(part.fit)
        assert part.fit.covariance is not None
        influence = np.zeros((len(place), free.shape[0]))
        influence[[place[name] for name in names]] = (
            participant_gradients(part.fit, part.votes) @ part.fit.covariance @ free.T
        )
        influences.append(influence * np.sqrt(len(names) / (len(names) - 1)))
        covariances.append(free @ part.fit.covariance @ free.T)
    return np.concatenate(influences, axis=1), np.asarray(block_diag(*covariances))


def _free_directions(fit: Fit) -> Array:
    """Return an orthonormal basis (f, P) of the parameters whose scores sum to zero."""
    design = fit.design
    if design.levels is not None:
        return np.eye(design.n_parameters)
    constraint = np.zeros((1, design.n_parameters))
    constraint[0, : design.n_effects] = 1
    return np.asarray(null_space(constraint).T)


def _differences(n_free: int, n_parts: int) -> Array:
    """Return the map from all parts' parameters to differences from the last part, float64 ((D - 1) f, D f)."""
    from_last = np.concatenate([np.eye(n_parts - 1), -np.ones((n_parts - 1, 1))], axis=1)
    return np.kron(from_last, np.eye(n_free))

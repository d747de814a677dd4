"""Fit scores with participants, and datasets, as random effects: how people at large would vote, on datasets at large.

Everybody has scores, and a tendency to ties, of their own, which vary around common ones; on each dataset all scores
may be shifted, too. The standard deviations of these are estimated with the scores, and what is uncertain about them
widens the intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import ndtr, ndtri

from app.analysis.model.bootstrap import participant_counts
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.likelihood.newton import LARGEST_STEP, Design
from app.analysis.model.likelihood.penalised import third_order
from app.analysis.model.likelihood.ties import TIE_MODELS, Derivatives
from app.analysis.model.settings import LEVEL
from app.analysis.reading.phrases import counted
from app.analysis.reading.votes_table import VotesTable

Array = NDArray[np.float64]

PARTICIPANTS, DATASETS, TIES = "participants", "datasets", "ties"
FEWEST = 3  # people, or datasets; the spread of fewer follows from the prior alone (Gelman 2006, section 5.2)
PRIOR_SCALE = 1.0  # log-odds; median of a standard deviation's half-Cauchy prior (Gelman 2006, section 5.2)
ROUNDING = 1e-9  # relative; smaller decreases are rounding
TOLERANCE = 1e-6  # log-odds, of the last step; the remaining error is of the order of its square
MAX_ITERATIONS = 100
START = 0.4  # log-odds; a usual spread of opinions
FLAT, STEP = 0.02, 1e-3  # slope at the mode, and step of its differences; the density is exact to about 1e-6
DIFFERENCE = 0.1  # of log standard deviations, for second derivatives
REACH = 2.5  # standard deviations up to which the posterior of the spreads is followed, at steps of one
HALVINGS = 50  # of an interval that holds a quantile
FARTHEST = np.log(100.0)  # of log standard deviations from 0; Laplace's approximation fails long before
LARGEST_TABLE = 1_000_000  # participants x datasets x pairs; more take minutes


class UndeterminedError(Exception):
    """The votes do not tell the standard deviations of the random effects; the text says why."""


class State(NamedTuple):
    """Values of all parameters, log-odds.

    Parameters
    ----------
    theta : float64 (P,), common parameters as in `Fit`
    by_person : float64 (J, P), what is added for each participant
    by_dataset : float64 (D, P), what is added on each dataset
    """

    theta: Array
    by_person: Array
    by_dataset: Array

    def moved(self, step: State, factor: float) -> State:
        """Return the values after a step."""
        return State(*(part + factor * change for part, change in zip(self, step, strict=True)))


@dataclass(frozen=True)
class Information:
    """The curvature of the posterior, factored: participants do not depend on each other given what is common.

    Parameters
    ----------
    inverse : float64 (G, G), covariance of the common parameters and each dataset's shifts
    slopes : float64 (J, m, G), how a participant's mode falls with these
    within : float64 (J, m, m), covariance of a participant's parameters given these
    log_determinant : of the whole
    """

    inverse: Array
    slopes: Array
    within: Array
    log_determinant: float


@dataclass(frozen=True)
class Mode:
    """Where the posterior density is highest for given standard deviations.

    Parameters
    ----------
    state : the parameters there
    information : the curvature there
    log_density : of the standard deviations' logarithms given the votes, up to a constant
    """

    state: State
    information: Information
    log_density: float


@dataclass(frozen=True)
class Posterior:
    """Scores and standard deviations given the votes: a mixture of normal distributions.

    Parameters
    ----------
    items : the items
    levels : what varies: `participants`, `ties` where there are any, `datasets` if asked for
    weights : float64 (K,), of the mixture's parts
    spreads : float64 (K, L), standard deviation of each level in each part, log-odds
    spread_logs : float64 (L, 2), mean and standard deviation of each spread's logarithm
    scores : float64 (K, n), means of the scores in each part, log-odds
    covariances : float64 (K, n, n), of the scores
    """

    items: tuple[str, ...]
    levels: tuple[str, ...]
    weights: Array
    spreads: Array
    spread_logs: Array
    scores: Array
    covariances: Array

    def along(self, directions: Array) -> tuple[Array, Array]:
        """Return mean and standard deviation of combinations of scores (M, n) in each part, each float64 (K, M)."""
        variances = np.einsum("mi,kij,mj->km", directions, self.covariances, directions)
        return self.scores @ directions.T, np.sqrt(np.maximum(variances, 0.0))

    def spread(self, level: str) -> tuple[float, float, float]:
        """Return the median of a standard deviation and its 95 % interval, log-odds."""
        centre, sd = self.spread_logs[self.levels.index(level)]
        low, high = np.exp(centre + np.array([-1, 1]) * sd * ndtri((1 + LEVEL) / 2))
        return float(np.exp(centre)), float(low), float(high)


def fit_random_effects(fit: Fit, votes: VotesTable, levels: Sequence[str]) -> Posterior | str:
    """Fit the model of a fit again, with random effects.

    Parameters
    ----------
    fit : Fit with status `ok`
    votes : VotesTable, the votes it was fitted to
    levels : `participants`, and `datasets` to let scores vary between datasets, too

    Returns
    -------
    Posterior; or, in words, why there is none

    Source
    ------
    Bradley and Terry (1952) and Davidson (1970) with normal random effects (Böckenholt 2001); nested Laplace
    approximations: Rue, Martino and Chopin (2009), sections 3.1 and 3.2, with a corrected mean.
    """
    n_datasets = len(np.unique(votes.dataset))
    if why := _why_not(fit, votes, n_datasets if DATASETS in levels else None):
        return why
    model = _Hierarchy.of_votes(fit, votes, has_datasets=DATASETS in levels)
    try:
        return _explored(model, fit.items)
    except UndeterminedError as error:
        return str(error)


def _why_not(fit: Fit, votes: VotesTable, n_datasets: int | None) -> str | None:
    if fit.status != "ok" or fit.theta is None or len(fit.items) < 2:
        return "the scores have no finite estimate"
    if not TIE_MODELS[fit.ties].is_canonical:
        return "Rao and Kupper's ties have no random effects here; use davidson, half or drop"
    if not votes.has_participants:
        return "the participants are not recorded"
    n_people = fit.n_participants or 0
    if n_people < FEWEST:
        return f"{counted(n_people, 'participant')} cannot tell how much people differ; expected {FEWEST} or more"
    if n_datasets is not None and n_datasets < FEWEST:
        return f"{counted(n_datasets, 'dataset')} cannot tell how much datasets differ; expected {FEWEST} or more"
    size = n_people * (n_datasets or 1) * len(fit.counts.first)
    if size > LARGEST_TABLE:
        return f"{size} cells of participants, datasets and pairs are too many, expected at most {LARGEST_TABLE}"
    return None


@dataclass(frozen=True)
class _Hierarchy:
    """The votes of each participant on each dataset, and how parameters act on them.

    Parameters
    ----------
    design : Design of the pairs
    table : wins, losses and ties, each float64 (J * D, C); D is 1 unless datasets vary
    n_people, n_datasets : J, D
    start : the parameters without random effects
    has_datasets : do scores vary between datasets?
    """

    design: Design
    table: tuple[Array, Array, Array]
    n_people: int
    n_datasets: int
    start: State
    has_datasets: bool

    @classmethod
    def of_votes(cls, fit: Fit, votes: VotesTable, *, has_datasets: bool) -> _Hierarchy:
        assert fit.theta is not None
        people, who = np.unique(votes.participant, return_inverse=True)
        datasets, where = np.unique(votes.dataset, return_inverse=True)
        n_datasets = len(datasets) if has_datasets else 1
        crossed = (who * n_datasets + where if has_datasets else who).astype(np.int32)
        cells = replace(votes, participants=("",) * len(people) * n_datasets, participant=crossed)
        wins, losses, ties = np.split(participant_counts(fit, cells).astype(np.float64), 3, axis=1)
        table = TIE_MODELS[fit.ties].counted(wins, losses, ties)
        random = (np.zeros((n, len(fit.theta))) for n in (len(people), n_datasets))
        return cls(fit.design, table, len(people), n_datasets, State(fit.theta, *random), has_datasets)

    @property
    def levels(self) -> tuple[str, ...]:
        ties = (TIES,) if self.design.has_tie else ()
        return (PARTICIPANTS, *ties, *((DATASETS,) if self.has_datasets else ()))

    @property
    def personal(self) -> NDArray[np.intp]:
        """Parameters that vary between participants: scores and the tie parameter."""
        ties = [self.design.n_parameters - 1] if self.design.has_tie else []
        result: NDArray[np.intp] = np.r_[np.arange(self.design.n_effects), np.array(ties, np.intp)]
        return result

    def precisions(self, spreads: Array) -> tuple[Array, Array]:
        """Return the precision of what varies between participants, (m,), and between datasets, (n,)."""
        n = self.design.n_effects
        sd = dict(zip(self.levels, spreads, strict=True))
        by_person = np.r_[np.full(n, sd[PARTICIPANTS]), [sd[TIES]] if TIES in sd else []]
        by_dataset = np.full(n if self.has_datasets else 0, sd.get(DATASETS, 1.0))
        return by_person**-2.0, by_dataset**-2.0

    def mode(self, log_spreads: Array, begin: State | None = None) -> Mode:
        """Find the mode by Newton's method, and the Laplace approximation of the standard deviations' density there.

        The common parameters have a flat prior and are integrated out with the random effects.

        Parameters
        ----------
        log_spreads : float64 (L,), logarithms of the standard deviations
        begin : where to start, the mode for similar ones
        """
        spreads = np.exp(log_spreads)
        precisions = self.precisions(spreads)
        state = begin or self.start
        value = self._value(state, precisions)
        for _ in range(MAX_ITERATIONS):
            by_pair = self.design.model.derivatives(*self._predictors(state), *self.table)
            information = self._information(by_pair, precisions)
            step = self._step(information, self._by_cell(self.design.gradient(by_pair)), state, precisions)
            longest = max(float(np.abs(part).max()) for part in step)
            factor = min(1.0, LARGEST_STEP / max(longest, LARGEST_STEP))
            while (following := self._value(state.moved(step, factor), precisions)) < value - ROUNDING * abs(value):
                factor /= 2
            state, value = state.moved(step, factor), following
            if longest < TOLERANCE:
                break
        else:
            raise UndeterminedError(f"no estimate was found in {MAX_ITERATIONS} iterations")
        log_random = sum(len(part) * np.log(kind).sum() for part, kind in zip(state[1:], precisions, strict=True))
        log_prior = float(np.sum(log_spreads - np.log1p((spreads / PRIOR_SCALE) ** 2)))
        return Mode(state, information, value + (log_random - information.log_determinant) / 2 + log_prior)

    def mean(self, mode: Mode) -> Array:
        """Return the posterior mean of the common parameters, float64 (P,), to the second order around a mode.

        The density is skewed, most where few votes tell much: the mode lies closer to zero than the mean.

        Source
        ------
        Lindley (1980): half the third derivatives times the covariance moves the mode to the mean.
        """
        d, t = self._predictors(mode.state)
        to_d, to_t = self.design.effects.toarray(), self.design.tie_effects.toarray()  # (C, P)
        covariance = self._cell_covariances(mode.information)
        along_d, along_t = covariance @ to_d.T, covariance @ to_t.T  # (J * D, P, C)
        dd, dt, tt = (
            np.einsum("cp,bpc->bc", left, right, optimize=True)
            for left, right in ((to_d, along_d), (to_t, along_d), (to_t, along_t))
        )
        n_votes = self.table[0] + self.table[1] + self.table[2]
        pull = -n_votes / 2 * third_order(self.design.model, d, t, np.array([[dd, dt], [dt, tt]]))
        nothing = np.zeros_like(dd)
        slopes = self._by_cell(self.design.gradient(Derivatives(pull[0], pull[1], nothing, nothing, nothing)))
        return mode.state.theta + self._step(mode.information, slopes).theta

    def _by_cell(self, values: Array) -> Array:
        return values.reshape(self.n_people, self.n_datasets, *values.shape[1:])

    def _predictors(self, state: State) -> tuple[Array, Array]:
        together = state.theta + state.by_person[:, None] + state.by_dataset
        return self.design.predictors(together.reshape(-1, self.design.n_parameters))

    def _value(self, state: State, precisions: tuple[Array, Array]) -> float:
        """Return the log-likelihood less the penalties of the random effects."""
        loglik = self.design.model.loglik(*self._predictors(state), *self.table).sum()
        personal, shifts = state.by_person[:, self.personal], state.by_dataset[:, : len(precisions[1])]
        return float(loglik - (personal**2 @ precisions[0]).sum() / 2 - (shifts**2 @ precisions[1]).sum() / 2)

    def _information(self, by_pair: Derivatives, precisions: tuple[Array, Array]) -> Information:
        """Eliminate the participants first, then invert what is common."""
        n, personal = len(precisions[1]), self.personal
        curves = self._by_cell(self.design.information(by_pair))
        together = curves.sum(axis=1)[:, personal]  # (J, m, P)
        within = np.linalg.inv(together[:, :, personal] + np.diag(precisions[0]))
        with_datasets = curves[:, :, personal, :n].transpose(0, 2, 1, 3).reshape(self.n_people, len(personal), -1)
        cross = np.concatenate([together, with_datasets], axis=2)  # (J, m, G)
        slopes = within @ cross
        common = self._common(curves.sum(axis=0), precisions[1])
        common -= np.einsum("jmg,jmh->gh", cross, slopes, optimize=True)
        common[: self.design.n_effects, : self.design.n_effects] += 1.0  # the common shift, which no vote tells
        log_determinant = np.linalg.slogdet(common)[1] - np.linalg.slogdet(within)[1].sum()
        inverse = np.asarray(np.linalg.inv(common), np.float64)
        return Information(inverse, slopes, within, float(log_determinant))

    def _common(self, curves: Array, precision: Array) -> Array:
        """Return the information of the common parameters, then of each dataset's shifts, float64 (G, G)."""
        size, n = self.design.n_parameters, len(precision)
        information = np.zeros((size + self.n_datasets * n,) * 2)
        information[:size, :size] = curves.sum(axis=0)
        for index, curve in enumerate(curves if n else ()):
            rows = slice(size + index * n, size + (index + 1) * n)
            information[rows, rows] = curve[:n, :n] + np.diag(precision)
            information[rows, :size], information[:size, rows] = curve[:n], curve[:, :n]
        return information

    def _step(
        self,
        information: Information,
        slopes: Array,
        state: State | None = None,
        precisions: tuple[Array, Array] | None = None,
    ) -> State:
        """Return the inverse of the information times a gradient.

        Parameters
        ----------
        slopes : float64 (J, D, P), gradient of the likelihood of each participant's votes on each dataset
        state, precisions : if given, those of the random effects, whose penalty counts, too
        """
        size, n, personal = self.design.n_parameters, self.design.n_effects if self.has_datasets else 0, self.personal
        by_personal, shifts = slopes.sum(axis=1)[:, personal], slopes.sum(axis=0)[:, :n]
        if state is not None and precisions is not None:
            by_personal = by_personal - precisions[0] * state.by_person[:, personal]
            shifts = shifts - precisions[1] * state.by_dataset[:, :n]
        common = np.r_[slopes.sum(axis=(0, 1)), shifts.ravel()]
        step = information.inverse @ (common - np.einsum("jmg,jm->g", information.slopes, by_personal))
        by_person, by_dataset = np.zeros((self.n_people, size)), np.zeros((self.n_datasets, size))
        by_person[:, personal] = np.einsum("jml,jl->jm", information.within, by_personal) - information.slopes @ step
        by_dataset[:, :n] = step[size:].reshape(self.n_datasets, n)
        return State(step[:size], by_person, by_dataset)

    def _cell_covariances(self, information: Information) -> Array:
        """Return the covariance of the parameters of each cell, a participant on a dataset, float64 (J * D, P, P)."""
        size, n = self.design.n_parameters, self.design.n_effects if self.has_datasets else 0
        common = np.zeros((self.n_datasets, size, len(information.inverse)))
        common[:, :, :size] = np.eye(size)
        for index in range(self.n_datasets):
            common[index, :n, size + index * n : size + (index + 1) * n] = np.eye(n)
        placed = np.eye(size)[:, self.personal]  # (P, m)
        onto = common - (placed @ information.slopes)[:, None]  # (J, D, P, G)
        within = placed @ information.within @ placed.T
        return (onto @ information.inverse @ np.swapaxes(onto, -1, -2) + within[:, None]).reshape(-1, size, size)


def _explored(model: _Hierarchy, items: tuple[str, ...]) -> Posterior:
    """Follow the posterior of the standard deviations around its mode, on a lattice of its principal axes."""
    last: list[State] = [model.start]

    def at(log_spreads: Array) -> Mode:
        mode = model.mode(log_spreads, last[0])
        last[0] = mode.state
        return mode

    def badness(log_spreads: Array) -> float:  # a step of the search may go far
        within = np.clip(log_spreads, -FARTHEST, FARTHEST)
        return float(np.sum((log_spreads - within) ** 2)) - at(within).log_density

    start = np.full(len(model.levels), np.log(START))
    optimise: Any = minimize  # its stubs know no such options
    best = np.asarray(optimise(badness, start, method="BFGS", options={"gtol": FLAT, "eps": STEP}).x)
    for level, log_spread in zip(model.levels, best, strict=True):
        if log_spread > FARTHEST - 1:
            raise UndeterminedError(f"so few votes do not tell how much {level} differ")
    values, axes = np.linalg.eigh(_curvature(lambda spreads: at(spreads).log_density, best))
    scales = axes / np.sqrt(np.maximum(values, 0.05))  # (L, L), a column for each axis
    steps = range(-int(REACH), int(REACH) + 1)
    lattice = [z for z in product(steps, repeat=len(start)) if np.linalg.norm(z) <= REACH]
    points = best + np.array(lattice) @ scales.T
    points = points[(np.abs(points) <= FARTHEST).all(axis=1)]
    modes = [at(point) for point in points]
    density = np.array([mode.log_density for mode in modes])
    weights = np.exp(density - density.max())
    weights /= weights.sum()
    n = len(items)
    scores = np.stack([model.mean(mode)[:n] for mode in modes])
    scores -= scores.mean(axis=1, keepdims=True)
    covariances = np.stack([mode.information.inverse[:n, :n] - 1 / n**2 for mode in modes])
    centre = weights @ points
    logs = np.stack([centre, np.sqrt(weights @ (points - centre) ** 2)], axis=1)
    return Posterior(items, model.levels, weights, np.exp(points), logs, scores, covariances)


def _curvature(log_density: Callable[[Array], float], centre: Array) -> Array:
    """Return the negative second derivatives of a function at a point, float64 (L, L), by central differences."""
    steps = DIFFERENCE * np.eye(len(centre))
    result = np.empty((len(centre), len(centre)))
    for row, column in combinations_with_replacement(range(len(centre)), 2):
        values = [
            sign * other * log_density(centre + sign * steps[row] + other * steps[column])
            for sign, other in product((1, -1), repeat=2)
        ]
        result[row, column] = result[column, row] = -sum(values) / (4 * DIFFERENCE**2)
    return result


def mixture_interval(weights: Array, means: Array, sds: Array) -> tuple[Array, Array]:
    """Return the limits of the central 95 % of mixtures of normal distributions, each float64 (M,).

    Parameters
    ----------
    weights : float64 (K,)
    means, sds : float64 (K, M), of each part
    """
    low, high = (_mixture_quantile(weights, means, sds, tail) for tail in ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
    return low, high


def _mixture_quantile(weights: Array, means: Array, sds: Array, share: float) -> Array:
    """Find a quantile by bisection between limits that hold it for every part."""
    reach = abs(float(ndtri(share))) + 1
    low, high = (means - reach * sds).min(axis=0), (means + reach * sds).max(axis=0)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        is_below = weights @ ndtr((middle - means) / sds) < share
        low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
    return np.asarray((low + high) / 2)


def opposite_sign(weights: Array, means: Array, sds: Array) -> Array:
    """Return twice the probability that a quantity has the other sign than is likely: a two-sided p-value, (M,).

    Parameters
    ----------
    weights, means, sds : as in `mixture_interval`
    """
    below = weights @ ndtr(-means / sds)
    return np.asarray(2 * np.minimum(below, 1 - below))

"""Fit scores with the Bradley-Terry model: maximum likelihood with ties and order effect; standard errors take
participants, not votes, as the sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from app.analysis.conjugate_gradients import maximise_many_items
from app.analysis.counts import PairCounts, count_pairs, outcome_index
from app.analysis.existence import Existence, ford, recession
from app.analysis.newton import Design, Search, maximise
from app.analysis.penalised import maximise_firth
from app.analysis.ties import TIE_MODELS, WITHOUT_TIES, TieModel
from app.analysis.votes_table import VotesTable, numbered

Array = NDArray[np.float64]

LARGEST_COVARIANCE = 3000  # parameters; beyond, the covariance matrix takes minutes and a gigabyte
MANY_ITEMS = 100  # above, Newton's steps are cheaper by conjugate gradients
ALIKE = 1e-12  # a variance between participants below this share of their votes' variance is rounding
LARGEST_FIRTH = 300  # parameters; each step inverts a matrix
ROWS_TOGETHER = 1_000_000  # votes looked up at once, which bounds the memory
RIDGE = 0.1  # penalty where Firth's correction does not apply (Rao-Kupper, many parameters)


class ConvergenceError(RuntimeError):
    """The maximum exists, and Newton's method did not reach it."""


@dataclass(frozen=True)
class Fit:
    """A model fitted to one table of votes.

    Parameters
    ----------
    items : the items (or factor levels) compared
    ties : key of `TIE_MODELS`
    status : `ok`, `separated` (no finite maximum: the numbers are those of `penalty`) or `disconnected` (no numbers)
    groups : islands of items if `disconnected`; if `separated`, groups in descending order that votes set apart
    penalty : name of the penalised estimate that stands in for a maximum
    theta : float64 (P,), log-odds: scores with sum zero (or effects), then order effect and tie parameter, each if
        present
    participant_covariance : float64 (P, P), sandwich estimate clustered by participant
    n_participants : None where they are unknown
    """

    items: tuple[str, ...]
    ties: str
    status: str
    groups: tuple[tuple[str, ...], ...]
    penalty: str | None
    counts: PairCounts
    design: Design
    theta: Array | None = None
    participant_covariance: Array | None = None
    n_participants: int | None = None
    iterations: int = 0

    @property
    def scores(self) -> Array | None:
        """Scores of the items, float64 (n,), log-odds."""
        if self.theta is None:
            return None
        effects = self.theta[: self.design.n_effects]
        return effects if self.design.levels is None else self.design.levels @ effects

    @cached_property
    def covariance(self) -> Array | None:
        """Covariance of the parameters from the observed information, float64 (P, P)."""
        if self.theta is None or self.design.n_parameters > LARGEST_COVARIANCE:
            return None
        by_pair = self.design.model.derivatives(*self._predictors, *self._table)
        return self.design.covariance(self.design.information(by_pair)[0])

    @cached_property
    def expected(self) -> Array | None:
        """Expected wins, losses and ties of each pair, float64 (3, C)."""
        if self.theta is None:
            return None
        result: Array = self.design.model.probabilities(*self._predictors)[:, 0] * self.counts.totals
        return result

    @property
    def loglik(self) -> float | None:
        """Log-likelihood without combinatorial constants."""
        if self.theta is None:
            return None
        return float(self.design.model.loglik(*self._predictors, *self._table).sum())

    @property
    def deviance(self) -> float | None:
        """Twice the log-likelihood by which the saturated model exceeds this one."""
        if self.expected is None:
            return None
        observed = np.stack([self.counts.wins, self.counts.losses, self.counts.ties])
        seen = observed > 0
        return float(2 * np.sum(observed[seen] * np.log(observed[seen] / self.expected[seen])))

    @property
    def pearson_x2(self) -> float | None:
        """Sum of (observed - expected)^2 / expected over the possible outcomes of all pairs."""
        if self.expected is None:
            return None
        possible = 2 + self.design.has_tie
        observed = np.stack([self.counts.wins, self.counts.losses, self.counts.ties])[:possible]
        expected = self.expected[:possible]
        return float(np.sum((observed - expected) ** 2 / expected))

    @property
    def df(self) -> int | None:
        """Residual degrees of freedom of the table of pairs."""
        if self.theta is None:
            return None
        return (1 + self.design.has_tie) * len(self.counts.first) - self.design.n_free

    @property
    def _predictors(self) -> tuple[Array, Array]:
        assert self.theta is not None
        return self.design.predictors(self.theta[None])

    @property
    def _table(self) -> tuple[Array, Array, Array]:
        return self.counts.wins[None], self.counts.losses[None], self.counts.ties[None]

    @property
    def order_effect(self) -> float | None:
        """Log-odds gained by the item shown first."""
        return self._parameter(self.design.n_effects) if self.design.has_order else None

    @property
    def tie_parameter(self) -> float | None:
        """The value of log nu or log theta; None without such a parameter or without a finite maximum."""
        if TIE_MODELS[self.ties].parameter is None or self.theta is None:
            return None
        if not self.design.has_tie:
            return 0.0 if self.ties == "rao-kupper" else None
        has_decided = bool((self.counts.wins + self.counts.losses).any())
        return self._parameter(-1) if has_decided else None

    def preference(self, difference: Array) -> Array:
        """Return the probability that the first of two items is preferred, given a preference.

        In Davidson's model it does not depend on how often there is none; in Rao and Kupper's it does.

        Parameters
        ----------
        difference : float64 (…), log-odds, first score less second
        """
        assert self.theta is not None
        tie = self.theta[-1] if self.design.has_tie else 0.0
        win, loss, _ = self.design.model.probabilities(difference, np.full_like(difference, tie))
        result: Array = win / (win + loss)
        return result

    def error(self, parameter: int, *, by_participant: bool = False) -> float | None:
        """Return the standard error of a parameter, log-odds."""
        covariance = self.participant_covariance if by_participant else self.covariance
        return None if covariance is None else float(np.sqrt(covariance[parameter, parameter]))

    @property
    def p_value(self) -> float | None:
        """P-value of the goodness of fit by Pearson's X2; the deviance test would reject too often."""
        if self.pearson_x2 is None or not self.df:
            return None
        return float(chi2.sf(self.pearson_x2, self.df))

    def _parameter(self, index: int) -> float | None:
        return None if self.theta is None else float(self.theta[index])


def fit_scores(
    votes: VotesTable,
    *,
    ties: str = "davidson",
    order_effect: bool = False,
    levels: Array | None = None,
    penalty: str = "firth",
) -> Fit:
    """Fit scores to votes by maximum likelihood.

    Parameters
    ----------
    votes : VotesTable; every one of its items is fitted, so leave out the others with `only_compared`
    ties : key of `TIE_MODELS`
    order_effect : add the advantage of the item shown first
    levels : float64 (n, q), makes the items' scores `levels @ effects`
    penalty : the estimate where no maximum exists: `firth`, or `ridge`, which also replaces Firth's with Rao and
        Kupper's ties and with very many parameters

    Returns
    -------
    Fit, whose `status` names every way in which a maximum can fail to exist

    Raises
    ------
    ConvergenceError
        If the maximum exists and Newton's method did not reach it.

    Source
    ------
    Bradley and Terry (1952); Davidson (1970); Davidson and Beaver (1977); Rao and Kupper (1967).
    """
    fit = fit_pairs(votes, ties=ties, order_effect=order_effect, levels=levels, penalty=penalty)
    if fit.theta is None or not votes.has_participants:
        return fit
    sandwich = None if fit.penalty else participant_covariance(fit, votes)
    return replace(fit, participant_covariance=sandwich, n_participants=votes.n_voters)


def fit_pairs(
    votes: VotesTable,
    *,
    ties: str = "davidson",
    order_effect: bool = False,
    levels: Array | None = None,
    penalty: str = "firth",
) -> Fit:
    """Fit scores as `fit_scores` does, without what is known about participants.

    Parameters
    ----------
    votes, ties, order_effect, levels, penalty : as in `fit_scores`
    """
    counts = _counted(count_pairs(votes, is_ordered=order_effect), TIE_MODELS[ties])
    return fit_counts(counts, votes.items, ties=ties, levels=levels, penalty=penalty)


def fit_counts(
    counts: PairCounts, items: tuple[str, ...], *, ties: str, levels: Array | None = None, penalty: str | None = "firth"
) -> Fit:
    """Fit scores to counts, as `fit_scores` does to votes; without participants.

    Parameters
    ----------
    counts : PairCounts, after `TieModel.counted`
    items : names of the items
    ties : key of `TIE_MODELS`
    levels : float64 (n, q), makes the items' scores `levels @ effects`
    penalty : the estimate where no maximum exists; None: no numbers then
    """
    has_tie = bool(TIE_MODELS[ties].parameter and counts.ties.any())
    design = Design(counts, TIE_MODELS[ties] if has_tie else WITHOUT_TIES, has_tie, levels)
    existence, is_certain = _existence(counts, design)
    fit = Fit(items, ties, existence.status, _named(existence, items), None, counts=counts, design=design)
    if existence.status == "disconnected":
        return fit
    if existence.status == "separated":
        return _penalised(fit, penalty)
    return _maximum(fit, penalty, is_certain=is_certain)


def _counted(counts: PairCounts, model: TieModel) -> PairCounts:
    wins, losses, ties = model.counted(counts.wins, counts.losses, counts.ties)
    seen = wins + losses + ties > 0
    return PairCounts(
        counts.n_items, counts.first[seen], counts.second[seen], wins[seen], losses[seen], ties[seen], counts.is_ordered
    )


def _named(existence: Existence, items: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(items[index] for index in group) for group in existence.groups)


def _existence(counts: PairCounts, design: Design) -> tuple[Existence, bool]:
    """Return the status of the maximum, and whether it was proved."""
    n = counts.n_items
    if not design.n_parameters:
        return Existence("ok", (tuple(range(n)),)), True
    graph = ford(counts)
    if design.levels is None and graph.status == "disconnected":
        return graph, True
    both_ways = (counts.wins > 0) & (counts.losses > 0)
    if design.levels is not None or design.has_order:
        if both_ways.any() and is_identified(design, both_ways):  # what went both ways cannot grow without limit
            return Existence("ok", (tuple(range(n)),)), True
        if not is_identified(design):
            return Existence("disconnected", (tuple(range(n)),)), True
    if design.levels is None and graph.status == "separated":
        return graph, True
    if design.levels is None and not design.has_order and (both_ways.any() or not design.has_tie):
        return graph, True
    tie_effects = design.tie_effects if design.has_tie else None
    is_checked, direction = recession(counts, design.effects, tie_effects, n_scores=design.n_effects)
    if direction is None:
        return Existence("ok", (tuple(range(n)),)), is_checked
    scores = direction[: design.n_effects]
    return Existence("separated", _by_direction(scores if design.levels is None else design.levels @ scores)), True


def is_identified(design: Design, seen: NDArray[np.bool_] | None = None) -> bool:
    """Do the pairs tell the scores (or effects) and the order effect apart?

    Parameters
    ----------
    seen : bool (C,), the pairs that have votes; all by default
    """
    if not design.n_parameters:
        return True
    effects = design.effects if seen is None else design.effects[np.flatnonzero(seen)]
    gram = (effects.T @ effects).toarray()
    n_wanted = design.n_free - design.has_tie
    return bool(np.linalg.matrix_rank(gram, hermitian=True) == n_wanted)


def _by_direction(direction: Array) -> tuple[tuple[int, ...], ...]:
    rounded = np.round(direction, 6)
    return tuple(tuple(np.flatnonzero(rounded == value).tolist()) for value in np.unique(rounded)[::-1])


def _maximum(fit: Fit, penalty: str | None, *, is_certain: bool) -> Fit:
    counts, design = fit.counts, fit.design
    table = counts.wins, counts.losses, counts.ties
    if not design.n_parameters:
        return _described(fit, np.zeros(0), 0)
    if _is_for_gradients(design):
        maximum = maximise_many_items(design, *table)
    else:
        maximum = maximise(design, *(part[None] for part in table))
    if not maximum.converged[0]:
        if not is_certain:
            return _penalised(replace(fit, status="separated"), penalty)
        raise ConvergenceError(
            f"the scores of {len(fit.items)} items did not converge in {maximum.iterations} iterations "
            "although a maximum exists"
        )
    return _described(fit, maximum.theta[0], maximum.iterations)


def _is_for_gradients(design: Design) -> bool:
    return design.counts.n_items > MANY_ITEMS and design.levels is None and not design.has_order


def _penalised(fit: Fit, penalty: str | None) -> Fit:
    if penalty is None:
        return fit
    counts, design = fit.counts, fit.design
    if penalty == "firth" and design.model.is_canonical and design.n_parameters <= LARGEST_FIRTH:
        theta, iterations = maximise_firth(design, counts)
        return _described(replace(fit, penalty="firth"), theta, iterations)
    table = counts.wins, counts.losses, counts.ties
    if _is_for_gradients(design):
        maximum = maximise_many_items(design, *table, ridge=RIDGE)
    else:
        maximum = maximise(design, *(part[None] for part in table), search=Search(ridge=RIDGE))
    return _described(replace(fit, penalty=f"ridge {RIDGE}"), maximum.theta[0], maximum.iterations)


def _described(fit: Fit, theta: Array, iterations: int) -> Fit:
    """Add the parameters, shifting scores to sum exactly to zero."""
    n = fit.design.n_effects
    shift = theta[:n].mean() if fit.design.levels is None else 0.0  # effects of factors keep their zero
    return replace(fit, theta=np.r_[theta[:n] - shift, theta[n:]], iterations=iterations)


def participant_covariance(fit: Fit, votes: VotesTable) -> Array | None:
    """Return the covariance of the parameters with participants as the independent units.

    It is the sandwich: inverse information x sum of outer products of the participants' gradients x inverse
    information, times J / (J - 1).

    Returns
    -------
    covariance : float64 (P, P); None with a single participant, without a covariance to start from, or if all
        participants voted alike

    Source
    ------
    Liang and Zeger (1986).
    """
    if fit.covariance is None:
        return None
    gradients = participant_gradients(fit, votes)
    n = len(gradients)
    if n < 2:
        return None
    influence = gradients @ fit.covariance  # (J, P)
    result: Array = influence.T @ influence * n / (n - 1)
    is_degenerate = bool((np.diag(result) <= ALIKE * np.diag(fit.covariance)).any())
    return None if is_degenerate else result


def participant_gradients(fit: Fit, votes: VotesTable) -> Array:
    """Return each participant's part of the gradient at the maximum, float64 (J, P), for participants with votes.

    A vote's part depends on its pair and outcome alone, and is looked up.
    """
    design, n = fit.design, fit.counts.n_items
    by_d, by_t = _slopes(fit)
    people, who = numbered(votes.participant, len(votes.participants))
    size = len(people)
    scores, sums_d, sums_t = np.zeros(size * n), np.zeros(size), np.zeros(size)
    for start in range(0, len(votes), ROWS_TOGETHER):
        rows = slice(start, start + ROWS_TOGETHER)
        first, second, outcome = outcome_index(votes.where(rows), is_ordered=design.has_order)
        place, person = (outcome * n + first) * n + second, who[rows]
        slope = by_d[place] * votes.count[rows]
        scores += np.bincount(person * n + first, slope, size * n) - np.bincount(person * n + second, slope, size * n)
        sums_d += np.bincount(person, slope, size)
        sums_t += (
            np.bincount(person, by_t[place] * votes.count[rows], size) if design.has_tie or design.has_order else 0
        )
    columns = [scores.reshape(size, n) if design.levels is None else scores.reshape(size, n) @ design.levels]
    if design.has_order:
        columns.append((sums_d + design.model.order_in_t * sums_t)[:, None])
    if design.has_tie:
        columns.append(sums_t[:, None])
    return np.concatenate(columns, axis=1)


def _slopes(fit: Fit) -> tuple[Array, Array]:
    """Return the slopes in d and t of a vote's log-likelihood, float64 (3 n n,), by outcome, first and second item."""
    assert fit.theta is not None
    n, design = fit.counts.n_items, fit.design
    first, second = (index.ravel() for index in np.indices((n, n)))
    nothing = np.zeros(n * n)
    every = Design(
        PairCounts(n, first, second, nothing, nothing, nothing, design.has_order),
        design.model,
        design.has_tie,
        design.levels,
    )
    d, t = every.predictors(fit.theta[None])
    single = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n * n))  # which outcome, by outcome
    slopes = design.model.derivatives(d, t, *TIE_MODELS[fit.ties].counted(*single))
    return np.ravel(slopes.d), np.ravel(np.broadcast_to(slopes.t, slopes.d.shape))


def only_compared(votes: VotesTable) -> VotesTable:
    """Return the table without the items that no row compares."""
    seen = np.zeros(len(votes.items), bool)
    seen[votes.item_a] = seen[votes.item_b] = True
    if seen.all():
        return votes
    index = np.cumsum(seen).astype(np.int32) - np.int32(1)
    items = tuple(name for name, is_seen in zip(votes.items, seen, strict=True) if is_seen)
    return replace(votes, items=items, item_a=index[votes.item_a], item_b=index[votes.item_b])

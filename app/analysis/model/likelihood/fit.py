"""Hold a fit of scores to votes: its parameters, their errors, and how well it describes the votes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.model.likelihood.newton import Design
from app.analysis.model.likelihood.ties import TIE_MODELS

Array = NDArray[np.float64]

RANKED_TO = 7  # decimals of scores that are ranked; a penalised fit stops within 1e-8 or so of its maximum
ALIKE = 1e-12  # a variance between participants below this share of their votes' variance is rounding
CERTAIN = 100.0  # log-odds; beyond, a preference is 0 or 1 to all digits, and far beyond exponentials overflow
LARGEST_COVARIANCE = 3000  # parameters; beyond, the covariance matrix takes minutes and a gigabyte


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

    @property
    def ranked_scores(self) -> Array | None:
        """Scores in which items that are equal but for rounding errors are equal, float64 (n,), log-odds."""
        return None if self.scores is None else np.round(self.scores, RANKED_TO)

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
        near = np.clip(difference, -CERTAIN, CERTAIN)
        win, loss, _ = self.design.model.probabilities(near, np.full_like(near, tie))
        result: Array = win / (win + loss)
        return result

    def error(self, parameter: int, *, by_participant: bool = False) -> float | None:
        """Return the standard error of a parameter, log-odds; None where all participants agree on it exactly."""
        covariance = self.participant_covariance if by_participant else self.covariance
        if covariance is None or self.covariance is None:
            return None
        variance, of_votes = covariance[parameter, parameter], self.covariance[parameter, parameter]
        return None if by_participant and variance <= ALIKE * of_votes else float(np.sqrt(variance))

    @property
    def p_value(self) -> float | None:
        """P-value of the goodness of fit by Pearson's X2; the deviance test would reject too often."""
        if self.pearson_x2 is None or not self.df:
            return None
        return float(chi2.sf(self.pearson_x2, self.df))

    def _parameter(self, index: int) -> float | None:
        return None if self.theta is None else float(self.theta[index])

"""Choose the most informative pairs for each participant of a study with many conditions (active sampling).

With six conditions every pair is shown and nothing is gained; with fifteen or more, votes on pairs that are already
decided are wasted. Each participant gets a batch per dataset, chosen from the votes so far.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from app.study.option_fields import SettingError
from app.study.trial.trial import PlannedPair

Array = NDArray[np.float64]

FEWEST_CONDITIONS = 15  # below, adaptive selection has no clear gain over showing every pair
PRIOR_SD = 1.5  # log-odds, of a score before any vote
TIE_LOG_NU = float(np.log(0.5))  # between equals, one vote in five is no preference
NEWTON_STEPS = 25
CONVERGED = 1e-6
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
WEIGHTS = WEIGHTS / WEIGHTS.sum()
JITTER = 1e-9  # relative to the gain; pairs of equal gain are then drawn at random


PairVotes = Mapping[int, tuple[int, int, int]]  # pair's key -> votes for its top, for its bottom, for neither


def check_adaptive(n_pairs: int, n_conditions: int) -> None:
    """Check that a study can choose this many pairs of each dataset adaptively.

    Raises
    ------
    ValueError
        With the reason.
    """
    most = n_conditions * (n_conditions - 1) // 2
    if n_conditions < FEWEST_CONDITIONS:
        raise SettingError(
            "adaptive_pairs",
            f"is {n_pairs} for {n_conditions} conditions: below {FEWEST_CONDITIONS} nothing is gained; "
            "leave it out, and every pair is shown",
        )
    if n_pairs > most:
        raise SettingError(
            "adaptive_pairs", f"is {n_pairs}, expected at most {most}, the pairs of {n_conditions} conditions"
        )


def adaptive_pairs(
    pairs: Sequence[PlannedPair], votes: PairVotes, n_pairs: int, seed: int, slot: int
) -> list[PlannedPair]:
    """Return a participant's pairs: from each dataset the most informative ones after the votes so far, and all
    identical pairs.

    Parameters
    ----------
    pairs : all pairs of the study
    votes : so far; a pair without votes may be missing
    n_pairs : of each dataset; all where there are fewer
    seed : the study's
    slot : the participant's; with the seed it decides between pairs of equal gain
    """
    chosen: set[int] = set()
    for number, dataset in enumerate(dict.fromkeys(pair.dataset for pair in pairs), start=1):
        dataset_pairs = [pair for pair in pairs if pair.dataset == dataset and not pair.is_identical]
        place = {
            stimulus: index
            for index, stimulus in enumerate(sorted({s for pair in dataset_pairs for s in pair.stimuli}))
        }
        wins, ties = np.zeros((len(place), len(place))), np.zeros((len(place), len(place)))
        for pair in dataset_pairs:
            top, bottom = place[pair.top], place[pair.bottom]
            wins[top, bottom], wins[bottom, top], ties[top, bottom] = votes.get(pair.key, (0, 0, 0))
            ties[bottom, top] = ties[top, bottom]
        by_stimuli = {frozenset((place[pair.top], place[pair.bottom])): pair.key for pair in dataset_pairs}
        n_chosen = min(n_pairs, len(dataset_pairs))  # a dataset may lack conditions
        indices = choose_pairs(wins, ties, n_chosen, np.random.default_rng([seed, slot, number]))
        chosen.update(by_stimuli[frozenset(both)] for both in indices)
    return [pair for pair in pairs if pair.is_identical or pair.key in chosen]


def choose_pairs(wins: Array, ties: Array, n_pairs: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Choose pairs for one participant and dataset.

    Parameters
    ----------
    wins : float64 (n, n), votes so far: how often the row was preferred to the column
    ties : float64 (n, n), votes without preference, symmetric
    n_pairs : at most n (n - 1) / 2, each chosen at most once
    rng : Generator

    Returns
    -------
    list of (int, int), the lower index first, in the order in which they were chosen

    Source
    ------
    Chaloner and Verdinelli, "Bayesian experimental design: a review" (1995), A-optimality: the pair that lowers the
    expected sum of the scores' variances most. Mikhailiuk, Wilmot, Perez-Ortiz, Yue and Mantiuk, "Active sampling for
    pairwise comparisons via approximate message passing and information gain maximization" (2020), choose by the gain
    in information about the scores. That was tried first: it prefers chains of close neighbours, which made the scale
    of all scores less certain than random pairs did.
    """
    n = len(wins)
    most = n * (n - 1) // 2
    if not 1 <= n_pairs <= most:
        raise ValueError(f"n_pairs is {n_pairs}, expected 1 to {most} for {n} conditions")
    scores, information = posterior(wins, ties)
    covariance = np.linalg.inv(information)
    covariance = covariance - covariance.mean(axis=0)  # of scores less their mean, as votes tell only differences
    covariance = covariance - covariance.mean(axis=1, keepdims=True)
    first, second = np.triu_indices(n, 1)
    vote = _vote_information(scores[first] - scores[second], _variance(covariance, first, second))
    is_open = np.ones(most, bool)
    chosen: list[tuple[int, int]] = []
    for _ in range(n_pairs):
        scale = 1 / vote + _variance(covariance, first, second)
        gain = np.sum((covariance[:, first] - covariance[:, second]) ** 2, axis=0) / scale
        pair = int(np.argmax(np.where(is_open, gain * (1 + JITTER * rng.random(most)), -np.inf)))
        is_open[pair] = False
        a, b = int(first[pair]), int(second[pair])
        chosen.append((a, b))
        covariance = covariance - np.outer(*[covariance[:, a] - covariance[:, b]] * 2) / scale[pair]
    return chosen


def posterior(wins: Array, ties: Array) -> tuple[Array, Array]:
    """Return the most probable scores, float64 (n,), and the information about them, float64 (n, n).

    The likelihood is Davidson's with a fixed tie parameter, the prior normal.

    Parameters
    ----------
    wins, ties : float64 (n, n), votes
    """
    n = len(wins)
    scores = np.zeros(n)
    prior = np.eye(n) / PRIOR_SD**2
    information = prior
    for _ in range(NEWTON_STEPS):
        mean, variance = _moments(scores[:, None] - scores[None, :])
        total = wins + wins.T + ties
        gradient = ((wins - wins.T) / 2 - total * mean).sum(axis=1) - prior @ scores
        weights = total * variance
        information = np.diag(weights.sum(axis=1)) - weights + prior
        step = np.linalg.solve(information, gradient)
        scores = scores + step / max(1.0, float(np.abs(step).max()))
        if np.abs(step).max() < CONVERGED:
            break
    return scores, information


def _vote_information(difference: Array, variance: Array) -> Array:
    """Return the Fisher information of a vote on each pair about its difference of scores, (C,).

    It is averaged over the distribution of the difference: at the best estimate alone, pairs that once looked
    decided would never be shown again.
    """
    d = difference[:, None] + np.sqrt(variance)[:, None] * NODES  # (C, 15)
    return np.asarray(_moments(d)[1] @ WEIGHTS)


def _probabilities(d: Array) -> Array:
    """Return P(win), P(loss) and P(tie), float64 (3, …), by Davidson (1970)."""
    weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full_like(d, np.exp(TIE_LOG_NU))])
    return np.asarray(weights / weights.sum(axis=0))


def _moments(d: Array) -> tuple[Array, Array]:
    """Return mean and variance of the statistic (win - loss) / 2 of a vote."""
    win, loss, _ = _probabilities(d)
    mean = (win - loss) / 2
    return mean, (win + loss) / 4 - mean**2


def _variance(covariance: Array, first: NDArray[np.intp], second: NDArray[np.intp]) -> Array:
    variances = np.diag(covariance)
    return np.asarray(variances[first] + variances[second] - 2 * covariance[first, second])

"""Plan the number of participants: power and detectable differences by simulating a study and analysing it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.contrasts import SIGNIFICANT, differences, scores_of
from app.analysis.model.scales import LOG_ODDS_PER_JOD
from app.analysis.reading.votes_table import VotesTable, votes_from_indices
from ground.progress import Progress, no_progress

Array = NDArray[np.float64]
Tell = Callable[[], None]

WANTED_POWER = 0.8
LARGEST_EFFECT_JOD = 4.0
HALVINGS = 9  # of the largest effect: to 0.01 JOD
DEFAULT_SPREAD = 0.4  # log-odds; makes clustered errors about 1.4 times the naive ones, as on real panels
DEFAULT_TIE_RATE = 0.2


@dataclass(frozen=True)
class StudySize:
    """Numbers of conditions, datasets and participants of a study."""

    conditions: int
    datasets: int
    participants: int

    def __post_init__(self) -> None:
        for name, fewest in (("conditions", 2), ("datasets", 1), ("participants", 2)):
            if getattr(self, name) < fewest:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {fewest} or more")


@dataclass(frozen=True)
class StudyPlan(StudySize):
    """A study in which every participant judges every pair of conditions on every dataset once.

    Parameters
    ----------
    tie_rate : share of "no preference" between equal conditions
    spread : standard deviation over participants of their opinion of a condition, log-odds
    """

    tie_rate: float = DEFAULT_TIE_RATE
    spread: float = DEFAULT_SPREAD

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.tie_rate < 1:
            raise ValueError(f"tie_rate is {self.tie_rate}, expected 0 or more and less than 1")
        if self.spread < 0:
            raise ValueError(f"spread is {self.spread}, expected 0 or more")

    @property
    def pairs(self) -> int:
        """Number of pairs of each dataset."""
        return self.conditions * (self.conditions - 1) // 2


def plan_study(
    plan: StudyPlan,
    rng: np.random.Generator,
    *,
    effect_jod: float = 0.5,
    replicates: int = 400,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Return the power for a difference of two conditions, and the difference detected with 80 % power.

    Parameters
    ----------
    plan : the study
    rng : Generator
    effect_jod : true difference of two conditions; the others lie halfway between them
    replicates : simulated studies for each power; its standard error is at most 0.5 / sqrt(replicates)
    progress : told what is simulated, how many studies are, and how many will be at most

    Returns
    -------
    dict, with powers and detectable differences for one dataset and for all datasets pooled; None where the power stays
    below 80 % even at the largest difference
    """
    if not 0 < effect_jod < np.inf:
        raise ValueError(f"effect_jod is {effect_jod}, expected a difference above 0")
    sizes = {"one dataset": replace(plan, datasets=1), "all datasets": plan}
    results = []
    for (where, size), seed in zip(sizes.items(), rng.integers(0, 2**63, 2).tolist(), strict=True):
        tell = _teller(progress, f"studies of {where} simulated", replicates * (HALVINGS + 2))
        results.append((power(size, effect_jod, seed, replicates, tell), detectable_jod(size, seed, replicates, tell)))
    (power_single, detectable_single), (power_pooled, detectable_pooled) = results
    return {
        "conditions": plan.conditions,
        "datasets": plan.datasets,
        "participants": plan.participants,
        "tie_rate": plan.tie_rate,
        "spread": plan.spread,
        "votes_per_participant": plan.pairs * plan.datasets,
        "votes": plan.pairs * plan.datasets * plan.participants,
        "replicates": replicates,
        "effect_jod": effect_jod,
        "power_one_dataset": power_single,
        "power_pooled": power_pooled,
        "detectable_jod_one_dataset": detectable_single,
        "detectable_jod_pooled": detectable_pooled,
    }


def _teller(progress: Progress, what: str, total: int) -> Tell:
    """Return what counts the simulated studies, and tells of each."""
    progress(what, 0, total)  # the first may take long
    done = count(1)
    return lambda: progress(what, next(done), total)


def power(plan: StudyPlan, effect_jod: float, seed: int, replicates: int, tell: Tell = no_progress) -> float:
    """Return the share of simulated studies in which the two conditions differ significantly (5 %, t on
    participants).

    Parameters
    ----------
    plan : the study
    effect_jod : true difference of the two conditions
    seed : for the simulated votes
    replicates : simulated studies
    tell : called after each
    """
    rng = np.random.default_rng(seed)
    abilities = np.zeros(plan.conditions)
    abilities[0], abilities[1] = effect_jod * LOG_ODDS_PER_JOD / 2, -effect_jod * LOG_ODDS_PER_JOD / 2
    n_detected = 0
    for _ in range(replicates):
        n_detected += _is_detected(simulate_votes(plan, abilities, rng))
        tell()
    return n_detected / replicates


def _is_detected(votes: VotesTable) -> bool:
    fit = fit_scores(votes)
    if fit.status == "separated":
        return _sign_test(votes) < SIGNIFICANT
    if fit.status != "ok" or fit.participant_covariance is None:
        return False
    return bool(differences(scores_of(fit), np.array([0]), np.array([1])).p_value[0] < SIGNIFICANT)


def _sign_test(votes: VotesTable) -> float:
    """Return the two-sided p-value of how many participants prefer one of the first two conditions to the other.

    It needs no maximum of the likelihood: with enough people, a condition that wins every vote counts as
    detected.
    """
    direct = votes.where((votes.item_a == 0) & (votes.item_b == 1))
    balance = np.bincount(direct.participant, np.array([1, -1, 0])[direct.choice])
    n_decided = int(np.count_nonzero(balance))
    return float(binomtest(int((balance > 0).sum()), n_decided).pvalue) if n_decided else 1.0


def simulate_votes(plan: StudyPlan, abilities: Array, rng: np.random.Generator) -> VotesTable:
    """Simulate votes by Davidson's model; each participant's abilities vary around the given ones.

    Parameters
    ----------
    plan : the study
    abilities : float64 (conditions,), log-odds
    rng : Generator
    """
    n, people = plan.conditions, plan.participants
    personal = abilities + plan.spread * rng.standard_normal((people, n))
    personal -= personal.mean(axis=1, keepdims=True) - abilities.mean()
    low, high = np.triu_indices(n, 1)
    d = np.broadcast_to((personal[:, low] - personal[:, high])[:, None], (people, plan.datasets, plan.pairs)).ravel()
    weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(len(d), 2 * plan.tie_rate / (1 - plan.tie_rate))])
    drawn = rng.random(len(d)) * weights.sum(axis=0)
    choice = (drawn > weights[0]).astype(np.int8) + (drawn > weights[0] + weights[1])
    who, dataset, pair = (part.ravel() for part in np.indices((people, plan.datasets, plan.pairs)))
    names = tuple(map(str, range(people))), tuple(map(str, range(plan.datasets))), tuple(map(str, range(n)))
    return votes_from_indices(who, dataset, low[pair], high[pair], choice, names=names)


def detectable_jod(plan: StudyPlan, seed: int, replicates: int, tell: Tell = no_progress) -> float | None:
    """Return the difference detected with 80 % power; None if it is larger than any considered.

    Every difference uses the same random numbers, so the power rises almost steadily with it.

    Parameters
    ----------
    plan : the study
    seed : for the simulated votes
    replicates : simulated studies for each difference
    tell : called after each study
    """
    low, high = 0.0, LARGEST_EFFECT_JOD
    if power(plan, high, seed, replicates, tell) < WANTED_POWER:
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        is_enough = power(plan, middle, seed, replicates, tell) >= WANTED_POWER
        low, high = (low, middle) if is_enough else (middle, high)
    return high

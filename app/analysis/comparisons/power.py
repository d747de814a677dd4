"""Plan the number of participants: power and detectable differences by simulating a study and analysing it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.comparisons.claims import claim_power, is_untested
from app.analysis.comparisons.datasets_sample import FEWEST_DATASETS
from app.analysis.comparisons.study_plan import PlannedStudy
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.reading.votes_table import VotesTable, votes_from_indices
from app.analysis.screening.careless import FEWEST_PEOPLE, careless_answers
from app.study.planning import CLAIMS, MOST_PARTICIPANTS, REPORTED, Claim
from ground.progress import Progress, no_progress

Array = NDArray[np.float64]
Tell = Callable[[], None]

WANTED_POWER = 0.8
LARGEST_EFFECT = 4.0  # JOD, or grades
PLACES = {"one_dataset": "one dataset", "pooled": "all datasets"}  # part of a key -> what is simulated
CLICKERS, CHECKS, PASSES = 0.1, 5, 0.95  # people who click; identical pairs, as many repeated; passed by honest people
STUDIES_OF_CLICKERS = 20
HALVINGS = 9  # of the largest effect: to 0.01


def plan_study(
    plan: StudyPlan,
    rng: np.random.Generator,
    *,
    effect_jod: float = 0.5,
    replicates: int = 400,
    progress: Progress = no_progress,
    claim: Claim = REPORTED,
) -> dict[str, Any]:
    """Return the plan of a study of votes: as `planned`, with `effect_jod`, `detectable_jod_…` and the ties.

    Parameters
    ----------
    plan, rng, replicates, progress, claim : as in `planned`
    effect_jod : true difference of two conditions; the others lie halfway between them
    """
    if not 0 < effect_jod < np.inf:
        raise ValueError(f"effect_jod is {effect_jod}, expected a difference above 0")
    result = planned(plan, rng, effect_jod, replicates=replicates, progress=progress, claim=claim)
    result["clickers_named"] = clickers_named(plan, effect_jod, rng)
    in_jod = {"effect": "effect_jod"} | {f"detectable_{where}": f"detectable_jod_{where}" for where in PLACES}
    return {in_jod.get(name, name): value for name, value in result.items()}


def planned(
    plan: PlannedStudy,
    rng: np.random.Generator,
    effect: float,
    *,
    replicates: int = 400,
    progress: Progress = no_progress,
    claim: Claim = REPORTED,
) -> dict[str, Any]:
    """Return the power for a claim, the difference claimed with 80 % power, the power of every claim, and the number of
    participants for 80 %.

    Parameters
    ----------
    plan : the study
    rng : Generator
    effect : true difference of two conditions, JOD or grades; the others lie halfway between them
    replicates : simulated studies for each power; its standard error is at most 0.5 / sqrt(replicates)
    progress : told what is simulated, how many studies are, and how many will be at most
    claim : key of `CLAIMS`; by default what the report says of two conditions

    Returns
    -------
    dict, with powers and detectable differences for one dataset and for all datasets pooled (None where the power stays
    below 80 % even at the largest difference), `claims` (what, power and its error) and `participants_wanted`
    """
    if not 0 < effect < np.inf:
        raise ValueError(f"effect is {effect}, expected a difference above 0")
    if claim not in CLAIMS:
        raise ValueError(f"claim is {claim!r}, expected one of {', '.join(CLAIMS)}")
    powers, differences = {}, {}
    sizes = dict(zip(PLACES, (replace(plan, datasets=1), plan), strict=True))
    for (where, size), seed in zip(sizes.items(), rng.integers(0, 2**63, 2).tolist(), strict=True):
        tell = _teller(progress, f"studies of {PLACES[where]} simulated", replicates * (HALVINGS + 2))
        powers[f"power_{where}"] = power(size, effect, seed, replicates, tell, claim=claim)
        differences[f"detectable_{where}"] = detectable(size, seed, replicates, tell, claim=claim)
    return {
        **asdict(plan),
        "votes_per_participant": plan.trials * plan.datasets,
        "votes": plan.trials * plan.datasets * plan.participants,
        "replicates": replicates,
        "effect": effect,
        **powers,
        **differences,
        "claim": claim,
        "claims": claim_rows(plan, effect, seed, replicates),
        "participants_wanted": participants_wanted(plan, effect, seed, replicates, claim=claim),
    }


def claim_rows(plan: PlannedStudy, effect: float, seed: int, replicates: int) -> list[dict[str, Any]]:
    """Return the power of every claim over all datasets, with its Monte Carlo error.

    Parameters
    ----------
    plan : the study
    effect : what is true, as in `claim_power`
    seed : for the simulated studies
    replicates : simulated studies
    """
    rows = []
    for claim, what in CLAIMS.items():
        share = claim_power(plan, claim, effect, seed, replicates)
        error = float(np.sqrt(max(share * (1 - share), 0.25 / replicates) / replicates))
        row: dict[str, Any] = {"claim": claim, "what": what, "power": share, "power_error": error}
        if is_untested(plan, claim):
            row |= {"what": f"{what} (takes {FEWEST_DATASETS} datasets)", "power_error": 0.0}
        rows.append(row)
    return rows


def participants_wanted(
    plan: PlannedStudy, effect: float, seed: int, replicates: int, *, claim: Claim = REPORTED
) -> dict[str, int] | None:
    """Return how many participants make a claim with 80 % power, with limits for the error of the simulation.

    Parameters
    ----------
    plan : the study; its number of participants does not count
    effect : true difference, JOD or grades
    seed : for the simulated studies
    replicates : simulated studies for each number
    claim : key of `CLAIMS`

    Returns
    -------
    dict, `participants`, and `low` and `high`, whose powers are two standard errors away from 80 %; None where even
    `MOST_PARTICIPANTS` do not suffice
    """
    error = 2 * float(np.sqrt(WANTED_POWER * (1 - WANTED_POWER) / replicates))
    powers: dict[int, float] = {}

    def fewest(wanted: float) -> int | None:
        low, high = 1, 4
        while power_of(high) < wanted:
            low, high = high, 2 * high
            if high > MOST_PARTICIPANTS:
                return None
        while high - low > max(1, high // 20):
            middle = (low + high) // 2
            low, high = (low, middle) if power_of(middle) >= wanted else (middle, high)
        return high

    def power_of(n: int) -> float:
        if n not in powers:
            powers[n] = claim_power(replace(plan, participants=n), claim, effect, seed, replicates)
        return powers[n]

    numbers = [fewest(min(wanted, 0.999)) for wanted in (WANTED_POWER, WANTED_POWER - error, WANTED_POWER + error)]
    if numbers[0] is None:
        return None
    return {"participants": numbers[0], "low": numbers[1] or numbers[0], "high": numbers[2] or MOST_PARTICIPANTS}


def _teller(progress: Progress, what: str, total: int) -> Tell:
    """Return what counts the simulated studies, and tells of each."""
    progress(what, 0, total)  # the first may take long
    done = count(1)
    return lambda: progress(what, next(done), total)


def power(
    plan: PlannedStudy,
    effect: float,
    seed: int,
    replicates: int,
    tell: Tell = no_progress,
    *,
    claim: Claim = REPORTED,
) -> float:
    """Return the share of simulated studies in which a claim is made.

    Parameters
    ----------
    plan : the study
    effect : true difference, as in `claim_power`
    seed : for the simulated studies
    replicates : simulated studies
    tell : called after each
    claim : key of `CLAIMS`; by default that two conditions are told apart, as the report says it
    """
    share = claim_power(plan, claim, effect, seed, replicates)
    for _ in range(replicates):
        tell()
    return share


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
    d = np.broadcast_to((personal[:, low] - personal[:, high])[:, None], (people, plan.datasets, plan.trials)).ravel()
    weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(len(d), 2 * plan.tie_rate / (1 - plan.tie_rate))])
    drawn = rng.random(len(d)) * weights.sum(axis=0)
    choice = (drawn > weights[0]).astype(np.int8) + (drawn > weights[0] + weights[1])
    who, dataset, pair = (part.ravel() for part in np.indices((people, plan.datasets, plan.trials)))
    names = tuple(map(str, range(people))), tuple(map(str, range(plan.datasets))), tuple(map(str, range(n)))
    return votes_from_indices(who, dataset, low[pair], high[pair], choice, names=names)


def clickers_named(plan: StudyPlan, effect_jod: float, rng: np.random.Generator) -> dict[str, float] | None:
    """Return which share of people who click at random a report would name, with its Monte Carlo error.

    A tenth of the people click, or the plan's share of careless ones. Honest people see no difference in 95 % of the
    pairs that have none.

    Parameters
    ----------
    plan : the study
    effect_jod : true difference of two conditions; the others lie halfway between them
    rng : Generator

    Returns
    -------
    dict, `by_votes` and `with_checks` (five identical and five repeated pairs), each with `…_error`; None with too few
    people to compare them
    """
    if plan.participants < FEWEST_PEOPLE:
        return None
    n_clickers = max(1, round((plan.careless or CLICKERS) * plan.participants))
    clicks = np.arange(plan.participants) >= plan.participants - n_clickers
    random = np.array([(1 - plan.tie_rate) / 2, (1 - plan.tie_rate) / 2, plan.tie_rate])
    abilities = np.array([0.5, -0.5, *np.zeros(plan.conditions - 2)]) * effect_jod * np.log(3)
    shares: dict[str, list[float]] = {"by_votes": [], "with_checks": []}
    for _ in range(STUDIES_OF_CLICKERS):
        honest, again = (simulate_votes(replace(plan, spread=plan.spread * k), abilities, rng) for k in (1, 0))
        same = np.mean(again.choice == simulate_votes(replace(plan, spread=0.0), abilities, rng).choice)
        drawn = rng.choice(3, len(honest), p=random)
        votes = replace(honest, choice=np.where(clicks[honest.participant], drawn, honest.choice).astype(np.int8))
        identical = rng.binomial(CHECKS, np.where(clicks, plan.tie_rate, PASSES)).tolist()
        repeated = rng.binomial(CHECKS, np.where(clicks, np.sum(random**2), same)).tolist()
        rows = [
            {
                "participant": name,
                "n_identical": CHECKS,
                "n_identical_none": none,
                "n_repeated": CHECKS,
                "n_repeated_same": n,
            }
            for name, none, n in zip(votes.participants, identical, repeated, strict=True)
        ]
        for name, checks in (("by_votes", []), ("with_checks", rows)):
            verdicts = careless_answers(votes, checks)
            named = [verdicts[who].is_named for who, clicked in zip(votes.participants, clicks, strict=True) if clicked]
            shares[name].append(float(np.mean(named)))
    errors = {f"{name}_error": float(np.std(each, ddof=1) / np.sqrt(len(each))) for name, each in shares.items()}
    return {name: float(np.mean(each)) for name, each in shares.items()} | errors


def detectable(
    plan: PlannedStudy, seed: int, replicates: int, tell: Tell = no_progress, *, claim: Claim = REPORTED
) -> float | None:
    """Return the difference detected with 80 % power; None if it is larger than any considered.

    Every difference uses the same random numbers, so the power rises almost steadily with it.

    Parameters
    ----------
    plan : the study
    seed : for the simulated studies
    replicates : simulated studies for each difference
    tell : called after each study
    claim : key of `CLAIMS`
    """
    low, high = 0.0, LARGEST_EFFECT
    if power(plan, high, seed, replicates, tell, claim=claim) < WANTED_POWER:
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        is_enough = power(plan, middle, seed, replicates, tell, claim=claim) >= WANTED_POWER
        low, high = (low, middle) if is_enough else (middle, high)
    return high

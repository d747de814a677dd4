"""Weigh how much likelier a participant's answers are from somebody who answers carelessly than from somebody who
answers as the others do, with opinions and noise of their own.

Evidence comes from attention checks, from votes against the scores of all others, from sides and orders, from the share
of ties, and from speed. What an honest participant does is told by the panel itself: how far opinions differ, how much
tie rates and times vary, how often the others pass the checks. Where conditions hardly differ, honest votes look like
random ones, and then votes say nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.votes_table import VotesTable, numbered
from app.analysis.screening.habits import of_checks, of_sides, of_speed, of_ties
from app.analysis.screening.vote_evidence import FEW, SIMULATED, Panel, against_scores, panel_of

Array = NDArray[np.float64]

FALSE_ALARMS = 0.05  # expected in a whole study of honest people, below which somebody is named
FEWEST_PEOPLE = 5  # fewer tell nothing about what the others do
DRAWS, QUICK = 1200, 150  # honest people whose votes a participant's are compared with, last and before
TRIMMED = (0.0, 1.0, 2.0, 2.0)  # log likelihood ratios, by round, above which somebody does not tell what honest do


@dataclass(frozen=True)
class Careless:
    """What speaks for carelessness of a participant.

    Parameters
    ----------
    log_ratio : natural logarithm of the likelihood ratio, careless to honest
    parts : that of each kind of evidence: votes, checks, ties, sides, speed
    false_alarms : honest people of this study, out of all, expected to look as careless
    words : the evidence, the strongest first
    """

    log_ratio: float
    parts: Mapping[str, float]
    false_alarms: float
    words: tuple[str, ...]

    @property
    def is_named(self) -> bool:
        """Is it to be said of this participant?"""
        return self.log_ratio > 0 and self.false_alarms < FALSE_ALARMS

    def as_dict(self) -> dict[str, Any]:
        """Return it as it stands in analysis.json."""
        return {
            "log_likelihood_ratio": self.log_ratio,
            "evidence": dict(self.parts),
            "false_alarms": self.false_alarms,
            "words": list(self.words),
        }


def careless_answers(
    votes: VotesTable, checks: Sequence[Mapping[str, Any]], order_effect: float | None = None
) -> dict[str, Careless]:
    """Return what speaks for carelessness of each participant.

    Parameters
    ----------
    votes : VotesTable, the votes analysed
    checks : rows of `check_rows`
    order_effect : advantage of being shown first that the whole panel shows, log-odds; None where it shows none
    """
    if not votes.has_participants or not len(votes):
        return {}
    people, who = numbered(votes.participant, len(votes.participants))
    if len(people) < FEWEST_PEOPLE:
        return {}
    names = [votes.participants[index] for index in people]
    kept = np.ones(len(people), bool)
    by_name = {row["participant"]: row for row in checks}
    rng = np.random.default_rng(len(votes))
    panel = panel_of(votes, who, len(people), order_effect)
    for limit in TRIMMED:
        total = _weighed(votes, who, names, by_name, panel, order_effect or 0.0, kept, rng, QUICK).total
        trimmed = total <= limit
        if (trimmed == kept).all() or trimmed.sum() < max(FEWEST_PEOPLE, len(people) / 2):
            break
        kept = trimmed
    evidence = _weighed(votes, who, names, by_name, panel, order_effect or 0.0, kept, rng, DRAWS)
    alarms = false_alarms(_calibration(len(people), evidence) * evidence.chance)
    return {
        name: Careless(
            float(evidence.total[row]),
            {kind: float(values[row]) for kind, values in evidence.parts.items()},
            float(alarms[row]),
            _words(evidence, row),
        )
        for row, name in enumerate(names)
    }


def false_alarms(chance: Array) -> Array:
    """Return how many honest people are expected to look as careless, among all who do not look more careless still.

    Parameters
    ----------
    chance : float64 (J,), that an honest person does

    Source
    ------
    Holm (1979): those who stand out more are no honest people any more when the next is judged.
    """
    order = np.argsort(chance)
    left = np.arange(len(chance), 0, -1)
    alarms = np.empty(len(chance))
    alarms[order] = np.maximum.accumulate(np.minimum(chance[order] * left, left))
    return alarms


def _calibration(n_people: int, evidence: _Evidence) -> float:
    """Return how many times as many honest people are named as their chance says (docs/simulation.md).

    What honest people do is itself uncertain, so eight err twice as often. The chance of the votes of more is a bound,
    which is above the truth.
    """
    few = FEW / n_people
    return float(1 + few**2 if "checks" in evidence.parts else max(2 * few**1.4, 0.4))


@dataclass(frozen=True)
class _Evidence:
    """Log likelihood ratios of J participants, and the chance that an honest one reaches them.

    Parameters
    ----------
    parts : kind -> float64 (J,)
    total : float64 (J,)
    chance : float64 (J,)
    said : kind -> the evidence of each participant in words
    """

    parts: dict[str, Array]
    total: Array
    chance: Array
    said: dict[str, list[str]] = field(default_factory=dict)


def _weighed(
    votes: VotesTable,
    who: NDArray[np.intp],
    names: Sequence[str],
    checks: Mapping[str, Mapping[str, Any]],
    panel: Panel | None,
    order_effect: float,
    kept: NDArray[np.bool_],
    rng: np.random.Generator,
    n_draws: int,
) -> _Evidence:
    """Weigh the evidence, with what the participants that are kept tell about honest ones."""
    n_people = len(names)
    random = np.zeros((SIMULATED,))
    parts: dict[str, Array] = {}
    said: dict[str, list[str]] = {}
    for kind, weighed in (
        ("checks", of_checks(names, checks, kept, rng)),
        ("ties", of_ties(votes, who, n_people, kept, rng)),
        ("speed", of_speed(votes, who, n_people, kept, rng)),
    ):
        if weighed is not None:
            parts[kind], simulated, said[kind] = weighed
            random += simulated
    if panel is not None:
        seen = against_scores(panel, order_effect, kept, rng, n_draws)
        if seen is not None:
            parts["votes"], simulated = seen
            random += simulated
            said["votes"] = [
                f"the votes are {_times(ratio)} likelier from a coin than from the scores of the others"
                for ratio in parts["votes"]
            ]
    total = np.sum(list(parts.values()), axis=0) if parts else np.zeros(n_people)
    chance = _honest_chance(total, random)
    sides = of_sides(votes, who, n_people, parts.get("votes"))
    if sides is not None:
        place, by_side, said["sides"] = sides
        together = total + by_side
        better = together > total
        chance = np.minimum(2 * np.minimum(chance, np.exp(-np.maximum(together, 0.0)) * place), 1.0)
        parts["sides"] = np.where(better, by_side, 0.0)
        total = np.where(better, together, total)
    return _Evidence(parts, total, chance, said)


def _honest_chance(total: Array, random: Array) -> Array:
    """Return the chance that honest people reach a log likelihood ratio, float64 (J,).

    It is the mean, over careless people, of the inverse likelihood ratio of those who reach it; never more than the
    inverse of the ratio itself.
    """
    order = np.sort(random)
    beyond = np.cumsum(np.exp(-order[::-1]))[::-1]  # of the k-th and all larger
    place = np.searchsorted(order, total)
    chance = np.where(place < len(order), beyond[np.minimum(place, len(order) - 1)], 0.0) / len(order)
    bound = np.exp(-np.maximum(total, 0.0))
    return np.minimum(np.maximum(chance, bound / len(order)), bound)


def _times(log_ratio: float) -> str:
    """Return a likelihood ratio in words."""
    return "a million times or more" if log_ratio > np.log(1e6) else f"{np.exp(log_ratio):.0f} times"


def _words(evidence: _Evidence, row: int) -> tuple[str, ...]:
    """Return the evidence for carelessness in words, the strongest first."""
    strongest = sorted(evidence.parts, key=lambda kind: -evidence.parts[kind][row])
    speaking = [kind for kind in strongest if evidence.parts[kind][row] > np.log(2)]
    return tuple(evidence.said[kind][row] for kind in speaking if evidence.said[kind][row])

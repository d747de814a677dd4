"""How often what a report says of people, disagreement, factors and pairs is right, in simulated studies.

`python bench/verdicts.py` prints one line for each row of docs/simulation.md that it fills, with Monte Carlo errors.
Unless a line says otherwise: 22 people, 5 datasets, 6 conditions, 20 % ties between equals, a true range of 1.1 JOD.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))
from arguments import print_families

from app.analysis.comparisons.comparison import compare, votes_on_dataset
from app.analysis.comparisons.datasets_sample import factor_rows, interaction_rows, pair_p_values
from app.analysis.comparisons.factor_fits import factor_fits
from app.analysis.comparisons.factors import fit_additive, votes_with_levels
from app.analysis.comparisons.homogeneity import Part
from app.analysis.model.contrasts import scores_of, simultaneous_factor
from app.analysis.model.settings import AnalysisSettings
from app.analysis.reading.votes_table import (
    ALL,
    IDENTICAL,
    REPEAT,
    VotesTable,
    joined,
    only_compared,
    votes_from_indices,
)
from app.analysis.screening.attention_checks import check_rows
from app.analysis.screening.careless import FALSE_ALARMS, careless_answers
from app.analysis.screening.disagreement import heterogeneity

Array = NDArray[np.float64]
Index = NDArray[np.integer[Any]]
LOG_ODDS_PER_JOD = float(np.log(3))
LARGE = 20_000  # people, whose estimate is the truth of pooled scores


@dataclass(frozen=True)
class Kind:
    """A kind of study.

    Parameters
    ----------
    range_jod : difference of the best and the worst condition
    spread, scene_spread : standard deviation of opinions over people, and of shifts over datasets, log-odds
    camps : does every second person prefer the opposite?
    clickers : people, the last ones, who click at random
    order : advantage of what is shown first, log-odds
    n_checks : identical pairs, and as many repeated ones
    passes : share of identical pairs on which an honest person has no preference
    """

    people: int = 22
    datasets: int = 5
    conditions: int = 6
    range_jod: float = 1.1
    spread: float = 0.4
    scene_spread: float = 0.0
    tie_rate: float = 0.2
    camps: bool = False
    clickers: int = 0
    order: float = 0.0
    n_checks: int = 0
    passes: float = 0.95

    @property
    def abilities(self) -> Array:
        """True scores, log-odds."""
        return np.linspace(0.5, -0.5, self.conditions) * self.range_jod * LOG_ODDS_PER_JOD


class _Drawn(Kind):
    """A kind of study whose scores are given."""

    def __init__(self, drawn: Array, **fields: Any) -> None:
        super().__init__(**fields)
        object.__setattr__(self, "drawn", drawn)

    @property
    def abilities(self) -> Array:
        """True scores, log-odds."""
        return np.asarray(self.__dict__["drawn"])


def drawn_kind(kind: Kind, drawn: Array) -> Kind:
    """Return a kind of study with these true scores, (n,) or on each dataset (D, n)."""
    return _Drawn(drawn, **vars(kind))


def study(kind: Kind, rng: np.random.Generator) -> tuple[VotesTable, Array]:
    """Simulate a study: its votes, and the scores of each person on each dataset (J, D, n)."""
    n, people, datasets = kind.conditions, kind.people, kind.datasets
    sign = np.where(kind.camps & (np.arange(people) % 2 == 1), -1.0, 1.0)[:, None, None]
    scores = sign * (kind.abilities + kind.scene_spread * rng.standard_normal((1, datasets, n)))
    scores = scores + kind.spread * rng.standard_normal((people, 1, n))
    low, high = np.triu_indices(n, 1)
    who, dataset, pair = (part.ravel() for part in np.indices((people, datasets, len(low))))
    turned = rng.random(len(who)) < 0.5
    a, b = np.where(turned, high[pair], low[pair]), np.where(turned, low[pair], high[pair])
    votes = _voted(kind, scores, who, dataset, a, b, rng)
    if kind.n_checks:
        votes = joined([votes, *_checks(kind, scores, votes, rng)])
    return votes, scores


def _voted(
    kind: Kind, scores: Array, who: Index, dataset: Index, a: Index, b: Index, rng: np.random.Generator
) -> VotesTable:
    first = rng.integers(0, 2, len(who))
    d = scores[who, dataset, a] - scores[who, dataset, b] + kind.order * np.where(first == 0, 1, -1)
    tie = 2 * kind.tie_rate / (1 - kind.tie_rate)
    choice = _drawn(np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(len(d), tie)]), rng)
    clicks = who >= kind.people - kind.clickers
    choice = np.where(clicks, _drawn(np.stack([np.full(len(d), w) for w in (0.4, 0.4, 0.2)]), rng), choice)
    names = tuple(f"P{j:03d}" for j in range(kind.people)), tuple(f"d{k}" for k in range(kind.datasets))
    items = tuple(f"C{k}" for k in range(kind.conditions))
    return votes_from_indices(who, dataset, a, b, choice, names=(*names, items), first_shown=first)


def _drawn(weights: Array, rng: np.random.Generator) -> NDArray[np.int8]:
    drawn = rng.random(weights.shape[1]) * weights.sum(axis=0)
    return np.asarray((drawn > weights[0]).astype(np.int8) + (drawn > weights[0] + weights[1]), np.int8)


def _checks(kind: Kind, scores: Array, votes: VotesTable, rng: np.random.Generator) -> Iterator[VotesTable]:
    """Yield each person's identical pairs, and pairs that come back."""
    people, n = np.arange(kind.people).repeat(kind.n_checks), kind.conditions
    item = rng.integers(0, n, len(people))
    same = _voted(kind, scores, people, 0 * people, item, item, rng)
    honest = np.where(rng.random(len(people)) < kind.passes, 2, rng.integers(0, 2, len(people)))
    clicks = people >= kind.people - kind.clickers
    choice = np.where(clicks, same.choice, honest).astype(np.int8)
    yield replace(same, choice=choice, role=np.full(len(people), IDENTICAL, np.int8))
    rows = np.concatenate(
        [rng.choice(np.flatnonzero(votes.participant == j), kind.n_checks, replace=False) for j in range(kind.people)]
    )
    seen = votes.where(rows)
    again = _voted(kind, scores, seen.participant, seen.dataset, seen.item_a, seen.item_b, rng)
    yield replace(again, role=np.full(len(rows), REPEAT, np.int8))


def line(name: str, values: Sequence[float] | Array) -> str:
    """Return the mean of a value of each study in percent, with its Monte Carlo error."""
    known = np.asarray([value for value in values if np.isfinite(value)], float)
    error = known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 1 else np.nan
    return f"{name:<80} {100 * known.mean():5.1f} % +- {100 * error:.1f}  (n = {len(known)})"


HONEST_KINDS = {
    "22 people": Kind(),
    "no difference": Kind(range_jod=0.0),
    "no difference, identical people": Kind(range_jod=0.0, spread=0.0),
    "people differ by 1.0": Kind(spread=1.0),
    "two camps": Kind(camps=True, range_jod=2.0),
    "8 people": Kind(people=8),
    "60 people": Kind(people=60),
    "one dataset": Kind(datasets=1),
    "datasets differ by 0.4": Kind(scene_spread=0.4),
    "order effect of 0.6": Kind(order=0.6),
    "range 3 JOD": Kind(range_jod=3.0),
    "five identical and five repeated pairs": Kind(n_checks=5),
}


def careless_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how many honest people are named, and which share of random clickers, beside an oracle's."""
    for name, kind in HONEST_KINDS.items():
        rng = np.random.default_rng(seed)
        some = [bool(_named(study(kind, rng)[0], kind)) for _ in range(n_studies)]
        yield line(f"honest studies that name somebody: {name}", some)
    for name, kind in {
        "range 1.1 JOD": Kind(clickers=4),
        "range 3 JOD": Kind(range_jod=3.0, clickers=4),
        "range 5 JOD": Kind(range_jod=5.0, clickers=4),
        "five identical and five repeated pairs": Kind(clickers=4, n_checks=5),
        "60 people, 12 clickers, range 3 JOD": Kind(people=60, range_jod=3.0, clickers=12),
    }.items():
        rng = np.random.default_rng(seed)
        ours, oracle, honest = [], [], []
        for _ in range(n_studies):
            votes, _ = study(kind, rng)
            clickers = {f"P{j:03d}" for j in range(kind.people - kind.clickers, kind.people)}
            named = _named(votes, kind)
            ours.append(len(named & clickers) / kind.clickers)
            honest.append(bool(named - clickers))
            oracle.append(_oracle(votes, kind, rng))
        yield line(f"random clickers named: {name}", ours)
        yield line(f"  by an oracle that knows the scores, from votes: {name}", oracle)
        yield line(f"  studies in which an honest person is named: {name}", honest)


def _named(votes: VotesTable, kind: Kind) -> set[str]:
    answers = careless_answers(votes.used(), check_rows(votes), kind.order or None)
    return {name for name, verdict in answers.items() if verdict.is_named}


def _oracle(votes: VotesTable, kind: Kind, rng: np.random.Generator, n_draws: int = 600) -> float:
    """Return the share of clickers whom the true scores and spread tell from honest people, with fewer than .05 false
    alarms expected in the study."""
    used = votes.used()
    used = used.where(used.choice < 2)
    n = kind.conditions
    own = kind.abilities + kind.spread * rng.standard_normal((n_draws, n))
    low, high = np.triu_indices(n, 1)
    place = np.zeros((n, n), int)
    place[low, high] = np.arange(len(low))
    cell = place[np.minimum(used.item_a, used.item_b), np.maximum(used.item_a, used.item_b)]
    size = kind.people * len(low)
    wins, losses = (
        np.bincount(used.participant * len(low) + cell, used.prefers_lower == side, size).reshape(kind.people, -1) * 1.0
        for side in (True, False)
    )
    d = own[:, low] - own[:, high]

    def ratio(wins: Array, votes: Array) -> Array:
        loglik = wins @ d.T - votes @ np.log1p(np.exp(d)).T
        return np.asarray(-np.log(2) * votes.sum(axis=1) - (logsumexp(loglik, axis=1) - np.log(n_draws)))

    n_votes = np.asarray(wins + losses, np.float64)
    design = n_votes[rng.integers(0, kind.people, 1000)]
    random = np.sort(ratio(rng.binomial(design.astype(int), 0.5).astype(float), design))
    beyond = np.cumsum(np.exp(-random[::-1]))[::-1] / len(random)
    found = ratio(np.asarray(wins, np.float64), n_votes)[kind.people - kind.clickers :]
    chance = np.append(beyond, beyond[-1] if len(beyond) else 1.0)[np.searchsorted(random, found)]
    return float(np.mean(kind.people * np.minimum(chance, np.exp(-np.maximum(found, 0))) < FALSE_ALARMS))


def disagreement_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often people are said to disagree, and to form camps."""
    for name, kind in {
        "identical people, 8": Kind(spread=0.0, people=8),
        "identical people, 22": Kind(spread=0.0),
        "identical people, 60": Kind(spread=0.0, people=60),
        "opinions of 0.4, 22": Kind(),
        "opinions of 1.0, 8": Kind(spread=1.0, people=8),
        "opinions of 1.0, 22": Kind(spread=1.0),
        "opinions of 1.0, 60": Kind(spread=1.0, people=60),
        "four clickers of 22, range 3 JOD": Kind(range_jod=3.0, clickers=4),
        "two camps, range 1.1 JOD, 22": Kind(camps=True),
        "two camps, range 2 JOD, 22": Kind(camps=True, range_jod=2.0),
    }.items():
        rng = np.random.default_rng(seed)
        rows = [heterogeneity(study(kind, rng)[0]) for _ in range(n_studies)]
        yield line(f"people disagree: {name}", [row is not None and row["p_value"] < 0.05 for row in rows])
        yield line(f"  two camps: {name}", [row is not None and row["camps"] is not None for row in rows])


FACTORS = {
    "depth": dict(zip([f"C{k}" for k in range(6)], "aabbcc", strict=True)),
    "fusion": dict(zip([f"C{k}" for k in range(6)], "xyxyxy", strict=True)),
}


WITHOUT_EFFECTS = {
    "22 people": Kind(range_jod=0.0, scene_spread=0.4),
    "60 people": Kind(range_jod=0.0, scene_spread=0.4, people=60),
    "22 people who differ by 1.0": Kind(range_jod=0.0, scene_spread=0.4, spread=1.0),
    "22 people, 3 datasets": Kind(range_jod=0.0, scene_spread=0.4, datasets=3),
    "22 people, datasets alike": Kind(range_jod=0.0),
}


def dataset_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often effects are said to hold for datasets like these, where none does."""
    settings = AnalysisSettings(factors=FACTORS)
    few = {"8 people": Kind(range_jod=0.0, scene_spread=0.4, people=8)}
    for name, kind in (few | WITHOUT_EFFECTS).items():
        rng, hits = np.random.default_rng(seed), dict[str, list[float]]()
        for _ in range(n_studies):
            votes, _ = study(kind, rng)
            compared = list(compare(votes, settings))
            _, _, additive = factor_fits(votes, settings, compared)
            for row in (*factor_rows(additive, FACTORS), *interaction_rows(compared, additive)):
                hits.setdefault(row["name"], []).append(row["p_value"] < 0.05)
            pairs = pair_p_values(compared).values()
            hits.setdefault("any of 15 pairs (Holm)", []).append(any(p_holm < 0.05 for _, p_holm in pairs))
        for what, values in hits.items():
            yield line(f"for datasets like these, {name}: {what}", values)


def factor_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often factors without an effect are said to have one for datasets like these."""
    for name, kind in WITHOUT_EFFECTS.items():
        rng, hits = np.random.default_rng(seed), dict[str, list[float]]()
        for _ in range(n_studies):
            votes = votes_with_levels(study(kind, rng)[0], FACTORS)
            parts = {name: only_compared(votes_on_dataset(votes, name)) for name in (*votes.datasets, ALL)}
            fits = {
                name: fit_additive(part, FACTORS, ties="davidson", order_effect=False) for name, part in parts.items()
            }
            additive = {
                name: Part(parts[name], fit) for name, fit in fits.items() if fit is not None and fit.status == "ok"
            }
            for row in factor_rows(additive, FACTORS):
                hits.setdefault(row["name"], []).append(row["p_value"] < 0.05)
        for what, values in hits.items():
            yield line(f"for datasets like these, {name}: {what}", values)


def extreme_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often the interval of the best against the worst condition holds the truth, where it is printed."""
    settings = AnalysisSettings(by_dataset=False)
    for people in (8, 22, 60):
        for range_jod in (0.0, 0.5, 1.1):
            kind = Kind(people=people, range_jod=range_jod, datasets=2)
            large, _ = study(replace(kind, people=20_000), np.random.default_rng(seed))
            (fitted,) = compare(large, settings)
            truth = {(row.item_a, row.item_b): row.difference for row in fitted.contrasts}
            rng, alone, together, printed = np.random.default_rng(seed), [], [], []
            for _ in range(n_studies):
                (comparison,) = compare(study(kind, rng)[0], settings)
                if comparison.fit.status != "ok":
                    continue
                wider = simultaneous_factor(scores_of(comparison.fit))
                row = max(comparison.contrasts, key=lambda row: abs(row.difference))
                if row.ci_low is None or row.ci_high is None:
                    continue
                half = (row.ci_high - row.ci_low) / 2
                miss = abs(row.difference - truth[row.item_a, row.item_b])
                alone.append(miss <= half)
                together.append(miss <= wider * half)
                if any(each.p_holm < 0.05 for each in comparison.contrasts):
                    printed.append(miss <= wider * half)
            where = f"{people} people, range {range_jod} JOD"
            yield line(f"best against worst, {where}, interval of one pair", alone)
            yield line(f"best against worst, {where}, simultaneous", together)
            yield line(f"best against worst, {where}, simultaneous, where printed", printed)


FAMILIES: dict[str, Callable[[int, int], Iterator[str]]] = {
    "careless": careless_lines,
    "disagreement": disagreement_lines,
    "datasets": dataset_lines,
    "factors": factor_lines,
    "extreme": extreme_lines,
}


if __name__ == "__main__":
    print_families(__doc__, FAMILIES, studies=400)

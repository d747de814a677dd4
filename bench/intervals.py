"""How often intervals hold the truth, and how often tests reject what is true, in simulated studies.

`python bench/intervals.py` prints one line for each, with its Monte Carlo error; docs/simulation.md quotes them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))
from arguments import print_families

from app.analysis.analyse import group_comparisons
from app.analysis.comparisons.comparison import compare
from app.analysis.comparisons.factor_fits import factor_results
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.random_effect_rows import random_effect_tables
from app.analysis.comparisons.result_rows import contrast_rows, score_rows
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.model.settings import AnalysisSettings
from app.analysis.reading.votes_table import NONE, VotesTable, joined
from app.analysis.screening.agreement import concordance_p_value
from app.analysis.screening.observers import observer_rows
from app.analysis.screening.triads import Triads, pooled_p_value, triads

ABILITIES = np.linspace(-0.8, 0.8, 6)
LARGE = 100_000  # participants whose votes give the scores that a study estimates
FACTORS = {  # of six conditions
    "depth": dict(zip("012345", "aabbcc", strict=True)),
    "fusion": dict(zip("012345", "xyxyxy", strict=True)),
}


def share_line(name: str, hits: Sequence[Sequence[bool]]) -> str:
    """Return the share of hits in percent with its Monte Carlo error over studies."""
    by_study = np.array([np.mean(study) for study in hits if len(study)])
    error = by_study.std(ddof=1) / np.sqrt(len(by_study))
    return f"{name:<70} {100 * by_study.mean():5.1f} % +- {100 * error:.1f}"


def interval_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print the coverage of intervals of scores over two datasets, where people differ as usual and much."""
    for participants, spread in ((8, 0.4), (22, 0.4), (60, 0.4), (22, 1.0)):
        plan = StudyPlan(6, 2, participants, spread=spread)
        truth = _estimated(simulate_votes(replace(plan, participants=LARGE), ABILITIES, np.random.default_rng(seed)))
        hits: dict[str, list[list[bool]]] = {}
        rng = np.random.default_rng(seed)
        for _ in range(n_studies):
            votes = simulate_votes(plan, ABILITIES, rng)
            for name, covered in _coverage(votes, truth).items():
                hits.setdefault(name, []).append(covered)
        where = f"{participants} participants, spread {spread}"
        yield from (share_line(f"coverage, {where}, {name}", is_held) for name, is_held in hits.items())


def _estimated(votes: VotesTable) -> dict[str, list[float]]:
    """Return what is estimated of many participants: scores, JOD by Thurstone and differences."""
    (comparison,) = compare(votes, AnalysisSettings(by_dataset=False))
    rows = list(score_rows(comparison))
    names = ("score", "jod_thurstone")
    return {name: [row[name] for row in rows] for name in names} | {
        "difference": [row.difference for row in comparison.contrasts]
    }


def _coverage(votes: VotesTable, truth: dict[str, list[float]]) -> dict[str, list[bool]]:
    """Return which intervals hold the truth, by their kind."""
    (plain,) = compare(votes, AnalysisSettings(by_dataset=False))
    (drawn,) = compare(votes, AnalysisSettings(by_dataset=False, bootstrap=1000))
    scores, (tables, _) = list(score_rows(plain)), random_effect_tables([plain], "participants")
    differences = np.subtract.outer(ABILITIES, ABILITIES)[np.triu_indices(len(ABILITIES), 1)]
    return {
        "t": _holds(scores, "ci", truth["score"]),
        "bootstrap 1000": _holds(score_rows(drawn), "ci", truth["score"]),
        "JOD by Thurstone": _holds(scores, "jod_thurstone", truth["jod_thurstone"]),
        "differences, t": _holds(contrast_rows(plain), "ci", truth["difference"]),
        "random effects": _holds(tables["random_effects_scores"], "ci", ABILITIES),
        "differences, random effects": _holds(tables["random_effects_contrasts"], "ci", differences),
    }


def _holds(rows: Iterable[Mapping[str, Any]], name: str, truth: Iterable[float]) -> list[bool]:
    """Return whether each interval holds the truth; one with a single limit is a bound."""
    limits = [(row[f"{name}_low"], row[f"{name}_high"], value) for row, value in zip(rows, truth, strict=True)]
    known = [(low, high, value) for low, high, value in limits if low is not None or high is not None]
    return [(low is None or low <= value) and (high is None or value <= high) for low, high, value in known]


def dataset_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print the coverage of intervals of scores for datasets at large, whose scores are shifted by 0.4 log-odds."""
    for n_datasets in (5, 10):
        rng = np.random.default_rng(seed)
        plan = StudyPlan(6, 1, 22)
        hits: tuple[list[list[bool]], list[list[bool]]] = ([], [])
        for _ in range(n_studies):
            votes = _on_datasets(plan, n_datasets, rng)
            (comparison,) = compare(votes, AnalysisSettings(by_dataset=False))
            tables, _ = random_effect_tables([comparison], "participants,datasets")
            hits[0].append(_holds(score_rows(comparison), "ci", ABILITIES))
            hits[1].append(_holds(tables["random_effects_scores"], "ci", ABILITIES))
        yield share_line(f"coverage for other datasets, {n_datasets} datasets, t", hits[0])
        yield share_line(f"coverage for other datasets, {n_datasets} datasets, random effects", hits[1])


def _on_datasets(plan: StudyPlan, n_datasets: int, rng: np.random.Generator) -> VotesTable:
    """Simulate votes of the same people on datasets that shift the scores."""
    opinions = plan.spread * rng.standard_normal((plan.participants, plan.conditions))
    alone, parts = replace(plan, participants=2, spread=0.0), []  # the fewest; the first is taken
    for number in range(n_datasets):
        shifted = ABILITIES + 0.4 * rng.standard_normal(len(ABILITIES))
        for person, opinion in enumerate(opinions):
            votes = simulate_votes(alone, shifted + opinion, rng)
            votes = votes.where(votes.participant == 0)
            parts.append(replace(votes, participants=(str(person),), datasets=(str(number),)))
    return joined(parts)


def null_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often tests reject where conditions, factors, orders, datasets and groups do not differ (5 %)."""
    for participants in (8, 22, 60):
        rng, sides = np.random.default_rng(seed), np.random.default_rng(seed + 1)
        hits: dict[str, list[list[bool]]] = {}
        groups = {"age": {str(person): "young" if person % 2 else "old" for person in range(participants)}}
        settings = AnalysisSettings(factors=FACTORS, groups=groups, order_effect=True)
        for _ in range(n_studies):
            votes = simulate_votes(StudyPlan(6, 2, participants), np.zeros(6), rng)
            votes = replace(votes, first_shown=rng.integers(0, 2, len(votes)).astype(np.int8))
            votes = _turned(votes, sides.random(len(votes)) < 0.5)
            for name, rejected in _rejections(votes, settings).items():
                hits.setdefault(name, []).append(rejected)
        yield from (share_line(f"rejected, {participants} participants, {name}", hits[name]) for name in sorted(hits))


def _turned(votes: VotesTable, is_turned: NDArray[np.bool_]) -> VotesTable:
    """Exchange the sides of some votes, so that somebody's taste does not look like a preferred side."""
    return replace(
        votes,
        item_a=np.where(is_turned, votes.item_b, votes.item_a),
        item_b=np.where(is_turned, votes.item_a, votes.item_b),
        choice=np.where(is_turned & (votes.choice != NONE), 1 - votes.choice, votes.choice),
        first_shown=np.where(is_turned, 1 - votes.first_shown, votes.first_shown),
    )


def _rejections(votes: VotesTable, settings: AnalysisSettings) -> dict[str, list[bool]]:
    """Return which true hypotheses are rejected, by the kind of test; only over all datasets."""
    compared = list(compare(votes, settings))
    pooled = next(row for row in compared if (row.comparison, row.dataset) == ("all", "all"))
    effects, tests = factor_results(votes, settings, compared)
    tests += [group.test for group in group_comparisons(votes, settings) if group.test is not None]
    result: dict[str, list[bool]] = {}
    for row in tests:
        if row.dataset == "all" and row.p_participant is not None:
            result.setdefault(f"test {row.name}", []).append(row.p_participant < 0.05)
    tables, _ = random_effect_tables(compared, "participants")
    contrasts = {"t": list(contrast_rows(pooled)), "random effects": tables["random_effects_contrasts"]}
    for title, rows in contrasts.items():
        result[f"differences, {title}"] = [row["p_value"] < 0.05 for row in rows]
        result[f"any of 15 differences (Holm), {title}"] = [any(row["p_holm"] < 0.05 for row in rows)]
    effects = [row for row in effects if row["dataset"] == "all"]
    held = _holds(effects, "ci", [0.0] * len(effects))
    result["factors' effects, interval without zero"] = [not is_held for is_held in held]
    result["goodness of fit (votes as independent)"] = [(pooled.fit.p_value or 1.0) < 0.05]
    flags = [flag for row in observer_rows(votes, [], ties=settings.ties) for flag in row["flags"]]
    result["any participant prefers a side (Holm)"] = ["prefers one side" in flags]
    return result


def equivalence_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often a pair that differs by the margin is called equivalent (up to 5 %)."""
    plan = StudyPlan(6, 2, 22)
    truth = _estimated(simulate_votes(replace(plan, participants=LARGE), ABILITIES, np.random.default_rng(seed)))
    margin = abs(truth["difference"][1]) / float(np.log(3))  # of the first and the third condition
    rng, hits = np.random.default_rng(seed), []
    for _ in range(n_studies):
        (comparison,) = compare(simulate_votes(plan, ABILITIES, rng), AnalysisSettings(by_dataset=False))
        hits.append([list(contrast_rows(comparison, margin))[1]["p_equivalent"] < 0.05])
    yield share_line("called equivalent at the margin, 22 participants", hits)


def triad_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often participants who vote at random look more consistent than chance (5 %)."""
    for ties, missing in ((0.0, 0.0), (0.0, 0.07), (0.0, 0.5), (0.15, 0.0), (0.3, 0.0)):
        rng = np.random.default_rng(seed)
        hits = [_consistent(rng, ties, missing) for _ in range(n_studies)]
        yield share_line(f"triads, {100 * ties:.0f} % ties, {100 * missing:.0f} % missing", hits)


def _consistent(rng: np.random.Generator, ties: float, missing: float) -> list[bool]:
    votes = simulate_votes(StudyPlan(6, 5, 22, tie_rate=ties, spread=0.0), np.zeros(6), rng)
    rows: dict[str, list[Triads]] = {}
    for row in triads(votes.where(rng.random(len(votes)) >= missing)):
        rows.setdefault(row.participant, []).append(row)
    return [(pooled_p_value(person) or 1.0) <= 0.05 for person in rows.values()]


def concordance_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often datasets look concordant where people have opinions and share none (5 %)."""
    for spread in (0.0, 0.4, 1.5):
        rng, plan = np.random.default_rng(seed), StudyPlan(6, 5, 22, spread=spread)
        hits = [_concordant(simulate_votes(plan, np.zeros(6), rng)) for _ in range(n_studies)]
        yield share_line(f"concordance, opinions of standard deviation {spread}", [[hit] for hit in hits])


def _concordant(votes: VotesTable) -> bool:
    p_value = concordance_p_value(votes, votes.datasets)
    return p_value is not None and p_value <= 0.05


FAMILIES = {
    "intervals": interval_lines,
    "datasets": dataset_lines,
    "tests": null_lines,
    "equivalence": equivalence_lines,
    "triads": triad_lines,
    "concordance": concordance_lines,
}


if __name__ == "__main__":
    print_families(__doc__, FAMILIES, studies=400)

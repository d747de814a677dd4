"""How often the comparison of measures with scores errs, by simulation; docs/analysis.md shows the tables.

    python bench/measures.py [--studies 100] [--seed 1]

Votes are simulated and analysed, then measures of random numbers, of a known correlation, or equally good in pairs are
compared with the scores. About five minutes on a core.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.comparisons.comparison import Comparison, compare
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.model.settings import AnalysisSettings
from app.analysis.objective.comparison import comparison_rows
from app.analysis.objective.permutation import condition_orders
from app.analysis.objective.points import Points
from app.analysis.objective.prediction import CORRELATIONS, SHARES, describe, prediction_rows
from app.analysis.objective.scores import score_sets
from app.analysis.reading.votes_table import ALL, VotesTable, votes_from_indices

Array = NDArray[np.float64]

CONDITIONS, DATASETS, PARTICIPANTS = 6, 5, 22  # as in the paper's study
SPREAD = 0.8  # log-odds, standard deviation of conditions' true scores
MEASURES = 20  # of each study
COLUMNS = (*CORRELATIONS, *SHARES)


@dataclass(frozen=True)
class Situation:
    """What the scores, or the measures, of a condition on different datasets have in common.

    Parameters
    ----------
    name : for the table
    draw : Generator -> values (DATASETS, CONDITIONS) of a measure
    is_score_shared : a condition has the same true score on all datasets
    """

    name: str
    draw: Callable[[np.random.Generator], Array]
    is_score_shared: bool


def _own(rng: np.random.Generator) -> Array:
    return rng.normal(size=(DATASETS, CONDITIONS))


def _same(rng: np.random.Generator) -> Array:
    return np.tile(rng.normal(size=CONDITIONS), (DATASETS, 1))


def _skewed(rng: np.random.Generator) -> Array:
    return np.exp(1.5 * rng.normal(size=(DATASETS, CONDITIONS)))


SITUATIONS = (
    Situation("random on every dataset, scores alike", _own, True),
    Situation("random on every dataset, scores unlike", _own, False),
    Situation("the same random numbers on all datasets, scores alike", _same, True),
    Situation("random with outliers (log-normal), scores alike", _skewed, True),
)


def simulated_votes(is_shared: bool, rng: np.random.Generator) -> VotesTable:
    """Votes of a study whose conditions have the same true scores on all datasets, or others on each."""
    abilities = [SPREAD * rng.normal(size=CONDITIONS)] * DATASETS
    if not is_shared:
        abilities = [SPREAD * rng.normal(size=CONDITIONS) for _ in range(DATASETS)]
    parts = [simulate_votes(StudyPlan(CONDITIONS, 1, PARTICIPANTS), each, rng) for each in abilities]
    names = parts[0].participants, tuple(f"d{k}" for k in range(DATASETS)), parts[0].items
    return votes_from_indices(
        np.concatenate([part.participant for part in parts]),
        np.repeat(np.arange(DATASETS), len(parts[0])),
        np.concatenate([part.item_a for part in parts]),
        np.concatenate([part.item_b for part in parts]),
        np.concatenate([part.choice for part in parts]),
        names=names,
    )


def as_measures(values: Sequence[Array], items: Sequence[str]) -> dict[str, dict[str, dict[str, float]]]:
    """Name values (DATASETS, CONDITIONS) as the analysis takes them."""
    return {
        f"m{number}": {f"d{d}": dict(zip(items, row.tolist(), strict=True)) for d, row in enumerate(each)}
        for number, each in enumerate(values)
    }


def studies(is_shared: bool, n_studies: int, rng: np.random.Generator) -> Iterator[tuple[VotesTable, list[Comparison]]]:
    for _ in range(n_studies):
        votes = simulated_votes(is_shared, rng)
        yield votes, list(compare(votes, AnalysisSettings()))


def random_measures(situation: Situation, n_studies: int, rng: np.random.Generator) -> None:
    """Print how often the intervals of measures of random numbers exclude what chance gives."""
    errors: dict[str, dict[str, list[bool]]] = {"one dataset": {}, "all datasets": {}}
    for votes, compared in studies(situation.is_score_shared, n_studies, rng):
        values = [situation.draw(rng) for _ in range(MEASURES)]
        measures = as_measures(values, votes.items)
        better = dict.fromkeys(measures, "higher")
        for row in prediction_rows(score_sets(compared), measures, better, rng):
            where = errors["all datasets" if row["dataset"] == ALL else "one dataset"]
            for name in COLUMNS:
                chance = 0.5 if name in SHARES else 0.0
                low, high = row[f"{name}_low"], row[f"{name}_high"]
                where.setdefault(name, []).append(low is not None and (low > chance or high < chance))
    for over, columns in errors.items():
        shares = " | ".join(f"{np.mean(columns[name]):.1%}" for name in COLUMNS)
        print(f"| {situation.name} | {over} | {len(columns['pearson'])} | {shares} |", flush=True)


def normal_points(
    correlations: Sequence[float], shared: float, datasets: int, rng: np.random.Generator
) -> list[Points]:
    """Points of measures of known correlation with normal scores.

    Parameters
    ----------
    correlations : of each measure
    shared : share of variance that a condition has in common on all datasets, of scores and of measures
    datasets : their number
    """

    def noise() -> Array:
        common, rest = rng.normal(size=(1, CONDITIONS)), rng.normal(size=(datasets, CONDITIONS))
        return np.asarray(np.sqrt(shared) * common + np.sqrt(1 - shared) * rest)

    scores, none = noise(), np.zeros((0, 2), np.intp)
    dataset, condition = (part.ravel() for part in np.indices(scores.shape))
    first, second = np.triu_indices(CONDITIONS, 1)
    pairs = np.concatenate([d * CONDITIONS + np.stack([first, second], axis=1) for d in range(datasets)])
    is_reverse = scores.ravel()[pairs[:, 0]] < scores.ravel()[pairs[:, 1]]
    better_first = np.where(is_reverse[:, None], pairs[:, ::-1], pairs)
    points = []
    for r in correlations:
        values = r * scores + np.sqrt(1 - r**2) * noise()
        points.append(
            Points(values.ravel(), scores.ravel(), np.full(scores.size, np.nan), dataset, condition, better_first, none)
        )
    return points


def coverage(n: int, rng: np.random.Generator) -> None:
    """Print how often Pearson's interval contains the true correlation."""
    print("\n| true correlation | shared | datasets | Pearson's interval contains it |\n|---|---|---|---|")
    for r in (0.0, 0.5, 0.8, 0.95):
        for datasets, shared in ((1, 0.0), (DATASETS, 0.0), (DATASETS, 0.8)):
            hits = []
            for _ in range(n):
                (points,) = normal_points([r], shared, datasets, rng)
                row = describe(points, condition_orders(points, rng), "higher")
                hits.append(row["pearson_low"] <= r <= row["pearson_high"])
            print(f"| {r} | {shared} | {datasets} | {np.mean(hits):.1%} |", flush=True)


def equal_measures(n: int, rng: np.random.Generator) -> None:
    """Print how often two equally good measures are told apart at 5 %."""
    print("\n| correlation of both | shared | datasets | correlations differ | areas differ |\n|---|---|---|---|---|")
    for r in (0.0, 0.5, 0.9):
        for datasets, shared in ((1, 0.0), (DATASETS, 0.0), (DATASETS, 0.8)):
            told = []
            for _ in range(n):
                points = normal_points([r, r], shared, datasets, rng)
                (row,) = comparison_rows(dict(zip("ab", points, strict=True)), dict.fromkeys("ab", "higher"), rng)
                told.append([row["p_value"] <= 0.05, row["auc_p"] <= 0.05])
            shares = " | ".join(f"{share:.1%}" for share in np.mean(told, axis=0))
            print(f"| {r} | {shared} | {datasets} | {shares} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    print(f"| measure | over | cases | {' | '.join(COLUMNS)} |")
    print(f"|---|---|---{'|---' * len(COLUMNS)}|")
    for situation in SITUATIONS:
        random_measures(situation, options.studies, rng)
    coverage(20 * options.studies, rng)
    equal_measures(20 * options.studies, rng)


if __name__ == "__main__":
    main()

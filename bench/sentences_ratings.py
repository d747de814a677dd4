"""How often what is said of ratings is right, in simulated studies.

A part of `bench/sentences.py`, which prints the lines.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))
from verdicts import LARGE, Kind, line, study

from app.analysis.model.contrasts import SIGNIFICANT, critical_value
from app.analysis.ratings.alignment import align
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.contrasts import rating_contrasts
from app.analysis.ratings.disagreement import rating_disagreement
from app.analysis.ratings.outliers import correlations_with_others, false_alarms
from app.analysis.ratings.planning import RatingPlan, RatingStudies
from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.screening.careless import FALSE_ALARMS

Array = NDArray[np.float64]

RATED = {  # the plan of a study of ratings, the range of its qualities in grades, and how many click
    "range 1": (RatingPlan(6, 5, 22, 0.7), 1.0, 0),
    "range 1, people differ by 0.4": (RatingPlan(6, 5, 22, 0.7, spread=0.4), 1.0, 0),
    "range 2.5, people differ by 0.3": (RatingPlan(6, 5, 22, 0.7, spread=0.3), 2.5, 0),
    "8 people, range 1": (RatingPlan(6, 5, 8, 0.7), 1.0, 0),
    "60 people, range 2": (RatingPlan(6, 5, 60, 0.7), 2.0, 0),
    "one dataset, range 2": (RatingPlan(6, 1, 22, 0.7), 2.0, 0),
    "4 click, range 1": (RatingPlan(6, 5, 22, 0.7), 1.0, 4),
    "4 click, range 2.5": (RatingPlan(6, 5, 22, 0.7), 2.5, 4),
}


def rating_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often people who rate are named, and are said to disagree."""
    for name, (plan, range_, clickers) in RATED.items():
        rng, honest, named, differ = np.random.default_rng(seed), [], [], []
        for _ in range(n_studies):
            studies = plan.simulated(np.linspace(range_ / 2, -range_ / 2, plan.conditions), 1, rng)
            assert isinstance(studies, RatingStudies)
            ratings = np.clip(np.rint(3 + studies.ratings[0]), 1, 5)
            first = plan.participants - clickers
            ratings[first:] = rng.integers(1, 6, (clickers, *ratings.shape[1:]))
            table = _rated(ratings)
            alarms = [alarm is not None and alarm < FALSE_ALARMS for alarm in _alarms(table)]
            honest.append(float(any(alarms[:first])))
            named.append(float(np.mean(alarms[first:])) if clickers else np.nan)
            tested = rating_disagreement(table)
            differ.append(np.nan if tested is None else float(tested["p_value"] < SIGNIFICANT))
        yield line(f"ratings, {name}: an honest person is named", honest)
        if clickers:
            yield line(f"ratings, {name}: clickers named", named)
        if plan.datasets > 1:
            yield line(f"ratings, {name}: people are said to disagree", differ)


def _alarms(table: RatingTable) -> list[float | None]:
    return false_alarms(correlations_with_others(table))


def _rated(ratings: Array, protocol: str = "acr") -> RatingTable:
    person, dataset, condition = np.nonzero(~np.isnan(ratings))
    items = tuple((f"d{d}", f"c{c}") for d in range(ratings.shape[1]) for c in range(ratings.shape[2]))
    people = tuple(f"P{j:03d}" for j in range(len(ratings)))
    is_reference = np.array([protocol == "acr-hr" and condition == "c0" for _, condition in items])
    item = dataset * ratings.shape[2] + condition
    rating = ratings[person, dataset, condition]
    return RatingTable(people, items, person, item, rating, is_reference, protocol, 1.0, 5.0)


GRADED = {  # the plan of a study of ratings, and how many click
    "22 people": (RatingPlan(6, 5, 22, 0.7, spread=0.3), 0),
    "8 people": (RatingPlan(6, 5, 8, 0.7, spread=0.3), 0),
    "60 people": (RatingPlan(6, 5, 60, 0.7, spread=0.3), 0),
    "22, a third leaves half-way": (RatingPlan(6, 5, 22, 0.7, spread=0.3, drop_out=1 / 3), 0),
    "22, 4 click": (RatingPlan(6, 5, 22, 0.7, spread=0.3), 4),
}
BIAS, ORDER = 0.4, 0.3  # of people's grades, and of what is shown second, grades


def _grades(plan: RatingPlan, clickers: int, range_: float, rng: np.random.Generator) -> Array:
    """Return grades from 1 to 5 of every person, dataset and condition, the first of which is the reference."""
    studies = plan.simulated(np.linspace(range_ / 2, -range_ / 2, plan.conditions), 1, rng)
    assert isinstance(studies, RatingStudies)
    people = plan.participants
    ratings = np.clip(np.rint(3 + studies.ratings[0] + BIAS * rng.standard_normal((people, 1, 1))), 1, 5)
    ratings[people - clickers :] = rng.integers(1, 6, (clickers, *ratings.shape[1:]))
    return np.asarray(ratings)


def grade_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often intervals of mean ratings, differential ones and the subject model hold, and paired tests err."""
    for name, (plan, clickers) in GRADED.items():
        large = replace(plan, participants=LARGE, datasets=1, drop_out=0.0)
        truth = _grades(large, round(clickers / plan.participants * LARGE), 1.5, np.random.default_rng(seed))
        truth = truth.mean(axis=(0, 1))
        rng, values = np.random.default_rng(seed), dict[str, list[float]]()
        for _ in range(n_studies):
            for what, value in _graded(_rated(_grades(plan, clickers, 1.5, rng), "acr-hr"), truth):
                values.setdefault(what, []).append(value)
            alike = rating_contrasts(_rated(_grades(plan, clickers, 0.0, rng)))
            values.setdefault("some pair of equals differs (Holm)", []).append(
                float(min(each.p_holm for each in alike) < SIGNIFICANT)
            )
        yield from (line(f"grades, {name}: {what}", each) for what, each in values.items())


def _graded(table: RatingTable, truth: Array) -> Iterator[tuple[str, float]]:
    """Yield the shares of the intervals that hold the truth, the mean grade of each condition."""
    places = {f"c{c}": c for c in range(len(truth))}
    analysed = analyse_ratings(table)
    rows = analysed["rating_conditions"]
    mean = np.array([truth[places[row["condition"]]] for row in rows])
    for what, ends, true in (
        ("MOS", ("ci_low", "ci_high"), mean),
        ("DMOS", ("dmos_low", "dmos_high"), mean - truth[0] + table.high),
        ("subject model", ("quality_low", "quality_high"), mean),
    ):
        low, high = (np.array([row[end] for row in rows], float) for end in ends)
        is_known = ~np.isnan(low)
        yield f"{what} holds", float(((low <= true) & (true <= high))[is_known].mean())
    contrasts = analysed["rating_contrasts"]
    true = np.array([truth[places[each["item_a"]]] - truth[places[each["item_b"]]] for each in contrasts])
    low, high = (np.array([each[end] for each in contrasts], float) for end in ("ci_low", "ci_high"))
    yield "difference holds", float(((low <= true) & (true <= high)).mean())


def comparison_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often intervals of comparison ratings hold, and an order effect is found that is not there."""
    for people in (8, 22, 60):
        for order in (0.0, ORDER):
            truth = analyse_comparisons(_compared(LARGE // 5, order, np.random.default_rng(seed)))
            rng, values = np.random.default_rng(seed), dict[str, list[float]]()
            for _ in range(n_studies):
                analysed = analyse_comparisons(_compared(people, order, rng))
                for table, key in (("comparison_pairs", "cmos"), ("comparison_items", "score")):
                    rows = zip(analysed[table], truth[table], strict=True)
                    held = [row["ci_low"] <= true[key] <= row["ci_high"] for row, true in rows]
                    values.setdefault(f"{key} holds", []).append(float(np.mean(held)))
                model = analysed["comparison_models"][-1]
                ratio = abs(model["order_effect"] / model["order_se"])
                values.setdefault("order effect found", []).append(float(ratio > critical_value(people)))
            name = f"ccr, {people} people, order effect {order}"
            yield from (line(f"{name}: {what}", each) for what, each in values.items())


def _compared(people: int, order: float, rng: np.random.Generator) -> ComparisonTable:
    """Return comparisons of every two of 6 conditions on 2 datasets by people who differ by 0.3, sides at random."""
    opinions = np.linspace(0.75, -0.75, 6) + 0.3 * rng.standard_normal((people, 6))
    first, second = np.triu_indices(6, 1)
    person, dataset, pair = (part.ravel() for part in np.indices((people, 2, len(first))))
    a, b, a_first = first[pair], second[pair], rng.random(len(pair)) < 0.5
    shift = np.where(a_first, order, -order)
    rating = opinions[person, b] - opinions[person, a] + shift + 0.7 * rng.standard_normal(len(pair))
    items = tuple((f"d{d}", f"c{c}") for d in range(2) for c in range(6))
    names = tuple(f"P{j:05d}" for j in range(people))
    rating = np.clip(np.rint(rating), -3, 3)
    return ComparisonTable(names, items, person, 6 * dataset + a, 6 * dataset + b, rating, a_first)


def rater_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often intervals of somebody's bias and inconsistency hold."""
    quality, noise = np.linspace(0.75, -0.75, 6), 0.7
    for people, spread in ((8, 0.0), (22, 0.0), (22, 0.3)):
        rng, values = np.random.default_rng(seed), dict[str, list[float]]()
        for _ in range(n_studies):
            opinions = spread * rng.standard_normal((people, 1, len(quality)))
            own = opinions + BIAS * rng.standard_normal((people, 1, 1))
            ratings = 3 + quality + own + noise * rng.standard_normal((people, 5, len(quality)))
            rows = analyse_ratings(_rated(np.clip(np.rint(ratings), 1, 5)))["raters"]
            bias = own.mean(axis=(1, 2)) - own.mean()
            rounded = noise**2 + 1 / 12  # the variance of grades
            true = {
                "bias": bias,
                "inconsistency": np.sqrt(rounded + (opinions - opinions.mean(axis=0)).var(axis=(1, 2))),
            }
            for what, of_each in true.items():
                held = [
                    row[f"{what}_low"] <= each <= row[f"{what}_high"]
                    for row, each in zip(rows, of_each, strict=True)
                    if row[f"{what}_low"] is not None
                ]
                values.setdefault(what, []).append(float(np.mean(held)))
        yield from (
            line(f"raters, {people}, opinions of {spread}: {what} holds", each) for what, each in values.items()
        )


SLOPE = 1.5  # log-odds for a grade


def alignment_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often intervals of ratings and votes on one scale hold those of very many people."""
    many = LARGE // 5
    for people in (8, 22, 60):
        true = _aligned(Kind(people=many, datasets=1, range_jod=2.0), np.random.default_rng(seed))
        rng, values = np.random.default_rng(seed), dict[str, list[float]]()
        truth = {row["condition"]: row for row in true["alignment_items"]}
        for _ in range(n_studies):
            found = _aligned(Kind(people=people, datasets=2, range_jod=2.0), rng)
            (model,) = found["alignment"]
            for what in ("quality", "score"):
                held = [
                    row[f"{what}_low"] <= truth[row["condition"]][what] <= row[f"{what}_high"]
                    for row in found["alignment_items"]
                ]
                values.setdefault(what, []).append(float(np.mean(held)))
            slope = true["alignment"][0]["slope"]
            values.setdefault("slope", []).append(float(model["slope_low"] <= slope <= model["slope_high"]))
        yield from (line(f"one scale, {people} people: {what} holds", each) for what, each in values.items())


def _aligned(kind: Kind, rng: np.random.Generator) -> dict[str, list[dict[str, Any]]]:
    """Return the alignment of ratings and votes by the same people, whose opinions are the same in both."""
    votes, scores = study(kind, rng)
    ratings = (
        3 + scores / SLOPE + BIAS * rng.standard_normal((kind.people, 1, 1)) + 0.7 * rng.standard_normal(scores.shape)
    )
    table = _rated(np.clip(np.rint(ratings), 1, 5))
    return align(replace(table, items=tuple((d, c.upper()) for d, c in table.items)), votes)


RATINGS: dict[str, Callable[[int, int], Iterator[str]]] = {
    "ratings": rating_lines,
    "grades": grade_lines,
    "comparisons": comparison_lines,
    "raters": rater_lines,
    "alignment": alignment_lines,
}

"""How often sentences, intervals and flags that `bench/verdicts.py` leaves out are right, in simulated studies.

`python bench/sentences.py` prints one line for each row of docs/simulation.md that it fills, with Monte Carlo errors.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))
from arguments import print_families
from verdicts import LOG_ODDS_PER_JOD, Kind, line, study

from app.analysis.analyse import analyse, scored
from app.analysis.comparisons.comparison import compare
from app.analysis.model.contrasts import SIGNIFICANT, critical_value, holm
from app.analysis.model.settings import AnalysisSettings
from app.analysis.objective.correlations import pearsons
from app.analysis.objective.permutation import chance, condition_orders
from app.analysis.objective.points import Points, matched
from app.analysis.objective.scores import score_sets
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.contrasts import rating_contrasts
from app.analysis.ratings.disagreement import rating_disagreement
from app.analysis.ratings.outliers import correlations_with_others, false_alarms
from app.analysis.ratings.planning import RatingPlan, RatingStudies
from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.reading.votes_table import ALL, NONE, VotesTable, joined, votes_from_indices
from app.analysis.screening.careless import FALSE_ALARMS, careless_answers
from app.analysis.screening.disagreement import krippendorff_alpha
from app.study.design.adaptive import choose_pairs

Array = NDArray[np.float64]

LARGE = 20_000  # people, whose estimate is the truth of pooled scores
PANELS = {
    "8 people": Kind(people=8),
    "22 people": Kind(),
    "60 people": Kind(people=60),
    "22 who differ by 1.0": Kind(spread=1.0),
    "22, 4 clickers": Kind(clickers=4),
    "22, 2 datasets": Kind(datasets=2),
}


def report_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print what whole analyses say: of studies without any difference, then of studies with a range of 1.1 JOD."""
    for name, panel in PANELS.items():
        for range_jod in (0.0, 1.1):
            kind, rng = replace(panel, range_jod=range_jod), np.random.default_rng(seed)
            truth = _truth(kind, seed)
            values: dict[str, list[float]] = {}
            for _ in range(n_studies):
                votes, _ = study(kind, rng)
                for what, value in _said(votes, kind, truth).items():
                    values.setdefault(what, []).append(value)
            yield from (line(f"{name}, range {range_jod}: {what}", each) for what, each in values.items())


def _of_many(kind: Kind, seed: int) -> VotesTable:
    """Return the votes of very many people, of whom as large a share clicks."""
    large = replace(kind, people=LARGE, datasets=1, clickers=round(kind.clickers / kind.people * LARGE))
    return study(large, np.random.default_rng(seed))[0]


def _truth(kind: Kind, seed: int) -> dict[str, float]:
    """Return the scores of very many people."""
    votes = _of_many(kind, seed)
    (fitted,) = compare(votes, AnalysisSettings(by_dataset=False))
    assert fitted.fit.scores is not None
    return dict(zip(fitted.fit.items, fitted.fit.scores.tolist(), strict=True))


def alpha_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often the interval of Krippendorff's alpha holds that of very many people."""
    kinds = PANELS | {
        "60 who differ by 1.0": Kind(people=60, spread=1.0),
        "22, no difference": Kind(range_jod=0.0),
        "22, two camps, range 2 JOD": Kind(camps=True, range_jod=2.0),
    }
    for name, kind in kinds.items():
        truth = krippendorff_alpha(_of_many(kind, seed))["alpha"]
        rng, holds = np.random.default_rng(seed), []
        for _ in range(n_studies):
            row = krippendorff_alpha(study(kind, rng)[0])
            holds.append(_holds(row, "alpha", truth or 0.0))
        yield line(f"{name}: alpha's interval holds {truth:.3f}", holds)


def _said(votes: VotesTable, kind: Kind, scores: dict[str, float]) -> dict[str, float]:
    """Return what an analysis says, as 0 or 1, or the share of its intervals that hold the truth."""
    groups = {"age": {name: "young" if number % 2 else "old" for number, name in enumerate(votes.participants)}}
    margin = kind.range_jod / 5 if kind.range_jod else 0.1  # the true difference of neighbours
    settings = AnalysisSettings(
        by_dataset=kind.datasets > 1,
        groups=groups,
        random_effects="participants",
        equivalence_margin=margin,
        lapses=True,
    )
    analysis = analyse(votes, settings)
    whole = [row for row in analysis["scores"] if row["comparison"] == row["dataset"] == ALL]
    pairs = [row for row in analysis["contrasts"] if row["comparison"] == row["dataset"] == ALL]
    tests = {(row["name"], row["dataset"]): row["p_participant"] for row in analysis["tests"]}
    own = dict(zip([f"C{k}" for k in range(kind.conditions)], kind.abilities.tolist(), strict=True))
    result = {
        "any pair differs (Holm)": any(row["p_holm"] < SIGNIFICANT for row in pairs),
        "any pair of a dataset differs (letters)": any(
            row["p_holm_together"] < SIGNIFICANT for row in analysis["contrasts"] if row["dataset"] != ALL
        ),
        "datasets differ": _below(tests.get(("datasets differ", ALL))),
        "groups differ": _below(tests.get(("group age", ALL))),
        "a single score does not explain the votes": _below(_fit(analysis)),
        "ranks hold all true ones": all(
            row["rank_low"] <= last and row["rank_high"] >= first
            for row in whole
            for first, last in [_ranks(own, row["item"])]
        ),
        "intervals with lapse rates": float(
            np.mean([_holds(row, "ci", own[row["item"]]) for row in analysis["lapse_scores"]] or [np.nan])
        ),
        "somebody named careless is honest": any(
            row["careless"] and "answers carelessly" in row["flags"]
            for row in analysis["observers"][: kind.people - kind.clickers]
        ),
        "flags of facts": any(flag != "answers carelessly" for row in analysis["observers"] for flag in row["flags"]),
        "remarks": any(row["remarks"] for row in analysis["observers"]),
    }
    if kind.spread and not kind.clickers and analysis["random_effects_contrasts"]:
        result["shares of people"] = float(
            np.mean([_share_holds(row, own, kind) for row in analysis["random_effects_contrasts"]])
        )
    if kind.range_jod:
        neighbours = [row for row in pairs if abs(int(row["item_a"][1:]) - int(row["item_b"][1:])) == 1]
        farther = [
            row for row in neighbours if abs(scores[row["item_a"]] - scores[row["item_b"]]) >= margin * LOG_ODDS_PER_JOD
        ]
        result["a pair at the margin called equivalent"] = any(
            row["p_equivalent_holm"] is not None and row["p_equivalent_holm"] < SIGNIFICANT for row in farther
        )
    return {name: float(value) for name, value in result.items()}


def _below(p_value: float | None) -> float:
    return np.nan if p_value is None else float(p_value < SIGNIFICANT)


def _fit(analysis: dict[str, Any]) -> float | None:
    p_value: float | None = next(
        row["p_value"] for row in analysis["models"] if row["comparison"] == row["dataset"] == ALL
    )
    return p_value


def _ranks(own: dict[str, float], item: str) -> tuple[int, int]:
    above = sum(value > own[item] + 1e-9 for value in own.values())
    return 1 + above, sum(value >= own[item] - 1e-9 for value in own.values())


def _holds(row: Mapping[str, Any], ends: str, truth: float) -> float:
    low, high = row[f"{ends}_low"], row[f"{ends}_high"]
    return np.nan if low is None else float(low <= truth <= high)


def _share_holds(row: dict[str, Any], own: dict[str, float], kind: Kind) -> float:
    share = norm.cdf((own[row["item_a"]] - own[row["item_b"]]) / (np.sqrt(2) * kind.spread))
    return float(row["people_low"] <= share <= row["people_high"])


def best_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often the condition of the highest score is the best, beside the probability that is said of it."""
    settings = AnalysisSettings(by_dataset=False)
    for people in (8, 22, 60):
        for spread in (0.1, 0.3, 0.6):
            kind, rng = Kind(people=people, datasets=2), np.random.default_rng(seed)
            said, right = [], []
            for _ in range(n_studies):
                drawn = spread * rng.standard_normal(kind.conditions)
                votes, _ = study(_Drawn(**{**vars(kind), "drawn": tuple(drawn)}), rng)
                row = max(_scores(votes, settings), key=lambda row: row["score"] or 0.0)
                if row["p_best"] is not None:
                    said.append(row["p_best"])
                    right.append(int(row["item"][1:]) == int(np.argmax(drawn)))
            where = f"{people} people, scores differ by {spread}"
            yield line(f"{where}: probability said of the highest score to be the best", said)
            yield line(f"{where}: it is the best", np.array(right, float))


class _Drawn(Kind):
    """A kind of study whose scores are given."""

    drawn: tuple[float, ...]

    def __init__(self, drawn: tuple[float, ...], **fields: Any) -> None:
        super().__init__(**fields)
        object.__setattr__(self, "drawn", drawn)

    @property
    def abilities(self) -> Array:
        """True scores, log-odds."""
        return np.array(self.drawn)


def _scores(votes: VotesTable, settings: AnalysisSettings) -> list[dict[str, Any]]:
    return [row for row in scored(votes, settings) if row["comparison"] == row["dataset"] == ALL]


def measure_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often random measures are said to go with the scores, of twelve."""
    for people in (8, 22, 60):
        rng, hits = np.random.default_rng(seed), []
        for _ in range(n_studies):
            votes, _ = study(Kind(people=people), rng)
            values = {
                f"m{number}": {f"d{k}": dict(zip(votes.items, rng.random(6).tolist(), strict=True)) for k in range(5)}
                for number in range(12)
            }
            sets = score_sets(list(compare(votes, AnalysisSettings())))
            p_values = [_pearson_p(matched(sets, by_dataset), rng) for by_dataset in values.values()]
            hits.append(float((holm(np.array(p_values)) < SIGNIFICANT).any()))
        yield line(f"{people} people: any of 12 random measures goes with the scores (Holm)", hits)


def _pearson_p(points: Points, rng: np.random.Generator) -> float:
    """Return the p-value of Pearson's correlation over all datasets, as `prediction_rows` has it."""
    by_order = pearsons(points.relative_values, points.relative_scores[condition_orders(points, rng)])
    return chance(by_order, float(by_order[0]), points.n_conditions).p_value


def interim_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often five looks, each at the level that is said, find a difference that is not there."""
    rng, settings = np.random.default_rng(seed), AnalysisSettings(by_dataset=False)
    kind, corrected, plain = Kind(people=60, range_jod=0.0, datasets=2), [], []
    for _ in range(n_studies):
        votes, _ = study(kind, rng)
        smallest, levels = [], []
        for n in (12, 24, 36, 48, 60):
            (comparison,) = compare(votes.where(votes.participant < n), settings)
            smallest.append(min((row.p_holm for row in comparison.contrasts), default=1.0))
            levels.append(2 * float(norm.sf(norm.isf(SIGNIFICANT / 2) / np.sqrt(n / kind.people))))
        corrected.append(float((np.array(smallest) < levels).any()))
        plain.append(float(min(smallest) < SIGNIFICANT))
    yield line("five looks, each at the level of the sentence", corrected)
    yield line("five looks, each at 5 %", plain)


def adaptive_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print the coverage of intervals, and errors of tests, where pairs are chosen adaptively: 15 conditions."""
    settings, n = AnalysisSettings(by_dataset=False), 15
    for people in (22, 60):
        for range_jod in (0.0, 2.0):
            rng, holds, any_pair = np.random.default_rng(seed), [], []
            truth = np.linspace(0.5, -0.5, n) * range_jod * LOG_ODDS_PER_JOD
            for _ in range(n_studies):
                (comparison,) = compare(_adaptive_votes(truth, people, rng), settings)
                if comparison.fit.status != "ok" or comparison.fit.scores is None or len(comparison.fit.items) < n:
                    continue
                places = {item: int(item[1:]) for item in comparison.fit.items}
                rows = [row for row in comparison.contrasts if row.ci_low is not None and row.ci_high is not None]
                true = [truth[places[row.item_a]] - truth[places[row.item_b]] for row in rows]
                holds.append(np.mean([row.ci_low <= d <= row.ci_high for row, d in zip(rows, true, strict=True)]))
                any_pair.append(any(row.p_holm < SIGNIFICANT for row in rows))
            yield line(f"adaptive pairs, {people} people, range {range_jod}: intervals of differences", holds)
            if not range_jod:
                yield line(f"adaptive pairs, {people} people, range {range_jod}: any pair differs (Holm)", any_pair)


def _adaptive_votes(truth: Array, people: int, rng: np.random.Generator, n_pairs: int = 30) -> VotesTable:
    n = len(truth)
    wins, ties = np.zeros((n, n)), np.zeros((n, n))
    parts = []
    for person in range(people):
        own = truth + 0.3 * rng.standard_normal(n)
        a, b = np.array(choose_pairs(wins, ties, n_pairs, rng)).T
        d = own[a] - own[b]
        weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(len(d), 0.5)])
        drawn = rng.random(len(d)) * weights.sum(axis=0)
        choice = (drawn > weights[0]).astype(int) + (drawn > weights[0] + weights[1])
        for first, second, chosen in zip(a, b, choice, strict=True):
            if chosen == NONE:
                ties[first, second] += 1
                ties[second, first] += 1
            else:
                wins[(first, second) if chosen == 0 else (second, first)] += 1
        names = (f"P{person:03d}",), ("d0",), tuple(f"C{k}" for k in range(n))
        parts.append(votes_from_indices(0 * a, 0 * a, a, b, choice, names=names))
    return joined(parts)


def evidence_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print what sides, ties and times add: honest studies that name somebody, and clickers who are named."""
    for name, habit in (("always the same side", "side"), ("never without preference", "ties"), ("fast", "times")):
        for range_jod in (1.1, 3.0):
            for clickers in (0, 4):
                kind, rng = Kind(range_jod=range_jod, clickers=clickers), np.random.default_rng(seed)
                named, honest = [], []
                for _ in range(n_studies):
                    votes = _with_habits(study(kind, rng)[0], kind, habit, rng)
                    flagged = {who for who, verdict in careless_answers(votes, ()).items() if verdict.is_named}
                    careless = {f"P{j:03d}" for j in range(kind.people - clickers, kind.people)}
                    named.append(len(flagged & careless) / max(clickers, 1))
                    honest.append(bool(flagged - careless))
                if clickers:
                    yield line(f"clickers, {name}, range {range_jod}: named", named)
                who = "four clickers" if clickers else "honest"
                yield line(f"{who}, {name}, range {range_jod}: honest named", honest)


def _with_habits(votes: VotesTable, kind: Kind, habit: str, rng: np.random.Generator) -> VotesTable:
    """Give votes times and tie rates that vary over people, and clickers a habit."""
    clicks = votes.participant >= kind.people - kind.clickers
    choice = votes.choice.copy()
    ties = rng.beta(2, 8, kind.people)[votes.participant]  # tie rates that vary from person to person
    decided = rng.integers(0, 2, len(votes)).astype(np.int8)
    choice = np.where(~clicks & (choice == NONE) & (rng.random(len(votes)) > 5 * ties), decided, choice)
    if habit == "side":
        choice = np.where(clicks, 0, choice)
    if habit == "ties":
        choice = np.where(clicks & (choice == NONE), decided, choice)
    pace = (
        8.3
        + 0.35 * rng.standard_normal(kind.people)
        - (1.0 if habit == "times" else 0.0) * (np.arange(kind.people) >= kind.people - kind.clickers)
    )
    times = np.exp(pace[votes.participant] + 0.5 * rng.standard_normal(len(votes)))
    return replace(votes, choice=choice.astype(np.int8), response_ms=times)


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


FAMILIES: dict[str, Callable[[int, int], Iterator[str]]] = {
    "report": report_lines,
    "alpha": alpha_lines,
    "best": best_lines,
    "measures": measure_lines,
    "interim": interim_lines,
    "adaptive": adaptive_lines,
    "evidence": evidence_lines,
    "ratings": rating_lines,
    "grades": grade_lines,
    "comparisons": comparison_lines,
}


if __name__ == "__main__":
    print_families(__doc__, FAMILIES, studies=400)

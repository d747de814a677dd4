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
from sentences_measures import MEASURES
from sentences_ratings import RATINGS
from sentences_trials import TRIALS
from verdicts import LARGE, LOG_ODDS_PER_JOD, Kind, drawn_kind, line, study

from app.analysis.analyse import analyse, scored
from app.analysis.comparisons.comparison import compare
from app.analysis.model.contrasts import SIGNIFICANT
from app.analysis.model.settings import AnalysisSettings
from app.analysis.reading.votes_table import ALL, NONE, VotesTable, joined, votes_from_indices
from app.analysis.screening.careless import careless_answers
from app.analysis.screening.disagreement import krippendorff_alpha
from app.study.design.adaptive import choose_pairs

Array = NDArray[np.float64]
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
                votes, _ = study(drawn_kind(kind, drawn), rng)
                row = max(_scores(votes, settings), key=lambda row: row["score"] or 0.0)
                if row["p_best"] is not None:
                    said.append(row["p_best"])
                    right.append(int(row["item"][1:]) == int(np.argmax(drawn)))
            where = f"{people} people, scores differ by {spread}"
            yield line(f"{where}: probability said of the highest score to be the best", said)
            yield line(f"{where}: it is the best", np.array(right, float))


def _scores(votes: VotesTable, settings: AnalysisSettings) -> list[dict[str, Any]]:
    return [row for row in scored(votes, settings) if row["comparison"] == row["dataset"] == ALL]


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


FAMILIES: dict[str, Callable[[int, int], Iterator[str]]] = {
    "report": report_lines,
    "alpha": alpha_lines,
    "best": best_lines,
    "interim": interim_lines,
    "adaptive": adaptive_lines,
    "evidence": evidence_lines,
    **MEASURES,
    **RATINGS,
    **TRIALS,
}


if __name__ == "__main__":
    print_families(__doc__, FAMILIES, studies=400)

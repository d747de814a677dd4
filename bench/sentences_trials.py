"""How often what is said of the order of showing, checks, agreement and spreads is right, in simulated studies.

A part of `bench/sentences.py`, which prints the lines.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))
from verdicts import LARGE, Kind, line, study

from app.analysis.comparisons.comparison import compare, tested_order
from app.analysis.comparisons.random_effect_rows import random_effect_tables
from app.analysis.model.contrasts import SIGNIFICANT, critical_value, holm
from app.analysis.model.settings import AnalysisSettings
from app.analysis.rates.curves import BYTES
from app.analysis.rates.rows import rate_differences
from app.analysis.reading.votes_table import ALL, VotesTable
from app.analysis.screening.agreement import agreement_rows
from app.analysis.screening.attention_checks import check_rows

ORDERED = {
    **{f"{people} people": Kind(people=people) for people in (8, 22, 60)},
    "22, no difference": Kind(range_jod=0.0),
    "22 who differ by 1.0": Kind(spread=1.0),
}


def order_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often an order effect is found, and what its interval and those of differences hold."""
    for name, plain in ORDERED.items():
        for order in (0.0, 0.1, 0.3):
            kind, rng = replace(plain, order=order), np.random.default_rng(seed)
            votes, _ = study(replace(kind, people=LARGE, datasets=1), np.random.default_rng(seed))
            (true,) = compare(votes, AnalysisSettings(by_dataset=False, order_effect=True))
            assert true.fit.scores is not None
            assert true.fit.order_effect is not None
            scores = dict(zip(true.fit.items, true.fit.scores.tolist(), strict=True))
            values: dict[str, list[float]] = {}
            for _ in range(n_studies):
                for what, value in _order_said(study(kind, rng)[0], true.fit.order_effect, scores).items():
                    values.setdefault(what, []).append(value)
            yield from (line(f"order effect {order}, {name}: {what}", each) for what, each in values.items())


def _order_said(votes: VotesTable, effect: float, scores: dict[str, float]) -> dict[str, float]:
    """Return whether an order effect is found (1 %), and which intervals hold."""
    settings, row = tested_order(votes, AnalysisSettings(by_dataset=False))
    assert row is not None
    half = critical_value(votes.n_voters) * row["order_se"]
    holds = float(abs(row["order_effect"] - effect) <= half)
    (fitted,) = compare(votes, settings)
    held = [
        each.ci_low <= scores[each.item_a] - scores[each.item_b] <= each.ci_high
        for each in fitted.contrasts
        if each.ci_low is not None and each.ci_high is not None
    ]
    return {
        "found": float(row["is_in_model"]),
        "p below 5 %": float(row["p_value"] < SIGNIFICANT),
        "interval holds": holds,
        "interval holds where found": holds if row["is_in_model"] else np.nan,
        "differences hold": float(np.mean(held)),
    }


def check_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often honest people and clickers fail checks, and whom the sentence on checks names."""
    for range_jod in (1.1, 3.0):
        for clickers in (0, 4):
            kind, rng = Kind(range_jod=range_jod, clickers=clickers, n_checks=5), np.random.default_rng(seed)
            careless = {f"P{j:03d}" for j in range(kind.people - clickers, kind.people)}
            values: dict[str, list[float]] = {}
            for _ in range(n_studies):
                for what, value in _checked(study(kind, rng)[0], careless):
                    values.setdefault(what, []).append(value)
            where = f"checks, range {range_jod}, {clickers} clickers"
            yield from (line(f"{where}: {what}", each) for what, each in values.items())


def _checked(votes: VotesTable, careless: set[str]) -> Iterator[tuple[str, float]]:
    rows = check_rows(votes)
    for who, is_meant in (("honest", False), ("clickers", True)):
        own = [row for row in rows if (row["participant"] in careless) == is_meant]
        if own:
            yield f"{who} tell identical pairs apart", 1 - _share(own, "n_identical_none", "n_identical")
            yield f"{who} answer repeated pairs otherwise", 1 - _share(own, "n_repeated_same", "n_repeated")
    failed = {row["participant"]: 10 - row["n_identical_none"] - row["n_repeated_same"] for row in rows}
    worst = sorted(failed, key=lambda name: -failed[name])[:3]
    yield "of the three named, honest", float(np.mean([name not in careless for name in worst if failed[name]]))


def _share(rows: list[dict[str, Any]], part: str, whole: str) -> float:
    return float(sum(row[part] for row in rows) / sum(row[whole] for row in rows))


def agreement_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often people are said to agree more than by chance (Kendall's u) where conditions do not differ."""
    for people in (8, 22, 60):
        for spread in (0.0, 1.0):
            kind = Kind(people=people, spread=spread, range_jod=0.0, tie_rate=0.0)
            rng, alone, some = np.random.default_rng(seed), [], []
            for _ in range(n_studies):
                p_values = np.array([row["p_value"] for row in agreement_rows(study(kind, rng)[0])])
                alone.append(float((p_values < SIGNIFICANT).mean()))
                some.append(float((holm(p_values) < SIGNIFICANT).any()))
            yield line(f"u, {people} people, opinions of {spread}: a dataset, alone", alone)
            yield line(f"u, {people} people, opinions of {spread}: any of 5 datasets (Holm)", some)


SPREADS = {
    "8 people": Kind(people=8),
    "22 people": Kind(),
    "60 people": Kind(people=60),
    "22 who differ by 1.0": Kind(spread=1.0),
    "22, datasets differ by 0.4": Kind(scene_spread=0.4),
    "22, 10 datasets that differ by 0.4": Kind(scene_spread=0.4, datasets=10),
}


def spread_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often intervals of how much scores vary over people, and over datasets, hold."""
    for name, kind in SPREADS.items():
        rng, values = np.random.default_rng(seed), dict[str, list[float]]()
        levels = "participants,datasets" if kind.scene_spread else "participants"
        true = {"participants": kind.spread, "datasets": kind.scene_spread}
        for _ in range(n_studies):
            tables, _ = random_effect_tables(list(compare(study(kind, rng)[0], AnalysisSettings())), levels)
            for row in tables["random_effects"]:
                if row["level"] in true and row["sd_low"] is not None:
                    held = float(row["sd_low"] <= true[row["level"]] <= row["sd_high"])
                    values.setdefault(row["level"], []).append(held)
        yield from (line(f"spread, {name}: between {level}", each) for level, each in values.items())


SIZES = {"C0": 8.0, "C1": 4.0, "C2": 1.0, "C3": 6.0, "C4": 3.0, "C5": 0.5}  # megabytes
FACTORS = {
    "method": {item: "first" if item < "C3" else "second" for item in SIZES},
    "share": {item: str(1 + int(item[1]) % 3) for item in SIZES},
}


def rate_lines(n_studies: int, seed: int) -> Iterator[str]:
    """Print how often the interval of the difference of two methods at equal size holds."""
    settings = AnalysisSettings(by_dataset=False, factors=FACTORS, analysed_factors=(), measures={BYTES: {ALL: SIZES}})
    for people in (8, 22, 60):
        kind, rng = Kind(people=people), np.random.default_rng(seed)
        large, _ = study(replace(kind, people=LARGE, datasets=1), np.random.default_rng(seed))
        true = _rate(large, settings)["difference"]
        rows = [_rate(study(kind, rng)[0], settings) for _ in range(n_studies)]
        holds = [float(row["ci_low"] <= true <= row["ci_high"]) for row in rows if row["ci_low"] is not None]
        yield line(f"methods at equal size, {people} people: interval holds {true:.2f}", holds)


def _rate(votes: VotesTable, settings: AnalysisSettings) -> dict[str, Any]:
    (row,) = rate_differences(list(compare(votes, settings)), settings.as_dict())
    return row


TRIALS: dict[str, Callable[[int, int], Iterator[str]]] = {
    "order": order_lines,
    "checks": check_lines,
    "agreement": agreement_lines,
    "spreads": spread_lines,
    "rates": rate_lines,
}

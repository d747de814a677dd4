"""Hold what the experiment's report is made from: scores, the truth that was put in, and measures."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from app.analysis.model.contrasts import SIGNIFICANT
from app.analysis.reading.votes_table import ALL
from app.experiment.study import has_adaptive_pairs
from app.files import read_json
from app.intake.reports import Measure

SPHERE = "validation/sphere"


@dataclass(frozen=True)
class Results:
    """Answers and measures of an experiment.

    Parameters
    ----------
    out : the experiment's folder
    answers : what the people answered, with the truth that was put in
    objective : how it was measured, with which parameters
    measures : what was measured of the approaches
    seconds : that each step took
    """

    out: Path
    answers: Mapping[str, Any]
    objective: Mapping[str, Any]
    measures: Sequence[Measure]
    seconds: Mapping[str, float]

    @property
    def analysis(self) -> Mapping[str, Any]:
        analysis: Mapping[str, Any] = self.answers["analysis"]
        return analysis

    @property
    def levels(self) -> Mapping[str, Mapping[str, str]]:
        """The level of each factor, by approach; models by other programs may have none."""
        levels: Mapping[str, Mapping[str, str]] = self.objective["levels"]
        return levels

    @property
    def factors(self) -> list[str]:
        """The factors that the approaches differ in."""
        return list(dict.fromkeys(factor for levels in self.levels.values() for factor in levels))

    def sphere(self) -> dict[str, Any]:
        """Read the report on the sphere."""
        return read_json(self.out / SPHERE / "report.json")

    @property
    def has_effects(self) -> bool:
        """Are the scores of a factor's levels their effects, all else equal? Of adaptive pairs, few differ in one
        factor only.
        """
        return has_adaptive_pairs(len(self.levels))

    def effect_rows(self, factor: str) -> list[dict[str, Any]]:
        """Return the effects as `score_rows`, of datasets whose votes set all of them a limit; else none."""
        rows = self.analysis["effects"] if self.has_effects else []
        return [{**row, "item": row["level"], "score": row["effect"]} for row in rows if row["factor"] == factor]

    def score_rows(self, comparison: str) -> list[dict[str, Any]]:
        """Return `dataset`, `item`, `score` with its interval, and `letters`; none without a finite score."""
        effects = self.effect_rows(comparison)
        with_effects = {row["dataset"] for row in effects}
        return effects + [
            dict(row)
            for row in self.analysis["scores"]
            if row["comparison"] == comparison and row["score"] is not None and row["dataset"] not in with_effects
        ]

    def scores(self, comparison: str, dataset: str) -> dict[str, float]:
        """Return the scores by item, best first; nothing for an item whose votes set its score no limit."""
        scored = ((row["item"], row["score"]) for row in self.score_rows(comparison) if row["dataset"] == dataset)
        return dict(sorted(scored, key=lambda pair: -pair[1]))

    def told_apart(self, comparison: str, dataset: str) -> set[tuple[str, str]]:
        """Return the pairs (better, worse) that the votes tell apart."""
        if effects := [row for row in self.effect_rows(comparison) if row["dataset"] == dataset]:
            rows = [row for row in effects if row["letters"]]
            return {
                (better["item"], worse["item"])
                for better, worse in permutations(rows, 2)
                if better["score"] > worse["score"] and not set(better["letters"]) & set(worse["letters"])
            }
        return {
            (row["item_a"], row["item_b"]) if row["difference"] > 0 else (row["item_b"], row["item_a"])
            for row in self.analysis["contrasts"]
            if (row["comparison"], row["dataset"]) == (comparison, dataset) and row["p_holm"] < SIGNIFICANT
        }

    def mean_ratings(self) -> dict[str, float]:
        """Return the mean rating by "dataset/approach", relative to its dataset's mean; none where nobody rated."""
        rows = self.answers.get("ratings", {}).get("rating_items", [])
        values: dict[str, list[float]] = {}
        for row in rows:
            values.setdefault(row["dataset"], []).append(row["mos"])
        return {f"{row['dataset']}/{row['condition']}": row["mos"] - fmean(values[row["dataset"]]) for row in rows}

    def truth(self, comparison: str, dataset: str) -> dict[str, float]:
        """Return what was put in: the mean ability by approach, or a factor's effects by level, best first."""
        values: dict[str, list[float]] = {}
        for name, ability in self.answers["abilities"].items():
            scene, approach = name.split("/")
            if dataset in (ALL, scene):
                values.setdefault(approach, []).append(ability)
        means = {approach: fmean(abilities) for approach, abilities in values.items()}
        items = means if comparison == ALL else _effects(comparison, means, self.levels)
        return dict(sorted(items.items(), key=lambda pair: -pair[1]))


def _effects(factor: str, abilities: Mapping[str, float], levels: Mapping[str, Mapping[str, str]]) -> dict[str, float]:
    """Return the effect of each level of a factor, the others apart: least squares, as not all levels may be combined.

    Parameters
    ----------
    factor : such as "depth"
    abilities, levels : by approach
    """
    names = [name for name in abilities if levels[name]]
    columns = list(dict.fromkeys(pair for name in names for pair in levels[name].items()))
    design = np.array([[levels[name].get(known) == level for known, level in columns] for name in names], np.float64)
    effects = np.linalg.lstsq(design, np.array([abilities[name] for name in names]))[0].tolist()
    return {level: effect for (known, level), effect in zip(columns, effects, strict=True) if known == factor}


def screened_out(results: Results) -> list[tuple[str, str]]:
    """Return participant and test of every failed screening."""
    return [(row["participant"], row["test"]) for row in results.answers["screening"] if row["verdict"] == "failed"]


def order_text(
    items: Sequence[str] | Mapping[str, float], told_apart: Collection[tuple[str, str]] | None = None
) -> str:
    """Write items as "pm ≈ dr > id"; ≈ stands between neighbours that votes, where there are any, leave open."""
    names = list(items)
    text = names[0] if names else "–"
    for pair in pairwise(names):
        text += f" {'>' if told_apart is None or pair in told_apart else '≈'} {pair[1]}"
    return text

"""Compare objective measures with scores: of pair comparisons, of opinions, of comparison ratings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from app.analysis.model.scales import rating_unit
from app.analysis.model.settings import AnalysisSettings
from app.analysis.objective.comparison import comparison_rows
from app.analysis.objective.points import ScoreSet, matched
from app.analysis.objective.prediction import prediction_rows
from app.analysis.rates.curves import BYTES
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]


def measure_tables(scored: Mapping[str, ScoreSet], settings: AnalysisSettings) -> dict[str, list[dict[str, Any]]]:
    """Return the tables `measures` and `measure_comparisons` of an analysis; a model's size predicts no score.

    Parameters
    ----------
    scored : dataset -> scores
    settings : its measures, their directions, and the seed
    """
    rng = np.random.default_rng([settings.seed, 1])
    measures = {measure: values for measure, values in settings.measures.items() if measure != BYTES}
    predictions = prediction_rows(scored, measures, settings.better, rng)
    points = {measure: matched(scored, values) for measure, values in measures.items()}
    return {"measures": predictions, "measure_comparisons": comparison_rows(points, settings.better, rng)}


def compared_scores(analysis: Mapping[str, Any]) -> list[Row]:
    """Return the scores that an analysis compares measures with: `dataset, item, score, ci_low, ci_high`.

    Those of votes on pairs, where there are any; else mean opinion scores, else scores of comparison ratings.
    """
    if analysis["scores"]:
        return [row for row in analysis["scores"] if row["comparison"] == ALL]
    if analysis.get("rating_items"):
        return [{**row, "item": row["condition"], "score": row["mos"]} for row in analysis["rating_items"]]
    return [{**row, "item": row["condition"]} for row in analysis.get("comparison_items", ())]


def score_unit(analysis: Mapping[str, Any]) -> str:
    """Return the unit of these scores, in words."""
    if analysis["scores"]:
        return "log-odds"
    models = [*analysis.get("rating_model", ()), *analysis.get("comparison_models", ())]
    return rating_unit(models[0]) if models else "grades"

"""Compose the content of analysis.json from tables of ratings, with or without votes on pairs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.analysis.findings.ratings import rating_findings
from app.analysis.model.settings import AnalysisSettings
from app.analysis.objective.against_scores import compared_scores, measure_tables
from app.analysis.objective.points import ScoreSet
from app.analysis.rates.rows import rate_rows
from app.analysis.tables import TABLES
from app.analysis.warnings import measure_warnings

NO_VOTES: dict[str, Any] = {  # the keys of an analysis of votes, where there are none
    "schema_version": 1,
    "votes": None,
    "dataset_concordance": None,
    "order": None,
    "disagreement": None,
    "findings": [],
    "warnings": [],
    **{name: [] for name in TABLES},
}


def with_tables(analysis: Mapping[str, Any], tables: Mapping[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return an analysis with tables of ratings, and their warnings and findings among its own.

    Parameters
    ----------
    analysis : of votes, or `NO_VOTES`
    tables : of `analyse_ratings`, `align` or `analyse_comparisons`
    """
    planned = analysis["settings"].get("planned_participants") if analysis["votes"] is None else None
    return {
        **analysis,
        **{name: rows for name, rows in tables.items() if name != "rating_warnings"},
        "warnings": [*analysis["warnings"], *(row["warning"] for row in tables["rating_warnings"])],
        "findings": [*analysis["findings"], *rating_findings(tables, planned)],
    }


def with_measures(
    analysis: Mapping[str, Any], scored: Mapping[str, ScoreSet], settings: AnalysisSettings
) -> dict[str, Any]:
    """Return an analysis with measures compared with the scores of ratings, and warnings about them.

    Parameters
    ----------
    analysis : that has the tables of ratings
    scored : dataset -> scores
    settings : its measures and their directions
    """
    measured = measure_tables(scored, settings)
    known = {**analysis["settings"], "measures": settings.measures, "better": settings.better}
    return {
        **analysis,
        **measured,
        "rates": rate_rows(compared_scores(analysis), known),
        "settings": known,
        "warnings": [*analysis["warnings"], *measure_warnings(measured["measures"])],
    }

"""A study's votes through the analysis, which is loaded when it is first needed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.reports import by_measure
from app.store.designs import conditions_of
from app.store.engine import Database
from app.store.measurements import measurement_records
from app.store.votes import vote_records


def analysis_of(database: Database, study_id: int) -> dict[str, Any] | None:
    """The content of analysis.json for the votes so far; None while there are none."""
    from app.analysis import AnalysisSettings, analyse, votes_from_rows

    with database.reading() as connection:
        rows = list(vote_records(connection, study_id))
        levels = conditions_of(connection, study_id)
        measures = by_measure(measurement_records(connection, study_id))
    settings = AnalysisSettings(factors=items_factors(levels), measures=measures)
    return analyse(votes_from_rows(rows), settings) if rows else None


def items_factors(levels: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """Levels by item for each factor that every item has a level of."""
    factors = dict.fromkeys(factor for own in levels.values() for factor in own)
    return {
        factor: {item: own[factor] for item, own in levels.items()}
        for factor in factors
        if all(factor in own for own in levels.values())
    }


def measure_svg(analysis: dict[str, Any], measure: str) -> str | None:
    """The plot of the scores against an attached measure; None if no item has both."""
    from app.analysis.charts import chart_svg, measure_chart

    chart = measure_chart(analysis, measure)
    return None if chart is None else chart_svg(chart)


def scores_svg(analysis: dict[str, Any], comparison: str) -> str | None:
    """The plot of a comparison's scores ("all", or a factor); None if there are none."""
    from app.analysis.charts import chart_svg, scores_chart

    chart = scores_chart(analysis, comparison)
    return None if chart is None else chart_svg(chart)

"""A study's votes through the analysis, which is loaded when it is first needed."""

from __future__ import annotations

from typing import Any

from app.store.engine import Database
from app.store.votes import vote_records


def analysis_of(database: Database, study_id: int) -> dict[str, Any] | None:
    """The content of analysis.json for the votes so far; None while there are none."""
    from app.analysis import analyse
    from app.analysis.votes import votes_from_rows

    with database.reading() as connection:
        rows = list(vote_records(connection, study_id))
    return analyse(votes_from_rows(rows)) if rows else None


def scores_svg(analysis: dict[str, Any]) -> str:
    """The plot of all scores."""
    from app.analysis.charts import chart_svg, scores_chart

    return chart_svg(scores_chart(analysis))

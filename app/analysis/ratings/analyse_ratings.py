"""Run the whole analysis of ratings."""

from __future__ import annotations

from typing import Any

from app.analysis.ratings.opinion_scores import item_rows
from app.analysis.ratings.table import RatingTable


def analyse_ratings(table: RatingTable) -> dict[str, list[dict[str, Any]]]:
    """Analyse ratings: mean opinion scores of items and conditions, participants, and what to be warned of.

    Parameters
    ----------
    table : RatingTable

    Returns
    -------
    dict, the rows of each table by its name; only lists, dictionaries, text, numbers and None
    """
    return {"rating_items": list(item_rows(table))}

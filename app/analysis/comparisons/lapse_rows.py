"""Turn scores with lapse rates into the rows of analysis.json."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.analysis.comparisons.comparison import Comparison
from app.analysis.model.contrasts import or_none
from app.analysis.model.lapses import fit_lapses
from app.analysis.reading.votes_table import ALL


def lapse_tables(compared: Sequence[Comparison]) -> tuple[dict[str, list[dict[str, Any]]], list[str]]:
    """Fit the scores of all items on all datasets together with a lapse rate for each participant.

    Parameters
    ----------
    compared : the fits without lapses

    Returns
    -------
    The tables `lapse_scores` and `lapse_rates`, and in a sentence why they are empty.
    """
    tables: dict[str, list[dict[str, Any]]] = {"lapse_scores": [], "lapse_rates": []}
    for row in compared:
        if row.comparison != ALL or row.dataset != ALL:
            continue
        lapses = fit_lapses(row.fit, row.votes)
        if isinstance(lapses, str):
            return tables, [f"there are no scores with lapse rates: {lapses}"]
        ends = lapses.scores - lapses.half, lapses.scores + lapses.half
        columns = (or_none(part) for part in (lapses.scores, lapses.errors, *ends))
        tables["lapse_scores"] = [
            dict(zip(("item", "score", "se", "ci_low", "ci_high"), numbers, strict=True))
            for numbers in zip(row.fit.items, *columns, strict=True)
        ]
        people = [row.votes.participants[index] for index in lapses.people]
        tables["lapse_rates"] = [
            {"participant": name, "lapse_rate": rate} for name, rate in zip(people, lapses.rates.tolist(), strict=True)
        ]
    return tables, []

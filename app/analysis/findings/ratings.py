"""Say in sentences what an analysis of ratings shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from app.analysis.findings.pairs import better_first
from app.analysis.findings.ranking import Condition, tested_ranking, untested_ranking
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, MOST_ITEMS
from app.analysis.reading.phrases import (
    counted,
    finding,
    listed,
    number_with_interval,
    outstanding,
    p_phrase,
    signed,
    unsigned,
)
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]


def rating_findings(tables: Mapping[str, Sequence[Row]]) -> list[dict[str, str]]:
    """Return what an analysis of ratings shows, of single films or of comparisons.

    Parameters
    ----------
    tables : the tables of `analyse_ratings` or `analyse_comparisons`

    Returns
    -------
    list of dict, `about` and `text`
    """
    if tables.get("rating_conditions"):
        return list(_opinions(tables))
    return list(_comparisons(tables)) if tables.get("comparison_items") else []


def _opinions(tables: Mapping[str, Sequence[Row]]) -> Iterator[dict[str, str]]:
    model, raters = tables["rating_model"][0], tables["raters"]
    references = {row["condition"] for row in tables["rating_items"] if row["is_reference"]}
    rows = [row for row in tables["rating_conditions"] if row["condition"] not in references and row["mos"] is not None]
    conditions = [
        Condition(row["condition"], number_with_interval(row, "mos"), row["letters"])
        for row in sorted(rows, key=lambda row: -row["mos"])
    ]
    contrasts = [row for row in tables["rating_contrasts"] if not references & {row["item_a"], row["item_b"]}]
    n_people = model["n_participants"]
    if len(conditions) > 1 and len(contrasts) == len(conditions) * (len(conditions) - 1) // 2:
        difference = _difference(conditions[0].name, conditions[-1].name, contrasts)
        yield from tested_ranking(conditions, contrasts, "mean rating", difference, where="", beyond="")
    elif len(conditions) > 1:
        yield untested_ranking(conditions, "mean rating", _why_not_tested(n_people, len(conditions)))
    if references:
        yield finding("reference", f"The hidden reference {listed(sorted(references))} takes no part in this ranking.")
    if n_people == 1:
        yield finding("limits", "A single participant rated: nothing can be concluded about other people.")
    elif n_people < FEWEST_PARTICIPANTS:
        yield finding(
            "limits",
            f"{n_people} participants are few (fewer than {FEWEST_PARTICIPANTS}): intervals rest on at most "
            f"{counted(n_people - 1, 'degree')} of freedom; treat the results as provisional.",
        )
    yield finding("participants", outstanding(raters))
    yield finding(
        "settings",
        f"Settings: {model['protocol'].upper()}, scale {model['low']:g} to {model['high']:g}, means over participants "
        "with 95 % intervals by t; all pairs of conditions compared within participants and corrected by Holm.",
    )


def _why_not_tested(n_people: int, n_conditions: int) -> str:
    if n_conditions > MOST_ITEMS:
        return f"{n_conditions} conditions have too many pairs"
    return (
        "a single participant rated" if n_people == 1 else "some pairs were not rated by two of the same participants"
    )


def _difference(best: str, worst: str, contrasts: Sequence[Row]) -> str:
    (pair,) = better_first(row for row in contrasts if {row["item_a"], row["item_b"]} == {best, worst})
    if pair["ci_low"] is None:
        interval, test = "no interval, as all agree", f"{pair['method']}, Holm"
    else:
        interval, test = f"95 % interval {unsigned(pair['ci_low'])} to {unsigned(pair['ci_high'])}", "Holm"
    by = f"{unsigned(pair['difference'])} grades above {pair['item_b']}"
    return f"Participants rate {pair['item_a']} {by} ({interval}), {p_phrase(pair['p_holm'])} ({test})."


def _comparisons(tables: Mapping[str, Sequence[Row]]) -> Iterator[dict[str, str]]:
    datasets = dict.fromkeys(row["dataset"] for row in tables["comparison_items"])
    for dataset in [ALL] if ALL in datasets else datasets:
        rows = [row for row in tables["comparison_items"] if row["dataset"] == dataset]
        rows.sort(key=lambda row: -row["score"])
        conditions = [
            Condition(row["condition"], number_with_interval(row, "score", show=signed), None) for row in rows
        ]
        if len(conditions) > 1:
            yield untested_ranking(conditions, "comparison rating", "intervals of these scores are given, not tests")
    has_order = any(row["order_effect"] is not None for row in tables["comparison_models"])
    yield finding(
        "settings",
        "Settings: comparison ratings (CCR), least squares scale in grades"
        f"{' with the order effect taken off' if has_order else ''}, 95 % intervals over participants.",
    )

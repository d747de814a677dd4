"""Say what makes a difference to the votes: factors, datasets, ties, the order of showing, groups, measures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from app.analysis.findings.factors import factor_findings, p_of_test
from app.analysis.findings.ranking import overall, preferred_share
from app.analysis.model.contrasts import SIGNIFICANT, holm
from app.analysis.objective.prediction import directed, measures_by_rank
from app.analysis.reading.phrases import counted, finding, listed, p_phrase, percent, signed
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]


def influence_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield what the tests over all datasets say about factors, datasets, ties, order and groups."""
    yield from factor_findings(analysis)
    yield from _datasets(analysis)
    yield from _groups(analysis)
    yield from _order(analysis)
    yield from _ties(analysis["votes"])
    yield from _measures(analysis)


def _datasets(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    p = p_of_test(analysis, "datasets differ", ALL)
    n = len(analysis["votes"]["datasets"])
    if p is None or n < 2:
        return
    if p >= SIGNIFICANT:
        yield finding("datasets", f"No difference between the {n} datasets is shown ({p_phrase(p)}).")
        return
    tops: dict[str, list[str]] = {}
    for dataset in analysis["votes"]["datasets"]:
        rows = [r for r in analysis["scores"] if (r["comparison"], r["dataset"]) == (ALL, dataset)]
        if rows and all(row["score"] is not None for row in rows):
            tops.setdefault(max(rows, key=lambda row: row["score"])["item"], []).append(dataset)
    named = "; ".join(f"{item} on {listed(names)}" for item, names in tops.items())
    yield finding(
        "datasets",
        f"The scores differ between the {n} datasets ({p_phrase(p)}), so what holds over all is an average."
        + (f" Highest score: {named}." if named else ""),
    )


def _groups(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    compared = {row["grouping"] for row in analysis["groups"]}
    for grouping in analysis["settings"]["groups"]:
        p = p_of_test(analysis, f"group {grouping}", "items")
        if grouping not in compared:
            text = f"There is nothing to compare by {grouping}: all who voted and have a group are in one."
        elif p is None:
            text = f"Whether the groups differ by {grouping} could not be tested with these participants."
        else:
            shown = "The groups differ" if p < SIGNIFICANT else "No difference of the groups is shown"
            text = f"{shown} by {grouping} ({p_phrase(p)})."
        yield finding("groups", text)


def _order(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    model = overall(analysis["models"])[0]
    if model["order_left_out"]:
        text = f"No order effect is estimated, and the scores do not allow for one: {model['order_left_out']}."
        yield finding("order", text)
    effect, tested = model["order_effect"], analysis["order"]
    if effect is None and tested is not None:
        yield finding(
            "order",
            f"No effect of being shown first is shown ({signed(tested['order_effect'])} log-odds, "
            f"{p_phrase(tested['p_value'])}), and the scores do not allow for one.",
        )
    p = p_of_test(analysis, "order effect", ALL)
    if effect is None or p is None:
        return
    log_theta = model.get("log_theta") or 0.0
    if p >= SIGNIFICANT:
        yield finding("order", f"No effect of being shown first is shown ({signed(effect)} log-odds, {p_phrase(p)}).")
    else:
        yield finding(
            "order",
            f"Being shown first {'helps' if effect > 0 else 'harms'}: of two equal conditions, the model predicts, the "
            f"first is preferred in {percent(preferred_share(effect, log_theta))} of decided votes "
            f"({signed(effect)} log-odds, {p_phrase(p)}). The scores are free of it.",
        )


def _ties(votes: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    if votes["ties"] == votes["analysed"]:
        yield finding("ties", f"All {votes['analysed']} votes are without preference.")
    elif votes["ties"]:
        share = percent(votes["ties"] / votes["analysed"])
        yield finding("ties", f"{votes['ties']} of {votes['analysed']} votes ({share}) are without preference.")


def _measures(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Say which objective measure follows the scores most closely, if any is shown to, and which go against them.

    The p-values are corrected over the measures.
    """
    ranked = list(measures_by_rank(analysis["measures"]).values())
    tested = [row for row in ranked if row["pearson_p"] is not None]
    corrected = holm(np.array([row["pearson_p"] for row in tested])).tolist()
    clear = [(row, p) for row, p in zip(tested, corrected, strict=True) if p < SIGNIFICANT]
    following = [(row, p) for row, p in clear if (directed(row, "pearson") or 0.0) > 0]
    against = [_correlated(row, p, len(tested)) for row, p in clear if (row, p) not in following]
    if following:
        what = counted(len(ranked), "objective measure")
        shown = f"{len(following)} {'is' if len(following) == 1 else 'are'} shown to go with the scores"
        best = f"the highest rank correlation has {_correlated(*following[0], len(tested))}"
        yield finding("measures", f"Of {what}, {shown}; {best}.")
    elif ranked:
        what = "the objective measure" if len(ranked) == 1 else f"any of the {len(ranked)} objective measures"
        yield finding("measures", f"It is not shown that {what} predicts the scores.")
    if against:
        yield finding(
            "measures", f"Shown to go against the scores, in the direction that they state: {listed(against)}."
        )


def _correlated(row: Row, p: float, n_measures: int) -> str:
    """Return a measure with its correlation."""
    method = f", Holm over {n_measures} measures" if n_measures > 1 else ""
    return f"{row['measure']} (Pearson {signed(row['pearson'])}, {p_phrase(p)}{method})"

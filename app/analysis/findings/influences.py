"""Say what makes a difference to the votes: factors, datasets, ties, the order of showing, groups, measures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from app.analysis.findings.factors import factor_findings, p_of_test
from app.analysis.findings.ranking import EQUAL, here, of_few, overall, preferred_share
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, SIGNIFICANT, critical_value, holm
from app.analysis.objective.prediction import directed, measures_by_rank
from app.analysis.reading.phrases import (
    counted,
    finding,
    interval,
    listed,
    number_with_interval,
    p_phrase,
    percent,
    signed,
)
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
            highest = max(row["score"] for row in rows)
            best = [row["item"] for row in rows if highest - row["score"] < EQUAL]
            tops.setdefault(listed(best) + ", the same," * (len(best) > 1), []).append(dataset)
    named = "; ".join(f"{items} on {listed(names)}" for items, names in tops.items())
    yield finding(
        "datasets",
        f"The scores differ between the {n} datasets ({p_phrase(p)}), so what holds over all is an average."
        + (f" Highest score by its own votes, not tested: {named}." if named else ""),
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
            people = analysis["votes"]["participants"]
            few = ", cautious with so few people" if people is not None and people < FEWEST_PARTICIPANTS else ""
            text = f"{shown} by {grouping}{here(analysis)} ({p_phrase(p)}, Holm over all tests{few})."
        yield finding("groups", text)


def _order(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    model = overall(analysis["models"])[0]
    if model["order_left_out"]:
        text = f"No order effect is estimated, and the scores do not allow for one: {model['order_left_out']}."
        yield finding("order", text)
    effect, tested = model["order_effect"], analysis["order"]
    p = p_of_test(analysis, "order effect", ALL)
    error = model["order_se"] if analysis["votes"]["participants"] is None else model["order_se_participant"]
    if effect is None and tested is not None:
        effect, p, error = tested["order_effect"], tested["p_value"], tested["order_se"]
    if effect is None or p is None:
        return
    size = f"{signed(effect)} log-odds{_around(effect, error, analysis['votes']['participants'])}, {p_phrase(p)}"
    if model["order_effect"] is None:
        yield finding(
            "order",
            f"No effect of being shown first is shown ({size}, 1 % level), and the scores do not allow for one.",
        )
    elif p >= SIGNIFICANT:
        yield finding("order", f"No effect of being shown first is shown ({size}).")
    else:
        share = percent(preferred_share(effect, model.get("log_theta") or 0.0))
        few = of_few(analysis, "effect")
        yield finding(
            "order",
            f"Being shown first {'helps' if effect > 0 else 'harms'}: of two equal conditions, the model predicts, the "
            f"first is preferred in {share} of decided votes ({size}){few}. The scores are free of it.",
        )


def _around(effect: float, error: float | None, n_people: int | None) -> str:
    """Return ", 95 % interval … to …"; empty without an error."""
    if error is None or n_people == 1:
        return ""
    half = critical_value(n_people) * error
    return f", {interval(signed(effect - half), signed(effect + half))}"


def _ties(votes: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    if votes["ties"] == votes["analysed"]:
        which = "The only vote is" if votes["ties"] == 1 else f"All {votes['ties']} votes are"
        yield finding("ties", f"{which} without preference.")
    elif votes["ties"]:
        share = percent(votes["ties"] / votes["analysed"])
        are = "is" if votes["ties"] == 1 else "are"
        yield finding("ties", f"{votes['ties']} of {votes['analysed']} votes ({share}) {are} without preference.")


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
        best = _correlated(*following[0], len(tested))
        yield finding("measures", f"Of {what}, {shown}{here(analysis)}; closest by rank is {best}.")
    elif ranked:
        what = "the objective measure" if len(ranked) == 1 else f"any of the {len(ranked)} objective measures"
        yield finding("measures", f"It is not shown that {what} predicts the scores.")
    if against:
        yield finding(
            "measures",
            f"Shown to go against the scores{here(analysis)}, in the direction that they state: {listed(against)}.",
        )


def _correlated(row: Row, p: float, n_measures: int) -> str:
    """Return a measure with its correlation."""
    method = f", Holm over {n_measures} measures" if n_measures > 1 else ""
    rank, pearson = (number_with_interval(row, name, name, show=signed) for name in ("spearman", "pearson"))
    return f"{row['measure']}, rank correlation {rank}, Pearson's {pearson}, {p_phrase(p)}{method}"

"""Say what makes a difference to the votes: factors, datasets, ties, the order of showing, groups, measures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from app.analysis.findings.ranking import level_text, overall, preferred_share, sharing_letters
from app.analysis.model.contrasts import SIGNIFICANT
from app.analysis.objective.prediction import directed, measures_by_rank
from app.analysis.reading.phrases import counted, finding, listed, p_phrase, percent, signed
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]


def influence_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield what the tests over all datasets say about factors, datasets, ties, order and groups."""
    yield from _factors(analysis)
    yield from _datasets(analysis)
    yield from _groups(analysis)
    yield from _order(analysis)
    yield from _ties(analysis["votes"])
    yield from _measures(analysis)


def _test(analysis: Mapping[str, Any], name: str, model: str) -> Row | None:
    tests = (row for row in analysis["tests"] if (row["name"], row["model"], row["dataset"]) == (name, model, ALL))
    return next(tests, None)


def _p_value(analysis: Mapping[str, Any], test: Row | None) -> float | None:
    """Return the corrected p-value that holds for other people; None if there is only one of votes."""
    if test is None or (test["p_participant"] is None and analysis["votes"]["participants"] is not None):
        return None
    return float(test["p_holm"])


def _factors(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    effects: dict[str, list[Row]] = {}
    for row in analysis["effects"]:
        if row["dataset"] == ALL:
            effects.setdefault(row["factor"], []).append(row)
    reach = {factor: _reach(rows) for factor, rows in effects.items()}
    ordered = sorted(effects, key=lambda factor: -reach[factor])
    if len(ordered) > 1 and reach[ordered[0]] > 0:
        first, *others = (f"{factor} ({reach[factor]:.2f})" for factor in ordered)
        yield finding(
            "factors",
            f"The levels of {first} lie farthest apart in log-odds, before those of {listed(others)}.",
        )
    for factor in ordered:
        yield finding("factors", _factor(analysis, factor, effects[factor]))
    interaction = _test(analysis, "interaction", "items")
    p = _p_value(analysis, interaction)
    if p is not None and p < SIGNIFICANT:
        yield finding(
            "factors",
            f"The factors do not simply add up (interaction, {p_phrase(p)}): what a level adds depends on the others, "
            "so read the scores of the conditions.",
        )


def _reach(rows: Sequence[Row]) -> float:
    effects = [row["effect"] for row in rows]
    return float(max(effects) - min(effects))


def _factor(analysis: Mapping[str, Any], factor: str, rows: Sequence[Row]) -> str:
    """Say whether a factor matters and by how much, all else equal."""
    ordered = sorted(rows, key=lambda row: -row["effect"])
    levels = ", ".join(level_text(row) for row in ordered)
    p = _p_value(analysis, _test(analysis, f"factor {factor}", "additive"))
    if p is None:
        return f"Whether {factor} matters could not be tested with these participants; its levels: {levels}."
    if p >= SIGNIFICANT:
        return f"No effect of {factor} is shown ({p_phrase(p)}); its levels: {levels}."
    log_theta = overall(analysis["models"])[0].get("log_theta") or 0.0
    share = percent(preferred_share(_reach(rows), log_theta))
    return (
        f"{factor} matters ({p_phrase(p)}): all else equal, {ordered[0]['level']} is preferred to "
        f"{ordered[-1]['level']} in {share} of decided votes; its levels: {levels}{_alike(ordered)}."
    )


def _alike(levels: Sequence[Row]) -> str:
    """Name the levels that are not told apart, if there are any."""
    groups = sharing_letters((row["level"], row["letters"]) for row in levels).values()
    return f"; not told apart: {'; '.join(listed(names, len(names)) for names in groups)}" if groups else ""


def _datasets(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    p = _p_value(analysis, _test(analysis, "datasets differ", ALL))
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
        p = _p_value(analysis, _test(analysis, f"group {grouping}", "items"))
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
    p = _p_value(analysis, _test(analysis, "order effect", ALL))
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
    """Say which objective measure follows the scores most closely, if any is shown to, and which go against them."""
    ranked = list(measures_by_rank(analysis["measures"]).values())
    clear = [row for row in ranked if row["pearson_p"] is not None and row["pearson_p"] < SIGNIFICANT]
    following = [row for row in clear if (directed(row, "pearson") or 0.0) > 0]
    against = [_correlated(row) for row in clear if row not in following]
    if following:
        what = counted(len(ranked), "objective measure")
        shown = f"{len(following)} {'is' if len(following) == 1 else 'are'} shown to go with the scores"
        yield finding("measures", f"Of {what}, {shown}; {_correlated(following[0])} most closely.")
    elif ranked:
        what = "the objective measure" if len(ranked) == 1 else f"any of the {len(ranked)} objective measures"
        yield finding("measures", f"It is not shown that {what} predicts the scores.")
    if against:
        yield finding(
            "measures", f"Shown to go against the scores, in the direction that they state: {listed(against)}."
        )


def _correlated(row: Row) -> str:
    """Return a measure with its correlation."""
    return f"{row['measure']} (Pearson {signed(row['pearson'])}, {p_phrase(row['pearson_p'])}, uncorrected)"

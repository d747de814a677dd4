"""Say what the factors do: main effects, or simple effects where factors do not add up, and what each holds for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from app.analysis.findings.pairs import better_first
from app.analysis.findings.ranking import (
    counted_votes,
    here,
    level_text,
    overall,
    preferred_share,
    sharing_letters,
    size_of,
)
from app.analysis.model.contrasts import SIGNIFICANT
from app.analysis.reading.phrases import finding, listed, p_phrase
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]

NO_VOTES = "the model of all votes, as none compares them"


def factor_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield what the tests over all datasets say about the factors; no main effect stands before an interaction."""
    effects: dict[str, list[Row]] = {}
    for row in analysis["effects"]:
        if row["dataset"] == ALL:
            effects.setdefault(row["factor"], []).append(row)
    if not effects:
        return
    interaction = p_of_test(analysis, "interaction", "items")
    if interaction is not None and interaction < SIGNIFICANT:
        yield finding("factors", _interaction(analysis, list(effects), interaction))
        if len(effects) == 2:
            for factor, other in (list(effects), list(effects)[::-1]):
                yield finding("factors", _simple_effects(analysis, factor, other))
        return
    for factor in sorted(effects, key=lambda name: -_reach(effects[name])):
        yield finding("factors", _factor(analysis, factor, effects[factor]))


def p_of_test(analysis: Mapping[str, Any], name: str, model: str) -> float | None:
    """Return the corrected p-value of a test over all datasets, that holds for other people; None if there is none.

    Parameters
    ----------
    analysis : the content of analysis.json
    name, model : as in `ModelTest`
    """
    tests = (row for row in analysis["tests"] if (row["name"], row["model"], row["dataset"]) == (name, model, ALL))
    test = next(tests, None)
    if test is None or (test["p_participant"] is None and analysis["votes"]["participants"] is not None):
        return None
    return float(test["p_holm"])


def _p_over_datasets(analysis: Mapping[str, Any], name: str, p: float) -> float | None:
    """Return the corrected p-value of a test that takes datasets as a sample; None if there is none.

    It is never below `p`, that for these datasets alone: what holds for more of them is no surer.
    """
    rows = (row for row in analysis["datasets_as_sample"] if row["name"] == name)
    return next((max(float(row["p_holm"]), p) for row in rows), None)


def _interaction(analysis: Mapping[str, Any], factors: Sequence[str], p: float) -> str:
    over = _p_over_datasets(analysis, "interaction", p)
    text = f"What a level adds depends on the other factors: {listed(factors)} do not simply add up"
    if over is None:
        return f"{text}{here(analysis)} (interaction, {p_phrase(p)}), so no effect of a factor alone is stated."
    if over < SIGNIFICANT:
        return (
            f"{text} (interaction, {p_phrase(p)}{here(analysis)}, {p_phrase(over)} for datasets like these), so no "
            "effect of a factor alone is stated."
        )
    return (
        f"{text}{here(analysis)} (interaction, {p_phrase(p)}), so no effect of a factor alone is stated; for datasets "
        f"like these it is not shown ({p_phrase(over)})."
    )


def _simple_effects(analysis: Mapping[str, Any], factor: str, other: str) -> str:
    """Say what a factor does on each level of the other one, from the pairs of conditions that differ in it alone."""
    levels, others = (analysis["settings"]["factors"][name] for name in (factor, other))
    contrasts = better_first(overall(analysis["contrasts"]))
    parts = []
    for level in dict.fromkeys(others[item] for item in _items(analysis) if item in others):
        within = [
            row
            for row in contrasts
            if others.get(row["item_a"]) == others.get(row["item_b"]) == level
            and levels.get(row["item_a"]) != levels.get(row["item_b"])
        ]
        clear = [row for row in within if row["p_holm"] < SIGNIFICANT]
        if within and not clear:
            parts.append(f"with {level} its levels are not told apart")
        elif clear:
            told = [
                f"{levels[row['item_a']]} is preferred to {levels[row['item_b']]} in "
                f"{counted_votes(analysis, row['item_a'], row['item_b']) or NO_VOTES} ({p_phrase(row['p_holm'])})"
                for row in clear
            ]
            parts.append(f"with {level}, {listed(told)}")
    told_all = "; ".join(parts) if parts else "no pair of conditions differs in it alone"
    return f"{factor}, by {other}{here(analysis)} (all pairs of conditions, Holm): {told_all}."


def _items(analysis: Mapping[str, Any]) -> list[str]:
    return list(analysis["votes"]["items"])


def _reach(rows: Sequence[Row]) -> float:
    effects = [row["effect"] for row in rows]
    return float(max(effects) - min(effects))


def _factor(analysis: Mapping[str, Any], factor: str, rows: Sequence[Row]) -> str:
    """Say whether an effect of a factor is shown, for which datasets, and how large it is."""
    ordered = sorted(rows, key=lambda row: -row["effect"])
    levels, where = listed([level_text(row) for row in ordered], len(ordered)), here(analysis)
    p = p_of_test(analysis, f"factor {factor}", "additive")
    if p is None:
        return f"Whether {factor} matters could not be tested; its levels{where}: {levels}."
    if p >= SIGNIFICANT:
        return f"No effect of {factor} is shown{where} ({p_phrase(p)}); its levels: {levels}."
    over = _p_over_datasets(analysis, f"factor {factor}", p)
    best, worst = ordered[0]["level"], ordered[-1]["level"]
    share = preferred_share(_reach(rows), overall(analysis["models"])[0].get("log_theta") or 0.0)
    votes = counted_votes(analysis, best, worst, factor)
    size = (
        f"{best} is preferred to {worst} in {votes} on pairs that differ in nothing else, by the model of all votes "
        f"{size_of(share)}"
        if votes
        else f"between {best} and {worst} the model predicts {size_of(share)}"
    )
    details = f"{size}; its levels: {levels}{_alike(ordered)}"
    if over is not None and over >= SIGNIFICANT:
        return (
            f"No effect of {factor} is shown for datasets like these ({p_phrase(over)}); {where.strip()} alone there "
            f"is one ({p_phrase(p)}): {details}."
        )
    if over is not None:
        return (
            f"An effect of {factor} is shown ({p_phrase(p)}{where}): {details}. It is shown for datasets like these, "
            f"too ({p_phrase(over)})."
        )
    return f"An effect of {factor} is shown{where} ({p_phrase(p)}): {details}."


def _alike(levels: Sequence[Row]) -> str:
    """Name the levels that are not told apart, if there are any."""
    groups = sharing_letters((row["level"], row["letters"]) for row in levels).values()
    return f"; not told apart: {'; '.join(listed(names, len(names)) for names in groups)}" if groups else ""

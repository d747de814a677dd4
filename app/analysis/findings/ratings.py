"""Say in sentences what an analysis of ratings shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from app.analysis.findings.pairs import better_first
from app.analysis.findings.people import interim_findings
from app.analysis.findings.ranking import EQUAL, Condition, both_or_all, tested_ranking, untested_ranking
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, MOST_ITEMS, SIGNIFICANT
from app.analysis.model.scales import rating_unit
from app.analysis.reading.phrases import (
    MOST_NAMED,
    counted,
    finding,
    interval,
    listed,
    number_with_interval,
    outstanding,
    p_phrase,
    percent,
    signed,
    unsigned,
)
from app.analysis.reading.votes_table import ALL
from app.analysis.screening.careless import FALSE_ALARMS

Row = Mapping[str, Any]

MANY_AT_ENDS = 0.25  # share of ratings, from which on the scale's ends make people look unlike (docs/simulation.md)


def rating_findings(tables: Mapping[str, Sequence[Row]], planned: int | None = None) -> list[dict[str, str]]:
    """Return what an analysis of ratings shows, of single films or of comparisons.

    Parameters
    ----------
    tables : the tables of `analyse_ratings` or `analyse_comparisons`
    planned : number of participants; results of fewer are interim

    Returns
    -------
    list of dict, `about` and `text`
    """
    models = [*tables.get("rating_model", ()), *tables.get("comparison_models", ())]
    early = interim_findings(max((row["n_participants"] for row in models), default=None), planned)
    if tables.get("rating_conditions"):
        return [*early, *_opinions(tables)]
    return [*early, *_comparisons(tables)] if tables.get("comparison_pairs") else []


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
    differ = any(row["p_holm"] < SIGNIFICANT for row in contrasts)
    if contrasts and not differ and max(row["mos"] for row in rows) - min(row["mos"] for row in rows) < EQUAL:
        yield finding(
            "ranking", f"{both_or_all(len(conditions))} have the same mean rating, {unsigned(rows[0]['mos'])}."
        )
    elif len(conditions) > 1 and len(contrasts) == len(conditions) * (len(conditions) - 1) // 2:
        difference = _difference(conditions[0].name, conditions[-1].name, contrasts, rating_unit(model))
        yield from tested_ranking(conditions, contrasts, "mean rating", difference, where="", beyond="")
    elif len(conditions) > 1:
        yield untested_ranking(conditions, "mean rating", _why_not_tested(n_people, len(conditions)))
    if references:
        yield finding("reference", f"The hidden reference {listed(sorted(references))} takes no part in this ranking.")
    yield from _limits(n_people)
    if model["disagreement"] is not None:
        yield finding("disagreement", _disagreement(model))
    yield finding("participants", f"{_outstanding(raters)}{_others(raters)} {_rules(raters)}")
    has_intervals = any(row["ci_low"] is not None for row in (*tables["rating_items"], *tables["rating_conditions"]))
    shown = (
        f"{'with 95 % intervals by t' if has_intervals else 'without intervals'}; all pairs of conditions compared "
        "within participants and corrected by Holm"
        if n_people > 1
        else "without intervals and tests"
    )
    yield finding(
        "settings",
        f"Settings: {model['protocol'].upper()}, scale {model['low']:g} to {model['high']:g}, means over participants "
        f"{shown}.",
    )


def _limits(n_people: int) -> Iterator[dict[str, str]]:
    """Yield what the number of participants forbids to conclude."""
    if n_people == 1:
        yield finding("limits", "A single participant rated: nothing can be concluded about other people.")
    elif n_people < FEWEST_PARTICIPANTS:
        yield finding(
            "limits",
            f"{n_people} participants are few (fewer than {FEWEST_PARTICIPANTS}): intervals rest on at most "
            f"{counted(n_people - 1, 'degree')} of freedom; treat the results as provisional.",
        )


def _outstanding(raters: Sequence[Row]) -> str:
    """Say who stands out, or that nobody could be compared."""
    if len(raters) > 1 and not any(row["flags"] or row["unlike_false_alarms"] is not None for row in raters):
        return "Nobody's ratings can be compared with the others': of too few people, or items, or all alike."
    return outstanding(raters)


def _disagreement(model: Row) -> str:
    """Say whether people disagree beyond their own noise, and name the camps."""
    tested = model["disagreement"]
    p_text, camps = p_phrase(tested["p_value"]), tested["camps"]
    if tested["p_value"] >= SIGNIFICANT:
        return f"It is not shown that people disagree more than their own noise explains ({p_text})."
    ends = (
        f" {percent(model['share_at_ends'])} of the ratings are at the ends of the scale, which may look like it."
        if model["share_at_ends"] > MANY_AT_ENDS
        else ""
    )
    text = (
        "People disagree more than their own noise explains: what somebody thinks of a condition on different datasets "
        f"goes together {tested['ratio']:.1f} times as much as by chance ({p_text}).{ends}"
    )
    if camps is None:
        return f"{text} Means are those of the average person; no two camps are shown."
    sizes = [len(names) for names in camps["participants"]]
    differences = [unsigned(value) for value in camps["differences"] if value is not None]
    between = (
        f": {camps['item_first']} less {camps['item_second']} is {differences[0]} {rating_unit(model)} in the one and "
        f"{differences[1]} in the other"
        if len(differences) == len(sizes)
        else ""
    )
    return (
        f"{text} They fall into two camps of {sizes[0]} and {sizes[1]} people ({p_phrase(camps['p_value'])}){between}. "
        "What holds over all describes neither camp."
    )


def _others(raters: Sequence[Row]) -> str:
    """Say how far those who stand out go with the others, and how often honest people would look so."""
    known = sorted(row["correlation_others"] for row in raters if row["correlation_others"] is not None)
    named = [
        row for row in raters if row["unlike_false_alarms"] is not None and row["unlike_false_alarms"] < FALSE_ALARMS
    ]
    parts = [
        f" The ratings of {row['participant']} correlate with the others' means by "
        f"{signed(row['correlation_others'])}, the middle participant's by {signed(known[len(known) // 2])}; among "
        f"{len(raters)} honest people {_expected(row['unlike_false_alarms'])} would look so."
        for row in named[:MOST_NAMED]
    ]
    return "".join(parts)


def _expected(alarms: float) -> str:
    return "fewer than 0.001" if alarms < 0.001 else f"{alarms:.3f}"


def _rules(raters: Sequence[Row]) -> str:
    """Count whom the rules of recommendations name, who are no more than a remark."""
    n_bt500, n_low = (sum(row[name] for row in raters) for name in ("is_bt500_outlier", "is_correlation_low"))
    return (
        f"Rules that name honest people, too: the screening of BT.500 {n_bt500}, a correlation with the means below "
        f"0.75 (VQEG) {n_low} of {len(raters)}; with conditions that look alike the latter names "
        "nearly everybody."
    )


def _why_not_tested(n_people: int, n_conditions: int) -> str:
    if n_conditions > MOST_ITEMS:
        return f"{n_conditions} conditions have too many pairs"
    return (
        "a single participant rated" if n_people == 1 else "some pairs were not rated by two of the same participants"
    )


def _difference(best: str, worst: str, contrasts: Sequence[Row], unit: str) -> str:
    (pair,) = better_first(row for row in contrasts if {row["item_a"], row["item_b"]} == {best, worst})
    if pair["ci_low"] is None:
        limits, test = "no interval, as all agree", f"{pair['method']}, Holm"
    else:
        limits, test = interval(unsigned(pair["ci_low"]), unsigned(pair["ci_high"])), "Holm"
    by = f"{unsigned(pair['difference'])} {unit} above {pair['item_b']}"
    return f"Participants rate {pair['item_a']} {by} ({limits}), {p_phrase(pair['p_holm'])} ({test})."


def _comparisons(tables: Mapping[str, Sequence[Row]]) -> Iterator[dict[str, str]]:
    items, models = tables["comparison_items"], tables["comparison_models"]
    people = {model["dataset"]: model["n_participants"] for model in models}
    datasets = dict.fromkeys(row["dataset"] for row in items)
    shown = [ALL] if ALL in datasets else list(datasets)
    if not items:
        yield finding("ranking", "No pair links some conditions to the others, so there is no ranking of them.")
    for dataset in shown:
        rows = [row for row in items if row["dataset"] == dataset]
        rows.sort(key=lambda row: -row["score"])
        conditions = [
            Condition(row["condition"], number_with_interval(row, "score", show=signed), None) for row in rows
        ]
        why = "intervals of these scores are given, not tests"
        if all(row["ci_low"] is None for row in rows):
            why = "a single participant rated" if people[dataset] == 1 else "all participants agree exactly"
        on = f" on {dataset}" if len(shown) > 1 else ""
        yield untested_ranking(conditions, f"comparison rating{on}", why)
    yield from _limits(max(people.values()))
    has_order = any(row["order_effect"] is not None for row in models)
    has_intervals = any(row["ci_low"] is not None for row in (*items, *tables["comparison_pairs"]))
    yield finding(
        "settings",
        f"Settings: comparison ratings (CCR), least squares scale in {rating_unit(models[0])}"
        f"{' with the order effect taken off' if has_order else ''}, "
        f"{'95 % intervals over participants' if has_intervals else 'without intervals'}.",
    )

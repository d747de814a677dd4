"""Say how far the participants allow conclusions: how many they are, whether they agree, and who stands out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import norm

from app.analysis.findings.ranking import overall
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, SIGNIFICANT, holm
from app.analysis.reading.phrases import (
    MOST_NAMED,
    counted,
    finding,
    listed,
    number_with_interval,
    outstanding,
    p_phrase,
    part,
    percent,
    signed,
    unsigned,
)
from app.analysis.screening.observers import CARELESS, FEWEST_FOR_FENCES
from app.analysis.screening.vote_evidence import FEWEST, MOST_ITEMS

ADAPTIVE = (  # bench/sentences.py
    "Pairs were chosen from the votes so far, which makes intervals a little too narrow: in simulations of {} people "
    "without any difference, 95 % intervals hold in {}, and some pair is said to differ in {} of studies, not 5 %."
)
CAUTIOUS = "That is cautious: with 8 simulated people, some pair is said to differ in 2 to 5 % of studies without one. "
MANY_ADAPTIVE = 60  # people, from which on intervals and tests hold nearly what they say
UNSEEN_VOTES = 75  # of a person, in bench/verdicts.py
UNSEEN = (
    "Without attention checks, who answers at random is found only where conditions differ clearly: in simulations of "
    f"{UNSEEN_VOTES} votes a person, 6 % of them at a range of 1.1 JOD, 92 % at 3 JOD"
)
UNJUDGED = (
    f"Nobody is judged by what their votes prefer: that takes three people, {FEWEST} decided votes a person, and "
    f"conditions that all have scores, {MOST_ITEMS} of them at most."
)
FEWER = 0.8  # of these votes, below which clearly fewer people are found
TRIAD = 3  # conditions
NARROW = (  # bench/sentences.py
    " People differ so far here that these intervals may be too narrow: in simulations of such people they hold in "
    "90 %, not 95 %."
)
FAR_APART = 0.04  # ratio of disagreement less 1, by votes of a person: 0.015 with opinions of 0.4 log-odds, 0.07 of 1.0
OTHERWISE = (  # bench/sentences.py
    "In simulations honest people answer 46 to 57 % of repeated pairs otherwise, those who click at random 64 %: few "
    "repeated pairs say little."
)
LAPSES = 0.2  # lapse rate from which on a sentence names somebody


def interim_findings(n: int | None, planned: int | None) -> Iterator[dict[str, str]]:
    """Yield that results are no conclusions before the planned number of participants; either may be unknown."""
    if n is not None and planned is not None and n < planned:
        yield finding("interim", _interim(n, planned))


def limit_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield what the number of participants forbids to conclude."""
    n, model = analysis["votes"]["participants"], overall(analysis["models"])[0]
    if analysis["settings"]["adaptive_pairs"]:
        is_large = n is not None and n >= MANY_ADAPTIVE
        yield finding("limits", ADAPTIVE.format(*(("60", "94 %", "6 %") if is_large else ("22", "93 %", "9 %"))))
    if n is None:
        yield finding(
            "limits",
            "Participants are not recorded: votes count as independent, so intervals are too narrow if people voted "
            "more than once.",
        )
    elif n == 1:
        yield finding("limits", "A single participant voted: nothing can be concluded about other people.")
    elif model["few_participants"] and any(row["ci_low"] is not None for row in overall(analysis["scores"])):
        why = (
            f"{n} participants are few (fewer than {FEWEST_PARTICIPANTS})"
            if n < FEWEST_PARTICIPANTS
            else f"{n} participants are no more than the numbers that are estimated"
        )
        yield finding(
            "limits",
            f"{why}, so errors are uncertain themselves: intervals and tests of pairs rest on the participants (t with "
            f"{counted(n - 1, 'degree')} of freedom), and are never surer than the number of votes allows. "
            f"{CAUTIOUS if n < FEWEST_PARTICIPANTS else ''}Treat the results as provisional.",
        )


def _interim(n: int, planned: int) -> str:
    """Say that results before the planned number are no conclusions, and what would be one all the same.

    Source
    ------
    Lan and DeMets (1983): the part of the 5 % that O'Brien and Fleming's bounds spend by a share of the participants.
    """
    spent = 2 * float(norm.sf(norm.isf(SIGNIFICANT / 2) / np.sqrt(n / planned)))
    level = f"{spent:.4f}" if spent < 0.001 else f"{spent:.3f}"
    counts = "Not even p = 0.0001 counts" if spent < 0.0001 else f"Only p below {level} counts"
    return (
        f"Interim: {n} of {planned} planned participants. Do not conclude: who looks several times finds differences "
        f"that are not there (five looks: 14 % of studies). {counts} so early (O'Brien and Fleming)."
    )


def people_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield how well participants agree, whether scores describe their votes, and who stands out."""
    yield from _agreement(analysis)
    yield from _fit(analysis)
    yield from _outstanding(analysis)
    if analysis["lapse_scores"]:
        yield finding("lapses", _lapses(analysis))


def _lapses(analysis: Mapping[str, Any]) -> str:
    """Say what the scores are with careless answers weighted down, and who was."""
    rates = sorted(analysis["lapse_rates"], key=lambda row: -row["lapse_rate"])
    high = [row for row in rates if row["lapse_rate"] >= LAPSES]
    named = listed([f"{row['participant']} ({percent(row['lapse_rate'])})" for row in high[:MOST_NAMED]])
    rest = f" and {len(high) - MOST_NAMED} more" if len(high) > MOST_NAMED else ""
    who = f"most those of {named}{rest}" if high else f"nobody's by a lapse rate of {percent(LAPSES)} or more"
    ordered = sorted(analysis["lapse_scores"], key=lambda row: -row["score"])
    first, last = (
        f"{row['item']}, {number_with_interval(row, 'score', show=signed)}" for row in (ordered[0], ordered[-1])
    )
    differs = analysis["disagreement"] and analysis["disagreement"]["heterogeneity"]
    opinions = (
        " Such a rate is no flag: people disagree, and opinions unlike the others' look like lapses, too."
        if high and differs and differs["p_value"] < SIGNIFICANT
        else ""
    )
    return (
        f"With careless answers weighted down ({who}) the highest score is that of {first}, the lowest that of {last}."
        f"{opinions}{NARROW if differs and _are_far_apart(analysis, differs['ratio']) else ''}"
    )


def _are_far_apart(analysis: Mapping[str, Any], ratio: float) -> bool:
    votes = analysis["votes"]
    return bool((ratio - 1) * votes["participants"] >= FAR_APART * votes["analysed"])


def _agreement(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    known = analysis["disagreement"]
    if known is None or not analysis["votes"]["analysed"]:
        return
    if known["alpha"] is None:
        yield finding(
            "agreement", "How far participants agree cannot be said: no pair has decided votes of two people."
        )
        return
    rows = [row for row in analysis["agreement"] if row["u"] is not None]
    tested = [row for row in rows if row["p_value"] is not None]
    beyond = np.count_nonzero(holm(np.array([row["p_value"] for row in tested])) < SIGNIFICANT)
    alpha = f"Participants agree with Krippendorff's alpha = {number_with_interval(known, 'alpha', 'alpha')}"
    differ = any(row["p_holm"] < SIGNIFICANT for row in overall(analysis["contrasts"]))
    cautious = "" if differ or known["alpha_low"] is None else ", which is cautious where conditions hardly differ"
    text = f"{alpha}{cautious}; 1: all alike, 0: chance."
    if rows:
        u = unsigned(sum(row["u"] for row in rows) / len(rows))
        if len(rows) == 1:
            tail = f" ({p_phrase(tested[0]['p_value'])})" if tested else ""
            text += f" Kendall's u = {u}{tail}."
        else:
            tail = f", more than by chance on {beyond} of them (Holm)" if tested else ""
            text += f" Kendall's u = {u} on average over {len(rows)} datasets{tail}."
    yield finding("agreement", text)
    if known["heterogeneity"] is not None:
        yield finding("disagreement", _disagreement(known["heterogeneity"]))


def _disagreement(tested: Mapping[str, Any]) -> str:
    """Say whether people disagree beyond their own noise, and name the camps."""
    p_text, camps = p_phrase(tested["p_value"]), tested["camps"]
    if tested["p_value"] >= SIGNIFICANT:
        return f"It is not shown that people disagree more than their own noise explains ({p_text})."
    text = (
        f"People disagree more than their own noise explains: a person's votes go together {tested['ratio']:.1f} times "
        f"as much as by chance ({p_text})."
    )
    if camps is None:
        return f"{text} Scores are those of the average person; no two camps are shown."
    first, second = camps["item_first"], camps["item_second"]
    sizes = [len(names) for names in camps["participants"]]
    counts = [f"{for_first} of {decided}" for for_first, decided in camps["votes"]]
    between = (
        f": {first} is preferred to {second} in {counts[0]} decided votes of the one, and in {counts[1]} of the other"
        if all(decided for _, decided in camps["votes"])
        else f", most over {first} and {second}"
    )
    return (
        f"{text} They fall into two camps of {sizes[0]} and {sizes[1]} people ({p_phrase(camps['p_value'])}){between}. "
        "What holds over all describes neither camp."
    )


def _fit(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    model = overall(analysis["models"])[0]
    p = model["p_value"]
    if p is not None and p < SIGNIFICANT and model["status"] == "ok":
        yield finding(
            "fit",
            f"A single score for each condition does not explain all votes (Pearson's X2, {p_phrase(p)}): look at the "
            "residuals, at the datasets and at the participants.",
        )


def _outstanding(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    observers = analysis["observers"]
    if not observers:
        return
    pooled = analysis["triads_pooled"]
    n_circular, n_people = sum(row["circular"] for row in pooled), sum(row["circular"] > 0 for row in pooled)
    circles = (
        f" {counted(n_circular, 'circular triad')} by {part(n_people, len(pooled), 'participant')}"
        f"{_circles_by_chance(pooled)}."
        if n_circular or any(row["complete"] and row["n_items"] >= TRIAD for row in analysis["triads"])
        else ""
    )
    few = (
        f"With {counted(len(observers), 'participant')} nobody can be compared with the others."
        if 1 < len(observers) < FEWEST_FOR_FENCES
        else ""
    )
    is_named = any(row["flags"] for row in observers)
    stands_out = "" if few and not is_named else outstanding(observers)  # nobody, where nobody is compared: not known
    why = [_evidence(row, len(observers)) for row in observers if CARELESS in row["flags"]][:MOST_NAMED]
    has_checks = any(row["n_identical"] or row["n_repeated"] for row in analysis["checks"])
    is_open = len(observers) > 1 and not (few or has_checks or is_named)
    unseen = _unseen(observers) if is_open else ""
    yield finding("participants", " ".join(filter(None, [stands_out, few, unseen, *why])) + circles)
    if has_checks:
        yield finding("checks", _checks(analysis["checks"]))


def _unseen(observers: Sequence[Mapping[str, Any]]) -> str:
    """Say who could not be found out: without checks, and with as many votes as there are."""
    if not any(row["careless"] and "votes" in row["careless"]["evidence"] for row in observers):
        return UNJUDGED
    n_votes = sum(row["n_votes"] for row in observers) / len(observers)
    fewer = f"; fewer of those who, as here, give {n_votes:.0f}" if n_votes < FEWER * UNSEEN_VOTES else ""
    return f"{UNSEEN}{fewer}."


def _circles_by_chance(pooled: Sequence[Mapping[str, Any]]) -> str:
    expected = sum(row["strict_by_chance"] for row in pooled)
    n = f"{expected:.0f}" if expected >= 10 else f"{expected:.1f}"
    return f"; votes at random with the same ties would make {n}" if expected else ""


def _evidence(row: Mapping[str, Any], n_people: int) -> str:
    """Say why somebody's answers are called careless, and how often honest people would look so."""
    careless = row["careless"]
    times = (
        "more than a million"
        if careless["log_likelihood_ratio"] > np.log(1e6)
        else (f"{np.exp(careless['log_likelihood_ratio']):.0f}")
    )
    alarms = careless["false_alarms"]
    expected = "fewer than 0.001" if alarms < 0.001 else f"{alarms:.3f}"
    words = f": {'; '.join(careless['words'])}" if careless["words"] else ""
    return (
        f"The answers of {row['participant']} are {times} times likelier from somebody who answers carelessly than "
        f"from somebody who answers as the others do{words}; among {n_people} honest people {expected} would look so."
    )


def _checks(rows: Sequence[Mapping[str, Any]]) -> str:
    """Count how often the attention checks were failed, and by whom most."""
    failed = {
        row["participant"]: row["n_identical"] - row["n_identical_none"] + row["n_repeated"] - row["n_repeated_same"]
        for row in rows
    }
    asked = {row["participant"]: row["n_identical"] + row["n_repeated"] for row in rows}
    identical, told = (sum(row[name] for row in rows) for name in ("n_identical", "n_identical_none"))
    repeated, same = (sum(row[name] for row in rows) for name in ("n_repeated", "n_repeated_same"))
    parts = [
        f"{identical - told} of {counted(identical, 'identical pair')} told apart" if identical else "",
        f"{repeated - same} of {counted(repeated, 'repeated pair')} answered otherwise than before" if repeated else "",
    ]
    worst = sorted(failed, key=lambda name: -failed[name])[:3]
    most = listed([f"{name} ({failed[name]} of {asked[name]})" for name in worst if failed[name]])
    text = f"Attention checks: {listed([part for part in parts if part])}{f'; most by {most}' if most else ''}."
    return f"{text} {OTHERWISE}" if same < repeated else text

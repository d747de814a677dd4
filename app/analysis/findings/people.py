"""Say how far the participants allow conclusions: how many they are, whether they agree, and who stands out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from app.analysis.findings.ranking import overall
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, SIGNIFICANT, holm
from app.analysis.reading.phrases import counted, finding, outstanding, p_phrase, unsigned
from app.analysis.screening.observers import FEWEST_FOR_FENCES


def limit_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield what the number of participants forbids to conclude."""
    n, model = analysis["votes"]["participants"], overall(analysis["models"])[0]
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
            f"{counted(n - 1, 'degree')} of freedom), and are never surer than the number of votes allows. Treat the "
            "results as provisional.",
        )


def people_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield how well participants agree, whether scores describe their votes, and who stands out."""
    yield from _agreement(analysis)
    yield from _fit(analysis)
    yield from _outstanding(analysis)


def _agreement(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    if analysis["votes"]["participants"] in (None, 1):
        return
    rows = [row for row in analysis["agreement"] if row["u"] is not None]
    if not rows:
        yield finding(
            "agreement",
            "How far participants agree is not summed up in one number: Kendall's u needs every pair judged once by "
            "the same number of participants, without ties.",
        )
        return
    tested = [row for row in rows if row["p_value"] is not None]
    beyond = np.count_nonzero(holm(np.array([row["p_value"] for row in tested])) < SIGNIFICANT)
    u = sum(row["u"] for row in rows) / len(rows)
    if len(rows) == 1:
        tail = f", {p_phrase(tested[0]['p_value'])}" if tested else ""
        yield finding(
            "agreement", f"Participants agree with Kendall's u = {unsigned(u)} (1: all alike, 0: chance{tail})."
        )
    else:
        tail = f", more than by chance on {beyond} of them (Holm)" if tested else ""
        yield finding(
            "agreement",
            f"Participants agree with Kendall's u = {unsigned(u)} on average over {len(rows)} datasets (1: all alike, "
            f"0: chance){tail}.",
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
        f" {counted(n_circular, 'circular triad')} by {n_people} of {counted(len(pooled), 'participant')}."
        if n_circular or any(row["complete"] for row in analysis["triads"])
        else ""
    )
    few = (
        f" With {counted(len(observers), 'participant')} nobody can be compared with the others."
        if len(observers) < FEWEST_FOR_FENCES
        else ""
    )
    yield finding("participants", f"{outstanding(observers)}{few}{circles}")

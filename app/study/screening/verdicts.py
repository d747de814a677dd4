"""Word the results of the vision screening as a reader would say them; it is a screening, not a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

NAMES = {"acuity": "Acuity", "colour": "Colour vision"}
PLATES = {
    "control": "plain control",
    "protan": "protan (red)",
    "deutan": "deutan (green)",
    "tritan": "tritan (blue)",
    "catch": "without a ring",
}
SNELLEN_FEET = 20


def snellen(logmar: float) -> str:
    """Return an acuity as a Snellen fraction, for example 20/30 for 0.18 logMAR."""
    return f"{SNELLEN_FEET}/{SNELLEN_FEET * 10**logmar:.0f}"


def worded_result(row: Mapping[str, Any]) -> str:
    """Word the result of a test: verdict, acuity with its interval and limit, plates read.

    Parameters
    ----------
    row : of the table `screening`
    """
    name = NAMES[row["test"]]
    if row["result_source"] == "entered":
        logmar = f" ({_logmar(row['logmar'])})" if row["logmar"] is not None else ""
        return f"{name}: {row['verdict']} by {row['instrument']}, read as {row['result']}{logmar}."
    if row["verdict"] is None:
        return f"{name}: the test is under way, {row['n_answered']} answered."
    details = row["details"] or {}
    sentences = [f"{name}: {row['verdict']}"]
    if "reason" in details:
        sentences[0] += f" ({details['reason']})"
    if row["logmar"] is not None:
        sentences += _acuity(row)
    if "plates" in details:
        sentences += _plates(details)
    return ". ".join(sentences) + "."


def worded_verdicts(verdicts: Mapping[str, tuple[str | None, float | None]]) -> str:
    """Word the verdicts that count in a few words, for a table: "passed (-0.04 logMAR)", "colour vision failed".

    Parameters
    ----------
    verdicts : verdict, None while the test runs, and acuity in logMAR, by test
    """
    if not verdicts:
        return ""
    by_verdict: dict[str, list[str]] = {}
    for test, (verdict, logmar) in verdicts.items():
        measured = f" {logmar:.2f} logMAR" if logmar is not None else ""
        by_verdict.setdefault(verdict or "under way", []).append(f"{NAMES[test].lower()}{measured}")
    return "; ".join(f"{verdict}: {', '.join(tests)}" for verdict, tests in by_verdict.items())


def _acuity(row: Mapping[str, Any]) -> list[str]:
    better = " or better, the display draws no smaller rings" if row["is_bound"] else ""
    said = [f"{_logmar(row['logmar'])}{better}"]
    if row["low"] is not None and row["high"] is not None:
        low, high = f"{row['low']:.2f}", f"{row['high']:.2f}"
        if low != high:  # alike to two decimals, as at the display's limit, they repeat the estimate
            said.append(f"With 95 % probability from {low} to {high} logMAR")
    if row["limit"] is not None:
        said.append(f"The study's limit is {_logmar(row['limit'])}; larger is worse")
    return said


def _plates(details: Mapping[str, Any]) -> list[str]:
    counts = [f"{PLATES.get(kind, kind)} {n['right']} of {n['of']}" for kind, n in details["plates"].items()]
    failed: Sequence[str] = details.get("failed_axes") or ()
    missed = [f"Too many missed: {', '.join(PLATES.get(axis, axis) for axis in failed)}"] if failed else []
    return [f"Plates answered right: {', '.join(counts)}", *missed]


def _logmar(value: float) -> str:
    return f"{value:.2f} logMAR ({snellen(value)})"

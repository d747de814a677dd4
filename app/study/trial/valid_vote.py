"""Check that a vote is valid: its viewing record contradicts neither itself nor the trial.

A record is `{"first_shown", "shown_ms", "response_ms", "switches": [{"to", "at_ms", "media_time_s"}]}` and what else a
client knows; times count from the first frame shown, `response_ms` from the voting screen.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import median
from typing import Any, Literal

from app.study.protocols import CCR, PC, Grades, Protocol
from app.study.trial.trial import Label

Choice = Literal["a", "b", "none"]


class InvalidVoteError(ValueError):
    """A vote's viewing record contradicts itself or the trial."""


def choice_of(choice: Choice | None, rating: int | None, protocol: Protocol, grades: Grades | None) -> Choice | None:
    """Return the choice that an answer means: the one given, or that of a comparison's rating; None of other ratings.

    Parameters
    ----------
    choice, rating : as sent
    protocol : of the study
    grades : its scale; None where participants choose the better of two

    Raises
    ------
    InvalidVoteError
        If a rating was sent where a choice was asked for or the other way round, or it is not on the scale.
    """
    if grades is None:
        if choice is None or rating is not None:
            raise InvalidVoteError(
                f"choice is {choice!r} and rating {rating!r}; protocol {PC} expects a choice and no rating"
            )
        return choice
    if choice is not None or rating is None or not grades.holds(rating):
        raise InvalidVoteError(
            f"choice is {choice!r} and rating {rating!r}; protocol {protocol} expects a rating from {grades.low} to "
            f"{grades.high} and no choice"
        )
    if protocol != CCR:
        return None
    return "b" if rating > 0 else "a" if rating < 0 else "none"


def check_viewing(
    viewing: Mapping[str, Any], first_shown: Label, *, has_reference: bool = False, is_alone: bool = False
) -> None:
    """Check a well-formed viewing record against itself and its trial.

    Only contradictions are refused. Short looks and quick answers are facts about a participant: they are kept, and
    the analysis judges them.

    Parameters
    ----------
    viewing : types and bounds are already checked
    first_shown : the label that the trial shows first
    has_reference : whether the trial shows a reference besides A and B
    is_alone : whether the trial shows one film, from which nobody can switch

    Raises
    ------
    InvalidVoteError
        If nothing was shown, another label was shown first, a switch does not change what is shown or goes to what is
        not there, or switches are not in the order of time.
    """
    if not viewing["shown_ms"] > 0:
        raise InvalidVoteError(f"shown_ms is {viewing['shown_ms']}; nobody can vote on what was not shown")
    if viewing["first_shown"] != first_shown:
        raise InvalidVoteError(f"first_shown is {viewing['first_shown']!r}; the trial shows {first_shown!r} first")
    if is_alone and viewing["switches"]:
        raise InvalidVoteError(f"{len(viewing['switches'])} switches; the trial shows one film")
    shown, at_ms = first_shown, 0.0
    for number, switch in enumerate(viewing["switches"], start=1):
        if switch["to"] == "reference" and not has_reference:
            raise InvalidVoteError(f"switch {number} goes to the reference, and the trial shows none")
        if switch["to"] == shown:
            raise InvalidVoteError(f"switch {number} goes to {shown!r}, which is already shown")
        if switch["at_ms"] < at_ms:
            raise InvalidVoteError(f"switch {number} is at {switch['at_ms']} ms, before the one at {at_ms} ms")
        shown, at_ms = switch["to"], switch["at_ms"]


def without_unknowns(viewing: dict[str, Any]) -> dict[str, Any]:
    """Leave out of a viewing record what a client says it does not know: null means as much as leaving out."""
    known = _without_nulls(viewing)
    known["switches"] = [_without_nulls(switch) for switch in viewing["switches"]]
    if "dwell_ms" in known:
        known["dwell_ms"] = _without_nulls(known["dwell_ms"])
    if "smoothness" in known:
        known["smoothness"] = _without_nulls(known["smoothness"])
    return known


def _without_nulls(record: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in record.items() if value is not None}


def has_seen_both(viewing: Mapping[str, Any]) -> bool:
    """Were both A and B on screen according to the viewing record?"""
    return {"a", "b"} <= {viewing["first_shown"], *(switch["to"] for switch in viewing["switches"])}


def press_to_picture_ms(viewing: Mapping[str, Any]) -> float | None:
    """Return the median time from a press to the presented picture of a record's switches; None where none tells it."""
    timed = [switch for switch in viewing["switches"] if switch.get("presented_ms", -1.0) >= switch["at_ms"]]
    delays = [switch["presented_ms"] - switch["at_ms"] for switch in timed]
    return round(median(delays), 1) if delays else None

"""Check that a vote is valid: its viewing record contradicts neither itself nor the trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from app.study.trial import Label

Choice = Literal["a", "b", "none"]


class InvalidVoteError(ValueError):
    """A vote's viewing record contradicts itself or the trial."""


@dataclass(frozen=True)
class Vote:
    """A participant's choice in a trial, and the viewing record before it.

    Parameters
    ----------
    client_id : made by the browser before it sends, so that sending twice is harmless
    choice : the better one, or none
    viewing : {"first_shown", "shown_ms", "response_ms", "switches": [{"to", "at_ms", "media_time_s"}]}; times count
        from the first frame shown, `response_ms` from the voting screen
    """

    client_id: str
    choice: Choice
    viewing: Mapping[str, Any]

    @property
    def switches(self) -> Sequence[Mapping[str, Any]]:
        switches: Sequence[Mapping[str, Any]] = self.viewing["switches"]
        return switches


def check_vote(vote: Vote) -> None:
    """Check that a well-formed vote does not contradict itself.

    Only contradictions are refused. Short looks and quick answers are facts about a participant: they are kept, and
    the analysis judges them.

    Parameters
    ----------
    vote : with types and bounds checked before

    Raises
    ------
    InvalidVoteError
        If a switch does not change what is shown, or switches are not in the order of time.
    """
    shown, at_ms = vote.viewing["first_shown"], 0.0
    for number, switch in enumerate(vote.switches, start=1):
        if switch["to"] == shown:
            raise InvalidVoteError(f"switch {number} goes to {shown!r}, which is already shown")
        if switch["at_ms"] < at_ms:
            raise InvalidVoteError(f"switch {number} is at {switch['at_ms']} ms, before the one at {at_ms} ms")
        shown, at_ms = switch["to"], switch["at_ms"]


def check_vote_on_trial(vote: Vote, first_shown: Label, *, has_reference: bool = False) -> None:
    """Check that a vote does not contradict its trial.

    Parameters
    ----------
    vote : checked by `check_vote`
    first_shown : the label that the trial shows first
    has_reference : does the trial show a reference besides A and B?

    Raises
    ------
    InvalidVoteError
        If another label was shown first, or a switch goes to a missing reference.
    """
    if vote.viewing["first_shown"] != first_shown:
        raise InvalidVoteError(f"first_shown is {vote.viewing['first_shown']!r}; the trial shows {first_shown!r} first")
    if has_reference:
        return
    for number, switch in enumerate(vote.switches, start=1):
        if switch["to"] == "reference":
            raise InvalidVoteError(f"switch {number} goes to the reference, and the trial shows none")


def has_seen_both(viewing: Mapping[str, Any]) -> bool:
    """Were both A and B on screen according to the viewing record?"""
    return {"a", "b"} <= {viewing["first_shown"], *(switch["to"] for switch in viewing["switches"])}


def is_same(sent: Vote, stored: Vote) -> bool:
    """Is a vote that arrives again the stored one?"""
    return sent.client_id == stored.client_id and sent.choice == stored.choice and sent.viewing == stored.viewing

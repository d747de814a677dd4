"""What a valid vote is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from app.study.trial import Label

Choice = Literal["a", "b", "none"]


class InvalidVoteError(ValueError):
    """A vote whose viewing record contradicts itself or the trial."""


@dataclass(frozen=True)
class Vote:
    """A participant's choice in one trial and how it was come to.

    Parameters
    ----------
    client_id : made by the browser before it sends, so that sending twice is harmless
    choice : the better one, or none
    viewing : {"first_shown", "shown_ms", "response_ms", "switches": [{"to", "at_ms", "media_time_s"}]}, times from the
        first frame shown, `response_ms` from the voting screen
    """

    client_id: str
    choice: Choice
    viewing: Mapping[str, Any]

    @property
    def switches(self) -> Sequence[Mapping[str, Any]]:
        switches: Sequence[Mapping[str, Any]] = self.viewing["switches"]
        return switches


def check_vote(vote: Vote) -> None:
    """Check a well-formed vote against itself.

    Only contradictions are refused. Short looks and quick answers are facts about a participant: they are kept, and the
    analysis decides what they mean.

    Parameters
    ----------
    vote : types and bounds are already checked

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
    """Check a vote that does not contradict itself against its trial.

    Parameters
    ----------
    first_shown : the label that the trial shows first
    has_reference : whether the trial shows a reference besides A and B

    Raises
    ------
    InvalidVoteError
        If another label was shown first, or a switch goes to what is not there.
    """
    if vote.viewing["first_shown"] != first_shown:
        raise InvalidVoteError(f"first_shown is {vote.viewing['first_shown']!r}; the trial shows {first_shown!r} first")
    if has_reference:
        return
    for number, switch in enumerate(vote.switches, start=1):
        if switch["to"] == "reference":
            raise InvalidVoteError(f"switch {number} goes to the reference, and the trial shows none")


def has_seen_both(viewing: Mapping[str, Any]) -> bool:
    """Whether a viewing record has both A and B on screen at some time."""
    return {"a", "b"} <= {viewing["first_shown"], *(switch["to"] for switch in viewing["switches"])}


def is_same(sent: Vote, stored: Vote) -> bool:
    """Whether a vote that arrives again is the one already kept."""
    return sent.client_id == stored.client_id and sent.choice == stored.choice and sent.viewing == stored.viewing

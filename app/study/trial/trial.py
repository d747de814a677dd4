"""Define a trial: two stimuli in one video, one above the other, labelled A and B."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Half = Literal["top", "bottom"]
Label = Literal["a", "b"]
Disturbance = Literal["full screen", "hidden", "blur", "resize"]  # full screen left; blur: another window in front
Interruption = Disturbance | Literal["left the page", "suspended"]  # reloaded, closed, back or forward; no frame came
Role = Literal["main", "repeat", "identical"]  # only main trials are scored; the others check the participant

MAIN: Role = "main"
REPEAT: Role = "repeat"
IDENTICAL: Role = "identical"
LEFT_THE_PAGE: Interruption = "left the page"


@dataclass(frozen=True)
class PlannedPair:
    """An unordered pair of stimuli of a dataset, as it lies in its video; keys are the caller's.

    Parameters
    ----------
    key : of the pair
    dataset : its key
    top, bottom : keys of the stimuli; the same one twice in a pair that checks attention
    """

    key: int
    dataset: int
    top: int
    bottom: int

    @property
    def is_identical(self) -> bool:
        return self.top == self.bottom

    @property
    def stimuli(self) -> frozenset[int]:
        return frozenset((self.top, self.bottom))


@dataclass(frozen=True)
class PlannedTrial:
    """A trial of a participant's order: a pair, the half labelled A, and the label shown first."""

    pair: int
    a_half: Half
    first_shown: Label
    role: Role = MAIN

    @property
    def exchanged(self) -> PlannedTrial:
        """The pair in its other order: A and B change places, so the other stimulus is shown first."""
        return PlannedTrial(self.pair, other_half(self.a_half), self.first_shown, self.role)


@dataclass(frozen=True)
class Items:
    """The conditions behind a trial's labels."""

    item_a: str
    item_b: str
    first_shown: str


def reveal(top: str, bottom: str, a_half: str, first_shown: str) -> Items:
    """Return which condition was A, which B, and which was shown first.

    Parameters
    ----------
    top, bottom : the conditions in the halves of the pair's video
    a_half : the half labelled A
    first_shown : the label shown first
    """
    item_a, item_b = (top, bottom) if a_half == "top" else (bottom, top)
    return Items(item_a, item_b, item_a if first_shown == "a" else item_b)


def other_half(half: Half) -> Half:
    return "bottom" if half == "top" else "top"


def other_label(label: Label) -> Label:
    return "b" if label == "a" else "a"

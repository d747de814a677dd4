"""A trial: two stimuli in one video, one above the other, under the labels A and B."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Half = Literal["top", "bottom"]
Label = Literal["a", "b"]


@dataclass(frozen=True)
class Items:
    """What hides behind a trial's labels, by the conditions' names."""

    item_a: str
    item_b: str
    first_shown: str


def reveal(top: str, bottom: str, a_half: str, first_shown: str) -> Items:
    """Which condition was A, which B, and which was shown first.

    Parameters
    ----------
    top, bottom : the conditions in the halves of the pair's video
    a_half : the half labelled A
    first_shown : the label shown first
    """
    item_a, item_b = (top, bottom) if a_half == "top" else (bottom, top)
    return Items(item_a, item_b, item_a if first_shown == "a" else item_b)

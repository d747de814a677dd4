"""Check the comprehension question at the end of the instructions; the page does not contain the right answer."""

from __future__ import annotations

RIGHT_ANSWER = "switch"


def is_understood(answer: object) -> bool:
    """Does the answer show that the participant understood the instructions?"""
    return answer == RIGHT_ANSWER

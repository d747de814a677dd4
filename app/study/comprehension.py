"""The question that ends the instructions; its right answer is known here and nowhere in the page."""

from __future__ import annotations

ANSWERS = ("wait", "switch", "count")
RIGHT_ANSWER = "switch"


def is_understood(answer: object) -> bool:
    """Whether an answer shows that the instructions were understood."""
    return answer == RIGHT_ANSWER

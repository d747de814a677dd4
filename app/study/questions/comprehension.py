"""Check the comprehension question at the end of the instructions; the page does not contain the right answer."""

from __future__ import annotations

from app.study.protocols import SHOWN_ALONE, Protocol

ANSWERS = ("wait", "switch", "count")  # what one does while a pair is running
ANSWERS_ALONE = ("memorise", "rate", "compare")  # what one does after a film that is shown alone


def right_answer(protocol: Protocol) -> str:
    """Return the answer that shows that the instructions were understood, of ANSWERS or ANSWERS_ALONE."""
    return "rate" if protocol in SHOWN_ALONE else "switch"

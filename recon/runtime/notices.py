"""What a command left out, or took otherwise than its input says: a warning that commands print at their end."""

from __future__ import annotations


class Notice(UserWarning):
    """What is not as the input says."""

"""Name the ways in which a browser shows A and B in step, the best first."""

from __future__ import annotations

from typing import Literal

Technique = Literal["stacked", "webcodecs", "two videos"]

WEBCODECS: Technique = "webcodecs"  # a film of each, decoded picture by picture and drawn together
TWO_VIDEOS: Technique = "two videos"  # two players side by side, which may be a frame apart


def is_frame_locked(technique: str | None) -> bool | None:
    """Were A and B always at the same frame by construction? None where the technique is not known."""
    return None if technique is None else technique != TWO_VIDEOS

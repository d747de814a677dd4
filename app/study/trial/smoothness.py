"""Judge from a viewing record whether its film ran: how many frames were presented, and how long none was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from app.study.trial.technique import TWO_VIDEOS
from app.study.trial.valid_vote import press_to_picture_ms

LONGEST_GAP_S = 1.0  # between two frames, besides the film's own step: a computer asleep, or one that is far too busy
FEWEST_FRAMES = 0.5  # of those that a film without drops presents; the page, which switches, paints as often at least

LATEST_PICTURE_MS = 250.0  # after a press, at the median; a usual computer takes about 30


@dataclass(frozen=True)
class Smoothness:
    """How smoothly a film ran while it was looked at; None where the record does not tell.

    Parameters
    ----------
    longest_gap_ms : between two presented frames, or from the last one to the look's end
    frame_share : frames presented, of those that a film without drops presents in the same time
    mismatch_share : refreshes of the display at which A and B were different frames, of all
    shown_smoothly : whether the frames support the viewing time, and came soon after presses
    """

    longest_gap_ms: float | None
    frame_share: float | None
    mismatch_share: float | None
    shown_smoothly: bool | None


UNKNOWN = Smoothness(None, None, None, None)


def smoothness(viewing: Mapping[str, Any] | None, fps: float) -> Smoothness:
    """Judge a viewing record; older ones, which do not tell of gaps, by the browser's own counts of frames.

    Parameters
    ----------
    viewing : as `app/study/trial/valid_vote.py` describes it; None: there is none
    fps : frames a second of the film
    """
    if not viewing:
        return UNKNOWN
    told = viewing.get("smoothness") or {}
    gap_ms = told.get("longest_gap_ms")
    presented = told.get("n_presented", _presented(viewing))
    expected = viewing.get("shown_ms", 0.0) * fps / 1000
    share = _share(presented, expected)
    verdict = None
    if share is not None or gap_ms is not None:
        refreshes = _share(told.get("n_refreshes"), expected)
        has_frames = min(known for known in (share, refreshes, 1.0) if known is not None) >= FEWEST_FRAMES
        is_prompt = (press_to_picture_ms(viewing) or 0.0) <= LATEST_PICTURE_MS
        verdict = has_frames and is_prompt and (gap_ms is None or gap_ms <= allowed_gap_ms(fps))
    return Smoothness(gap_ms, share, _share(viewing.get("n_mismatches"), told.get("n_refreshes", 0)), verdict)


def allowed_gap_ms(fps: float) -> float:
    """Return the longest time between two frames with which a look counts, ms: a slow film has longer steps."""
    return 1000 * (LONGEST_GAP_S + 1 / fps)


def _presented(viewing: Mapping[str, Any]) -> float | None:
    if not viewing.get("n_frames"):
        return None  # a browser that does not count says 0
    presented = viewing["n_frames"] - viewing.get("n_dropped", 0)
    has_two_counts = viewing.get("technique") == TWO_VIDEOS and viewing.get("switches")
    return float(presented / 2 if has_two_counts else presented)


def _share(part: float | None, whole: float) -> float | None:
    return None if part is None or whole <= 0 else round(part / whole, 4)

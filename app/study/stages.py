"""Define the stages of a session, and the legal moves from one to the next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

INTRODUCTION = "introduction"
SCREENING = "screening"
PRACTICE = "practice"
TRIAL = "trial"
INTERVIEW = "interview"
FINISHED = "finished"
WITHDRAWN = "withdrawn"  # not part of the way: an end, reached from any stage
SCREENED_OUT = "screened_out"  # an end too: the study's rule for participants who fail the screening
TIMED_OUT = "timed_out"  # an end: the study limits the time, and it was over before the last vote
ENDS = (FINISHED, WITHDRAWN, SCREENED_OUT, TIMED_OUT)
ALL_STAGES = (INTRODUCTION, SCREENING, PRACTICE, TRIAL, INTERVIEW, FINISHED)
OptionalStage = Literal["screening", "practice", "interview"]
OPTIONAL_STAGES: tuple[OptionalStage, ...] = get_args(OptionalStage)
SHORTEST_WAY = (INTRODUCTION, TRIAL, FINISHED)


class IllegalMoveError(ValueError):
    """The stage cannot be completed now."""


def way_through(optional: Sequence[str]) -> tuple[str, ...]:
    """Return the stages of a study with these optional ones, in order."""
    return tuple(stage for stage in ALL_STAGES if stage not in OPTIONAL_STAGES or stage in optional)


def after_completing(stage: str, current: str, way: Sequence[str] = SHORTEST_WAY) -> str:
    """Return the session's stage after a participant has completed a stage by hand.

    Completing an earlier stage again changes nothing, so a request can be sent twice.

    Parameters
    ----------
    stage : reported as completed
    current : the session's stage
    way : the study's stages in order

    Raises
    ------
    IllegalMoveError
        If the stage is still ahead, does not end by hand, the participant has withdrawn, or the time is over.
    """
    if current == WITHDRAWN:
        raise IllegalMoveError("you have withdrawn from the study")
    if current == TIMED_OUT:
        raise IllegalMoveError("the time for this study is over")
    if current == SCREENED_OUT and stage in ALL_STAGES[: ALL_STAGES.index(SCREENING) + 1]:
        return current
    if current == SCREENED_OUT:
        raise IllegalMoveError("the study has ended for you after the screening")
    if is_past(stage, current):
        return current
    if stage == FINISHED:
        raise IllegalMoveError("the session's end is not a stage to complete")
    if stage == TRIAL:
        raise IllegalMoveError("the trials end with the last vote")
    if stage != current:
        raise IllegalMoveError(f"the session is in the stage {current}; {stage} comes later")
    return next_stage(stage, way)


def is_past(stage: str, current: str) -> bool:
    """Is the stage behind a session in the current one? Every way has the order of ALL_STAGES.

    Parameters
    ----------
    stage : the stage asked about
    current : the session's stage
    """
    return current in ALL_STAGES and ALL_STAGES.index(current) > ALL_STAGES.index(stage)


def next_stage(stage: str, way: Sequence[str] = SHORTEST_WAY) -> str:
    """Return the stage that follows; FINISHED is the last."""
    return way[way.index(stage) + 1]

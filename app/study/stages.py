"""The stages of a session, and which move from one to the next is legal."""

from __future__ import annotations

from collections.abc import Sequence

INTRODUCTION = "introduction"
SCREENING = "screening"
PRACTICE = "practice"
TRIAL = "trial"
INTERVIEW = "interview"
FINISHED = "finished"
WITHDRAWN = "withdrawn"  # stands beside the way: it is reached from any stage and leads nowhere
SCREENED_OUT = "screened_out"  # so does this one: the study's rule ends it for who does not pass the screening
ENDS = (FINISHED, WITHDRAWN, SCREENED_OUT)
ALL_STAGES = (INTRODUCTION, SCREENING, PRACTICE, TRIAL, INTERVIEW, FINISHED)
OPTIONAL_STAGES = (SCREENING, PRACTICE, INTERVIEW)
SHORTEST_WAY = (INTRODUCTION, TRIAL, FINISHED)


class IllegalMoveError(ValueError):
    """A stage that cannot be completed now."""


def way_through(optional: Sequence[str]) -> tuple[str, ...]:
    """The stages of a study that has these optional ones, in order.

    Raises
    ------
    ValueError
        If one of them is not an optional stage.
    """
    if unknown := [stage for stage in optional if stage not in OPTIONAL_STAGES]:
        raise ValueError(f"stage {unknown[0]!r}: expected one of {', '.join(OPTIONAL_STAGES)}")
    return tuple(stage for stage in ALL_STAGES if stage not in OPTIONAL_STAGES or stage in optional)


def after_completing(stage: str, current: str, way: Sequence[str] = SHORTEST_WAY) -> str:
    """The stage a session is in once a participant has completed one by hand.

    Completing a stage that is already behind changes nothing, so that a request can be sent twice.

    Parameters
    ----------
    stage : the stage reported as completed
    current : the stage the session is in
    way : the study's stages in order

    Raises
    ------
    IllegalMoveError
        If the stage is still ahead, ends otherwise than by hand, or the participant has withdrawn.
    """
    if current == WITHDRAWN:
        raise IllegalMoveError("you have withdrawn from the study")
    if current == SCREENED_OUT and stage in ALL_STAGES[: ALL_STAGES.index(SCREENING) + 1]:
        return current
    if current == SCREENED_OUT:
        raise IllegalMoveError("the study has ended for you after the screening")
    if way.index(stage) < way.index(current):
        return current
    if stage == FINISHED:
        raise IllegalMoveError("the session's end is not a stage to complete")
    if stage == TRIAL:
        raise IllegalMoveError("the trials end with the last vote")
    if stage != current:
        raise IllegalMoveError(f"the session is in the stage {current}; {stage} comes later")
    return next_stage(stage, way)


def is_past(stage: str, current: str, way: Sequence[str] = SHORTEST_WAY) -> bool:
    """Whether a stage lies behind who is in the current one."""
    return current not in (WITHDRAWN, SCREENED_OUT) and way.index(current) > way.index(stage)


def next_stage(stage: str, way: Sequence[str] = SHORTEST_WAY) -> str:
    """The stage that follows; FINISHED is the last."""
    return way[way.index(stage) + 1]

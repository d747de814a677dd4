"""The stages of a session, and which move from one to the next is legal."""

from __future__ import annotations

INTRODUCTION = "introduction"
TRIAL = "trial"
FINISHED = "finished"
STAGES = (INTRODUCTION, TRIAL, FINISHED)


class IllegalMoveError(ValueError):
    """A stage that cannot be completed now."""


def after_completing(stage: str, current: str) -> str:
    """The stage a session is in once a participant has completed one by hand.

    Completing a stage that is already behind changes nothing, so that a request can be sent twice.

    Parameters
    ----------
    stage : the stage reported as completed
    current : the stage the session is in

    Raises
    ------
    IllegalMoveError
        If the stage is still ahead, or ends otherwise than by hand.
    """
    if STAGES.index(stage) < STAGES.index(current):
        return current
    if stage == FINISHED:
        raise IllegalMoveError("the session's end is not a stage to complete")
    if stage == TRIAL:
        raise IllegalMoveError("the trials end with the last vote")
    if stage != current:
        raise IllegalMoveError(f"the session is in the stage {current}; {stage} comes later")
    return next_stage(stage)


def next_stage(stage: str) -> str:
    """The stage that follows; FINISHED is the last."""
    return STAGES[STAGES.index(stage) + 1]

from __future__ import annotations

import pytest

from app.study.stages import FINISHED, INTRODUCTION, STAGES, TRIAL, IllegalMoveError, after_completing, next_stage


def test_completing_the_current_stage_moves_to_the_next() -> None:
    assert after_completing(INTRODUCTION, INTRODUCTION) == TRIAL


@pytest.mark.parametrize("current", [TRIAL, FINISHED])
def test_completing_a_stage_again_changes_nothing(current: str) -> None:
    assert after_completing(INTRODUCTION, current) == current


@pytest.mark.parametrize(
    ("stage", "current"), [(TRIAL, INTRODUCTION), (TRIAL, TRIAL), (FINISHED, TRIAL), (FINISHED, FINISHED)]
)
def test_stages_that_end_by_themselves_or_lie_ahead_cannot_be_completed(stage: str, current: str) -> None:
    with pytest.raises(IllegalMoveError):
        after_completing(stage, current)


def test_the_stages_lead_from_the_introduction_to_the_end() -> None:
    walked = [STAGES[0]]
    while walked[-1] != FINISHED:
        walked.append(next_stage(walked[-1]))
    assert walked == list(STAGES)

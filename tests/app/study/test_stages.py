from __future__ import annotations

import pytest

from app.study.stages import (
    ALL_STAGES,
    FINISHED,
    INTERVIEW,
    INTRODUCTION,
    OPTIONAL_STAGES,
    PRACTICE,
    SCREENED_OUT,
    SCREENING,
    SHORTEST_WAY,
    TRIAL,
    WITHDRAWN,
    IllegalMoveError,
    after_completing,
    is_past,
    next_stage,
    way_through,
)


def test_completing_the_current_stage_moves_to_the_next() -> None:
    assert after_completing(INTRODUCTION, INTRODUCTION) == TRIAL


@pytest.mark.parametrize("current", [TRIAL, FINISHED])
def test_completing_a_stage_again_changes_nothing(current: str) -> None:
    assert after_completing(INTRODUCTION, current) == current


@pytest.mark.parametrize(
    ("stage", "current"),
    [(TRIAL, INTRODUCTION), (TRIAL, TRIAL), (FINISHED, TRIAL), (FINISHED, FINISHED), (INTERVIEW, INTRODUCTION)],
)
def test_stages_that_end_by_themselves_or_lie_ahead_cannot_be_completed(stage: str, current: str) -> None:
    with pytest.raises(IllegalMoveError):
        after_completing(stage, current)


def test_the_stages_lead_from_the_introduction_to_the_end() -> None:
    walked = [SHORTEST_WAY[0]]
    while walked[-1] != FINISHED:
        walked.append(next_stage(walked[-1]))
    assert walked == list(SHORTEST_WAY)


@pytest.mark.parametrize("optional", [(), ("interview",), ("practice",), OPTIONAL_STAGES])
def test_optional_stages_stand_in_their_order(optional: tuple[str, ...]) -> None:
    way = way_through(optional)
    assert [stage for stage in ALL_STAGES if stage in way] == list(way)
    assert set(way) == {*SHORTEST_WAY, *optional}
    stage = way[0]
    while stage != TRIAL:
        stage = after_completing(stage, stage, way)
    assert next_stage(TRIAL, way) == ("interview" if "interview" in optional else FINISHED)


@pytest.mark.parametrize("current", [PRACTICE, INTERVIEW])
def test_a_preview_in_a_stage_that_an_edit_took_away_is_where_it_stands_among_all(current: str) -> None:
    assert is_past(TRIAL, current) == (current == INTERVIEW)
    assert after_completing(INTRODUCTION, current) == current


def test_who_has_withdrawn_completes_nothing() -> None:
    with pytest.raises(IllegalMoveError, match="withdrawn"):
        after_completing(INTRODUCTION, WITHDRAWN)
    assert not is_past(TRIAL, WITHDRAWN)
    assert is_past(TRIAL, FINISHED)


def test_who_was_screened_out_hears_so_again_and_completes_nothing_more() -> None:
    for stage in (INTRODUCTION, SCREENING):
        assert after_completing(stage, SCREENED_OUT, ALL_STAGES) == SCREENED_OUT
    for stage in (PRACTICE, TRIAL):
        with pytest.raises(IllegalMoveError, match="ended for you"):
            after_completing(stage, SCREENED_OUT, ALL_STAGES)

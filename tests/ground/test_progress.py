"""How long work still takes is told about right, or not at all."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.progress import TELLING_TIME, Pace

SECONDS = st.floats(0.01, 1000)


def left_after(moments: list[float], total: int, *, already: int = 0) -> list[float | None]:
    """What is told after each of the things that are done at these moments; the step begins at 0 s."""
    pace = Pace()
    pace.left_s(already, total, 0.0)
    return [pace.left_s(already + n, total, moment) for n, moment in enumerate(moments, 1)]


@given(SECONDS, st.integers(2, 300), st.integers(0, 50))
def test_what_goes_on_at_one_speed_is_foretold_exactly(part_s: float, n: int, already: int) -> None:
    told = left_after([part_s * done for done in range(1, n + 1)], already + n, already=already)
    assert told[-1] is None, "nothing is left"
    first_told = max(2, -(-min(n, 200) // 10))
    assert told[: first_told - 1] == [None] * (first_told - 1)
    for done, left_s in enumerate(told[first_told - 1 : -1], first_told):
        assert left_s == pytest.approx(part_s * (n - done))


@given(SECONDS, st.floats(1, 0.9 * 3 / TELLING_TIME), st.integers(5, 40))
def test_a_slow_first_does_not_make_the_rest_long_after_three_more(part_s: float, slower: float, n: int) -> None:
    told = left_after([part_s * (slower + done) for done in range(n)], n)
    for done, left_s in enumerate(told[3:-1], 4):
        assert left_s == pytest.approx(part_s * (n - done), rel=0.3)


@given(SECONDS, st.integers(2, 32), st.integers(3, 12), st.floats(0, 0.1))
def test_what_workers_end_together_is_foretold_within_half_when_all_have_ended(
    turn_s: float, workers: int, turns: int, spread: float
) -> None:
    ends = [turn_s * (turn + spread * worker / workers) for turn in range(1, turns + 1) for worker in range(workers)]
    told = left_after(ends, len(ends))[workers - 1 : -1 : workers]
    assert told[0] is None, "all may have begun late"
    for turn, left_s in enumerate(told[1:], 2):
        assert left_s == pytest.approx(turn_s * (turns - turn), rel=0.5)


def test_nothing_is_foretold_of_a_step_from_the_one_before() -> None:
    pace = Pace()
    assert [pace.left_s(done, 6, 10.0 * done) for done in range(4)] == [None, None, *map(pytest.approx, (40, 30))]
    assert pace.left_s(1, 12, 100.0) is None, "more is to be done: another step"
    assert [pace.left_s(done, 12, 70 + 30.0 * done) for done in (2, 3)] == [None, pytest.approx(270)]
    assert pace.left_s(0, 12, 200.0) is None, "less is done: another step"

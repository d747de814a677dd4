"""The adaptive acuity test, on artificial people whose acuity is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.screening.acuity import (
    FEWEST_RINGS,
    GUESSING,
    LAPSING,
    LARGEST_FIRST,
    N_DIRECTIONS,
    THRESHOLDS,
    Acuity,
    AcuityTest,
    Ring,
    gap_arcmin,
    judge,
    next_size,
    posterior,
    probability_right,
    smallest_size,
)
from tests.app.study.screening.acuity_observer import simulate_test

N_PEOPLE = 300
FULL_HD_27_INCH_MM = 597.7 / 1920  # pixel pitch
looks = st.lists(
    st.builds(Ring, st.floats(-0.5, 1.5), st.integers(0, 7), st.integers(0, 7)), max_size=30
)  # answers of any kind


def people(threshold: float, test: AcuityTest) -> list[Acuity]:
    rng = np.random.default_rng([7, round(1000 * (1 + threshold))])
    return [judge(simulate_test(threshold, test, rng), test) for _ in range(N_PEOPLE)]


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [-0.1, 0.1])
def test_rings_until_the_verdict_is_certain_measure_to_0_065_and_misjudge_3_percent_at_most(threshold: float) -> None:
    test = AcuityTest(limit=0.0)
    found = people(threshold, test)
    assert np.std([one.logmar for one in found]) <= 0.065
    assert abs(np.mean([one.logmar for one in found]) - threshold) <= 0.025
    right = "passed" if threshold < test.limit else "failed"
    assert np.mean([one.verdict != right for one in found]) <= 0.03


@pytest.mark.slow
def test_who_sees_clearly_better_or_worse_than_the_limit_has_seen_enough_after_half_of_the_rings() -> None:
    for threshold, usual in ((-0.15, 11), (0.0, 15), (0.4, 12)):
        found = people(threshold, AcuityTest(limit=0.18))
        assert FEWEST_RINGS <= np.mean([one.n_trials for one in found]) <= usual
        right = "passed" if threshold < 0.18 else "failed"
        assert np.mean([one.verdict != right for one in found]) <= 0.01
        assert np.std([one.logmar for one in found]) <= 0.07


def test_a_test_does_not_stop_before_its_fewest_rings_nor_on_a_display_that_cannot_decide() -> None:
    seen = [Ring(-0.5, 0, 0)] * (FEWEST_RINGS - 1)
    assert next_size(seen, AcuityTest(limit=1.0)) is not None
    assert next_size([*seen, seen[0]], AcuityTest(limit=1.0)) is None
    assert next_size([Ring(1.5, 0, 1)] * FEWEST_RINGS, AcuityTest(limit=0.0, smallest=0.1)) is not None


@pytest.mark.slow
def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    assert np.mean([one.low <= 0.3 <= one.high for one in people(0.3, AcuityTest())]) >= 0.92


@pytest.mark.slow
def test_a_display_that_cannot_draw_the_limit_says_so() -> None:
    """The paper's display at its distance: two pixels are larger than the gap of logMAR 0."""
    smallest = smallest_size(FULL_HD_27_INCH_MM, 900)
    assert smallest == pytest.approx(np.log10(2 * 1.19), abs=0.005)
    assert smallest_size(FULL_HD_27_INCH_MM, 2500) < 0 < smallest
    test = AcuityTest(limit=0.0, smallest=smallest)
    sizes = [look.size for look in simulate_test(-0.2, test, np.random.default_rng(1))]
    assert min(sizes) >= smallest - 1e-3
    assert "passed" not in {one.verdict for one in people(-0.2, test)}
    assert {one.verdict for one in people(0.8, test)} == {"failed"}


def test_a_minute_of_arc_is_a_sixtieth_of_a_degree() -> None:
    assert gap_arcmin(2 * 1000 * np.tan(np.radians(0.5)), 1000) == pytest.approx(60)


@given(st.floats(-0.6, 1.6), st.floats(0, 1))
def test_larger_rings_are_seen_better(size: float, larger: float) -> None:
    small, large = (probability_right(one, THRESHOLDS) for one in (size, size + larger))
    assert np.all(large >= small)
    assert np.all((small >= GUESSING - 1e-12) & (large <= 1 - LAPSING + 1e-12))


@given(looks)
def test_a_posterior_is_a_distribution_whatever_is_answered(answers: list[Ring]) -> None:
    probability = posterior(answers)
    assert probability.sum() == pytest.approx(1)
    assert np.all(probability >= 0)


@pytest.mark.slow
@given(looks, st.floats(-0.6, 0.8))
def test_a_ring_is_never_smaller_than_the_display_can_draw(answers: list[Ring], smallest: float) -> None:
    size = next_size(answers, AcuityTest(n_trials=31, smallest=smallest))
    assert size is None or size >= smallest - 1e-3


def test_the_first_ring_is_large_and_the_last_ends_the_test() -> None:
    test = AcuityTest(n_trials=3)
    assert next_size([], test) == LARGEST_FIRST
    assert next_size([Ring(1.0, 0, 0)] * 3, test) is None
    with pytest.raises(ValueError, match="2 of 3"):
        judge([Ring(1.0, 0, 0)] * 2, test)


def test_artificial_people_answer_with_a_direction() -> None:
    answers = simulate_test(0.2, AcuityTest(), np.random.default_rng(5))
    assert {look.answer for look in answers} <= set(range(N_DIRECTIONS))
    assert {look.is_right for look in answers} == {True, False}


@pytest.mark.parametrize("lengths", [(0, 900), (0.3, -1), (float("nan"), 900)])
def test_lengths_that_are_none_are_refused(lengths: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="positive lengths"):
        smallest_size(*lengths)


def test_nothing_is_extrapolated_below_the_smallest_ring_that_was_drawn() -> None:
    test = AcuityTest(limit=0.5, smallest=0.376)
    sharp = judge([Ring(0.376, 0, 0)] * test.n_trials, test)
    assert (sharp.logmar, sharp.low, sharp.is_bound, sharp.verdict) == (0.376, 0.376, True, "passed")
    blunt = judge([Ring(1.0, 0, 4 * (number % 2)) for number in range(test.n_trials)], test)
    assert not blunt.is_bound
    assert blunt.logmar > 0.376


@given(looks)
def test_an_acuity_that_is_told_as_the_limit_reaches_it(answers: list[Ring]) -> None:
    told = judge(answers, AcuityTest(n_trials=len(answers))).logmar
    assert judge(answers, AcuityTest(limit=told, n_trials=len(answers))).verdict == "passed"

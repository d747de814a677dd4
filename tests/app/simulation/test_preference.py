"""Davidson's model as an artificial participant."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.simulation.preference import choice_probabilities, choose, tie_weight

abilities = st.floats(-50, 50)
tie_rates = st.floats(0, 0.99)


@pytest.mark.slow
@given(abilities, abilities, tie_rates)
def test_probabilities_sum_to_one_and_mirror(a: float, b: float, tie_rate: float) -> None:
    p_a, p_b, p_none = choice_probabilities(a, b, tie_rate)
    assert p_a + p_b + p_none == pytest.approx(1)
    assert choice_probabilities(b, a, tie_rate) == pytest.approx((p_b, p_a, p_none))


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.01, 0.9))
def test_probabilities_are_davidsons(a: float, b: float, tie_rate: float) -> None:
    nu = tie_weight(tie_rate)
    weights = np.array([math.exp(a), math.exp(b), nu * math.sqrt(math.exp(a) * math.exp(b))])
    assert choice_probabilities(a, b, tie_rate) == pytest.approx(weights / weights.sum())


@given(abilities, tie_rates)
def test_equals_tie_at_the_tie_rate(ability: float, tie_rate: float) -> None:
    assert choice_probabilities(ability, ability, tie_rate)[2] == pytest.approx(tie_rate)


def test_choices_are_as_frequent_as_probable() -> None:
    rng = np.random.default_rng(3)
    counts = Counter(choose(0.8, 0.0, 0.2, rng) for _ in range(20_000))
    expected = dict(zip(("a", "b", "none"), choice_probabilities(0.8, 0.0, 0.2), strict=True))
    assert {choice: count / 20_000 for choice, count in counts.items()} == pytest.approx(expected, abs=0.012)


@pytest.mark.parametrize("tie_rate", [-0.1, 1.0, math.nan])
def test_a_tie_rate_outside_0_to_1_is_refused(tie_rate: float) -> None:
    with pytest.raises(ValueError, match="tie rate"):
        tie_weight(tie_rate)

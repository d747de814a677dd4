"""Pairs told apart by a measure, against slow counts and tests of ranks."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import mannwhitneyu

from app.analysis.objective.pair_order import better_worse, different_similar, share_in_order

differences = st.lists(st.integers(-3, 3), min_size=1, max_size=12)


@given(differences)
def test_better_and_worse_are_told_apart_as_by_counting_all_couples(apart: list[int]) -> None:
    couples = [(0.5 if a == -b else float(a > -b)) for a, b in product(apart, apart)]
    assert better_worse(np.array([apart], float))[0] == pytest.approx(np.mean(couples))
    theirs = mannwhitneyu(apart, [-a for a in apart]).statistic / len(apart) ** 2
    assert better_worse(np.array([apart], float))[0] == pytest.approx(theirs)


@given(differences, differences)
def test_different_and_similar_pairs_are_told_apart_as_by_mann_and_whitney(
    different: list[int], similar: list[int]
) -> None:
    theirs = mannwhitneyu(np.abs(different), np.abs(similar)).statistic / (len(different) * len(similar))
    ours = different_similar(np.array([different], float), np.array([similar], float))
    assert ours[0] == pytest.approx(theirs)


@given(differences)
def test_a_measure_turned_round_has_the_complement(apart: list[int]) -> None:
    there, back = np.array([apart], float), -np.array([apart], float)
    assert better_worse(there)[0] + better_worse(back)[0] == pytest.approx(1)
    assert share_in_order(there)[0] + share_in_order(back)[0] == pytest.approx(1)


def test_an_equal_pair_counts_half() -> None:
    assert share_in_order(np.array([[1.0, 0.0, -2.0, 5.0]]))[0] == 2.5 / 4
